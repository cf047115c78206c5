// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rigs/rig_inference.h"

namespace mgsfm {

// A rule by which names that no folder tells apart make rigs, as those of
// left_0001.jpg and right_0001.jpg.
struct RigRuleSuggestion {
  std::string text;  // with the rule, ready to paste
  // A word of the names means a camera, so that chance is unlikely.
  bool is_likely = false;
};

// The cameras are the texts at one place of the names. Without them, most names
// are those of several images, or the times in the names agree. nullopt if no
// place is like this.
std::optional<RigRuleSuggestion> SuggestRigRule(const RigInput& input);

}  // namespace mgsfm
