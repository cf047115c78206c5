// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <iterator>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {
namespace {

// Bridges short gaps in the matches of a structure; affects the report only.
constexpr int kMaxFrameGap = 3;

// `links` are sorted by their first frame.
UnionFind JoinNeighbors(const std::vector<FramePair>& links) {
  UnionFind sets(links.size());
  for (size_t i = 0; i < links.size(); ++i) {
    for (size_t k = i + 1; k < links.size(); ++k) {
      if (links[k].frame_idx1 - links[i].frame_idx1 > kMaxFrameGap) break;
      if (std::abs(links[k].frame_idx2 - links[i].frame_idx2) <= kMaxFrameGap) {
        sets.Union(i, k);
      }
    }
  }
  return sets;
}

}  // namespace

std::vector<RejectedGroup> GroupRejectedPairs(const FramePairIndex& index,
                                              const Mask& pair_is_rejected) {
  MGSFM_CHECK_EQ(pair_is_rejected.size(), index.num_pairs());
  const std::vector<FramePair> links = index.FramePairsOf(pair_is_rejected);
  UnionFind sets = JoinNeighbors(links);
  std::vector<RejectedGroup> groups(links.size());
  for (size_t i = 0; i < links.size(); ++i) {
    const auto& [frame1, frame2, pair_idxs, time_gap] = links[i];
    RejectedGroup& group = groups[sets.Find(i)];
    if (group.pair_idxs.empty()) group = {{}, frame1, frame1, frame2, frame2};
    group.pair_idxs.insert(group.pair_idxs.end(), pair_idxs.begin(),
                           pair_idxs.end());
    group.first_frame_idx1 = std::min(group.first_frame_idx1, frame1);
    group.last_frame_idx1 = std::max(group.last_frame_idx1, frame1);
    group.first_frame_idx2 = std::min(group.first_frame_idx2, frame2);
    group.last_frame_idx2 = std::max(group.last_frame_idx2, frame2);
  }
  EraseIf(&groups,
          [](const RejectedGroup& group) { return group.pair_idxs.empty(); });
  StableSortBy(&groups, [](const RejectedGroup& group) {
    return std::tuple(-static_cast<std::ptrdiff_t>(group.pair_idxs.size()),
                      group.first_frame_idx1, group.first_frame_idx2);
  });
  return groups;
}

std::string DescribeRejectedGroup(const Scene& scene,
                                  const RejectedGroup& group) {
  const auto name = [&](int frame_idx) {
    return "'" + scene.frames[frame_idx].name + "'";
  };
  return std::to_string(group.pair_idxs.size()) + " pairs between frames " +
         name(group.first_frame_idx1) + " to " + name(group.last_frame_idx1) +
         " and " + name(group.first_frame_idx2) + " to " +
         name(group.last_frame_idx2) +
         " contradict the other pairs and are not used";
}

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
