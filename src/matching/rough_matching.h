// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/matching/descriptor_matching.h"

namespace mgsfm::internal {

// What can be said of a descriptor i without knowing all dot products exactly.
struct RoughDecision {
  enum class State {
    kRejects,  // it accepts no descriptor of the other image
    kAccepts,  // it accepts best_idx
    kUnsure,
  };
  State state = State::kUnsure;
  // The nearest, where that is sure; -1 otherwise.
  int32_t best_idx = -1;
};

struct RoughDecisions {
  std::vector<RoughDecision> of_1;
  std::vector<RoughDecision> of_2;
};

// Whether descriptors accept their nearest if those have these dot products;
// falls with the second.
using AcceptanceTest = std::function<bool(int32_t best_dot, double second_dot)>;

// Decides most descriptors by dot products of the bytes a of image 1 with the
// bytes b of image 2 rounded to multiples of about 4, which take half the time.
// With b = s c + h (c the rounded one, s = b.c / c.c, so that h is normal to
// c), m = s |c| and y = s a.c, only the part of `a` normal to c meets h:
//   | a.b - y | = | a.h | <= |h| sqrt(|a|^2 - (y / m)^2).
// These are strict bounds on the exact dot products, so every decision is the
// one that exact ones lead to.
// nullopt if the processor has no fast arithmetic for it, or if the norms are
// not those of SIFT, so that sums of 16 bits could overflow.
std::optional<RoughDecisions> DecideRoughly(DescriptorView descriptors1,
                                            DescriptorView descriptors2,
                                            const AcceptanceTest& accepts);

}  // namespace mgsfm::internal
