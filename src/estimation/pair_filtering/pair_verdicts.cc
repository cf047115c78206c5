// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/error.h"
#include "mgsfm/pair_filtering/pair_filtering.h"

namespace mgsfm {

void Reject(const Mask& is_rejected, RejectionReason reason,
            PairVerdicts* verdicts) {
  MGSFM_CHECK_EQ(is_rejected.size(), verdicts->size());
  for (size_t i = 0; i < verdicts->size(); ++i) {
    if (is_rejected[i] && !(*verdicts)[i]) (*verdicts)[i] = reason;
  }
}

std::vector<RejectionCount> CountRejections(const PairVerdicts& verdicts) {
  std::vector<RejectionCount> counts;
  for (const auto& [name, reason] : EnumTable<RejectionReason>::kNames) {
    counts.push_back({reason, 0});
    for (const auto& verdict : verdicts) {
      counts.back().num_pairs += verdict == reason;
    }
  }
  return counts;
}

}  // namespace mgsfm
