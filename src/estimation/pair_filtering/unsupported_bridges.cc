// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/unsupported_bridges.h"

#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/frame_cuts.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

// Per link: whether any of its matches is triplet-consistent.
Mask FindSupportedLinks(const std::vector<FramePair>& links,
                        const PairEvidence& evidence) {
  const std::vector<int> support = CountTripletConsistentMatches(
      evidence.view_graph, evidence.pair_is_used, evidence.num_threads);
  Mask is_supported;
  for (const FramePair& link : links) {
    is_supported.push_back(
        AnyOf(link.pair_idxs, [&](size_t i) { return support[i] > 0; }));
  }
  return is_supported;
}

// Per cut: the matches of inconsistent pairs that cross it, without loops.
std::vector<double> MatchesAgainst(const PairEvidence& evidence,
                                   const Mask& pair_is_explained,
                                   const FrameCuts& cuts) {
  FrameCuts::Sums against(cuts);
  for (size_t i = 0; i < evidence.view_graph.pairs.size(); ++i) {
    const ImagePair& pair = evidence.view_graph.pairs[i];
    const FramePair& frames = evidence.index.Of(i);
    if (evidence.pair_is_used[i] || pair_is_explained[i] ||
        !pair.relative_pose || evidence.index.IsLoop(frames)) {
      continue;
    }
    against.Add(frames.frame_idx1, frames.frame_idx2,
                static_cast<double>(pair.matches.size()));
  }
  return against.Finish();
}

// The pairs of bridges without support that join a frame with support, if
// enough matches contradict the bridge. A link is all consistent pairs of two
// frames; a bridge is the only link between two parts.
Mask FindBridges(const PairEvidence& evidence, const Mask& pair_is_explained,
                 const std::vector<FramePair>& links) {
  Mask is_unsupported(evidence.pair_is_used.size(), false);
  const FrameCuts cuts(evidence.index.num_frames(),
                       Transformed(links, [](const FramePair& link) {
                         return GraphEdge{link.frame_idx1, link.frame_idx2};
                       }));
  FrameCuts::Sums sums(cuts);
  for (const FramePair& link : links) {
    sums.Add(link.frame_idx1, link.frame_idx2, 1.0);
  }
  // A link is a bridge if no other one crosses a cut between its frames.
  const std::vector<double> num_links = sums.Finish();
  if (!Contains(num_links, 1.0)) return is_unsupported;
  const Mask link_is_supported = FindSupportedLinks(links, evidence);
  Mask frame_has_support(evidence.index.num_frames(), false);
  for (size_t k = 0; k < links.size(); ++k) {
    if (!link_is_supported[k]) continue;
    frame_has_support[links[k].frame_idx1] = true;
    frame_has_support[links[k].frame_idx2] = true;
  }
  const std::vector<double> against =
      MatchesAgainst(evidence, pair_is_explained, cuts);
  for (size_t k = 0; k < links.size(); ++k) {
    const auto& [frame1, frame2, pair_idxs, time_gap] = links[k];
    if (link_is_supported[k] ||
        !(frame_has_support[frame1] || frame_has_support[frame2])) {
      continue;
    }
    const size_t cut = *cuts.SmallestBetween(frame1, frame2, num_links);
    size_t num_matches = 0;
    for (const size_t i : pair_idxs) {
      num_matches += evidence.view_graph.pairs[i].matches.size();
    }
    if (num_links[cut] > 1.0 ||
        against[cut] < evidence.options.min_share_against_bridge *
                           static_cast<double>(num_matches)) {
      continue;
    }
    for (const size_t i : pair_idxs) is_unsupported[i] = true;
  }
  return is_unsupported;
}

