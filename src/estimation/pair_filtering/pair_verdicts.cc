// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <iterator>

#include "mgsfm/base/error.h"
#include "mgsfm/pair_filtering/pair_filtering.h"

namespace mgsfm {

bool IsRuleOn(RejectionReason reason, const PairFilteringOptions& options) {
  const auto rule =
      std::find_if(std::begin(kPairRules), std::end(kPairRules),
                   [&](const PairRule& r) { return r.reason == reason; });
  MGSFM_CHECK(rule != std::end(kPairRules));
  return options.*rule->option;
}

void Reject(const Mask& is_rejected, RejectionReason reason,
            PairVerdicts* verdicts) {
  MGSFM_CHECK_EQ(is_rejected.size(), verdicts->size());
  for (size_t i = 0; i < verdicts->size(); ++i) {
    if (is_rejected[i] && !(*verdicts)[i]) (*verdicts)[i] = reason;
  }
}

std::vector<RejectionCount> CountRejections(const PairVerdicts& verdicts,
                                            size_t num_of_fixed_regions) {
  std::vector<RejectionCount> counts;
  for (const auto& [name, reason] : EnumTable<RejectionReason>::kNames) {
    const bool is_fixed = reason == RejectionReason::kFixedRegion;
    counts.push_back({reason, is_fixed ? num_of_fixed_regions : 0});
    for (const auto& verdict : verdicts) {
      counts.back().num_pairs += verdict == reason;
    }
  }
  return counts;
}

}  // namespace mgsfm
