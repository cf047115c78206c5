// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "matching/descriptor_matching.h"

namespace mgsfm::internal {

// The decision of a descriptor about its nearest neighbor in the other image,
// as far as approximate dot products determine it.
struct RoughDecision {
  enum class State {
    kRejects,  // accepts no descriptor
    kAccepts,  // accepts best_idx
    kUnsure,   // needs exact dot products
  };
  State state = State::kUnsure;
  std::optional<int32_t> best_idx;  // the nearest neighbor, if it is certain
};

struct RoughDecisions {
  std::vector<RoughDecision> of_1;
  std::vector<RoughDecision> of_2;
};

// Whether a descriptor with these largest dot products accepts its nearest
// neighbor. Must not become true as second_dot increases.
using AcceptanceTest = std::function<bool(int32_t best_dot, double second_dot)>;

// Decides most descriptors by dot products of descriptors a of image 1 with
// descriptors b of image 2 rounded to multiples of about 4, in half the time of
// exact ones. Write b = s c + h with c the rounded descriptor and
// s = b.c / c.c, so that h is orthogonal to c. With m = s |c| and y = s a.c,
// only the component of a orthogonal to c contributes to a.h:
//   | a.b - y | = | a.h | <= |h| sqrt(|a|^2 - (y / m)^2).
// These bounds are strict, so every decision equals that of exact dot products.
//
// Returns nullopt if the processor lacks AVX2 or if the norms exceed those of
// SIFT, so that 16-bit sums could overflow.
std::optional<RoughDecisions> DecideRoughly(DescriptorView descriptors1,
                                            DescriptorView descriptors2,
                                            const AcceptanceTest& accepts);

}  // namespace mgsfm::internal