// Rejects the loop links between parts that the links of neighbors do not
// connect, and that loops of one place alone join.
void RejectLoopsOfOnePlace(const PairEvidence& evidence,
                           const std::vector<FramePair>& links,
                           Mask* pair_is_unsupported) {
  UnionFind parts(static_cast<size_t>(evidence.index.num_frames()));
  bool has_loops = false;
  for (const FramePair& link : links) {
    const bool is_loop = evidence.index.IsLoop(link);
    has_loops |= is_loop;
    if (!is_loop) parts.Union(link.frame_idx1, link.frame_idx2);
  }
  if (!has_loops) return;
  std::vector<std::vector<int>> frames_of_part(parts.size());
  for (size_t f = 0; f < frames_of_part.size(); ++f) {
    frames_of_part[parts.Find(f)].push_back(static_cast<int>(f));
  }
  const Mask link_is_supported = FindSupportedLinks(links, evidence);
  std::map<std::pair<size_t, size_t>, std::vector<std::pair<int, int>>> joins;
  for (size_t k = 0; k < links.size(); ++k) {
    const int frame1 = links[k].frame_idx1;
    const int frame2 = links[k].frame_idx2;
    const size_t part1 = parts.Find(frame1), part2 = parts.Find(frame2);
    if (part1 == part2 || !link_is_supported[k]) continue;
    if (part1 < part2) {
      joins[{part1, part2}].emplace_back(frame1, frame2);
    } else {
      joins[{part2, part1}].emplace_back(frame2, frame1);
    }
  }
  for (const auto& [of_parts, joining] : joins) {
    const auto& [part1, part2] = of_parts;
    if (!ShowOnePlace(evidence.index, evidence.pair_is_used, joining,
                      frames_of_part[part1], frames_of_part[part2])) {
      parts.Union(part1, part2);
    }
  }
  for (const FramePair& link : links) {
    if (parts.Find(link.frame_idx1) == parts.Find(link.frame_idx2)) continue;
    for (const size_t i : link.pair_idxs) (*pair_is_unsupported)[i] = true;
  }
}

}  // namespace

bool ShowOnePlace(const FramePairIndex& index, const Mask& pair_is_used,
                  const std::vector<std::pair<int, int>>& links,
                  const std::vector<int>& frame_idxs1,
                  const std::vector<int>& frame_idxs2) {
  const auto share_view = [&](int frame1, int frame2) {
    if (frame1 == frame2 || index.AreNear(frame1, frame2)) return true;
    const FramePair* frames = index.Find(frame1, frame2);
    return frames != nullptr &&
           AnyOf(frames->pair_idxs, [&](size_t i) { return pair_is_used[i]; });
  };
  for (size_t i = 0; i < links.size(); ++i) {
    for (size_t k = 0; k < i; ++k) {
      if (!share_view(links[i].first, links[k].first) &&
          !share_view(links[i].second, links[k].second)) {
        return false;
      }
    }
  }
  const auto has_other_places = [&](const std::vector<int>& frame_idxs,
                                    int std::pair<int, int>::*linked) {
    return AnyOf(frame_idxs, [&](int frame) {
      return NoneOf(links, [&](const auto& link) {
        return share_view(frame, link.*linked);
      });
    });
  };
  return has_other_places(frame_idxs1, &std::pair<int, int>::first) &&
         has_other_places(frame_idxs2, &std::pair<int, int>::second);
}

Mask FindUnsupportedBridges(const PairEvidence& evidence,
                            const Mask& pair_is_explained) {
  MGSFM_CHECK_EQ(evidence.index.num_pairs(), evidence.view_graph.pairs.size());
  MGSFM_CHECK_EQ(evidence.pair_is_used.size(),
                 evidence.view_graph.pairs.size());
  MGSFM_CHECK_EQ(pair_is_explained.size(), evidence.view_graph.pairs.size());
  const FramePairIndex& index = evidence.index;
  std::vector<FramePair> links = index.FramePairsOf(evidence.pair_is_used);
  EraseIf(&links, [](const FramePair& f) { return !f.IsBetweenFrames(); });
  std::vector<FramePair> of_neighbors = links;
  EraseIf(&of_neighbors, [&](const FramePair& f) { return index.IsLoop(f); });
  Mask is_unsupported = FindBridges(evidence, pair_is_explained, of_neighbors);
  RejectLoopsOfOnePlace(evidence, links, &is_unsupported);
  return is_unsupported;
}

}  // namespace mgsfm
