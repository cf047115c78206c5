// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/skeletal_graph.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

// Rounds of selection in a sequence: pairs of frames up to this fraction of the
// reach apart in time, and at least neighbors.
constexpr double kSharesOfReach[] = {0.2, 1.0};

// The skeleton selected so far, and the components of frames it connects.
struct Skeleton {
  Mask is_selected;
  UnionFind components;

  bool Connects(const FramePair& frames) {
    return components.Find(frames.frame_idx1) ==
           components.Find(frames.frame_idx2);
  }
  void Select(size_t pair_idx, const FramePair& frames) {
    is_selected[pair_idx] = true;
    components.Union(frames.frame_idx1, frames.frame_idx2);
  }
};

// Per pair of images: the strength of its frames; 0 for pairs that are not
// candidates or have no support of their own.
std::vector<double> ComputeStrengths(const FramePairIndex& index,
                                     const Mask& is_candidate,
                                     const std::vector<int>& support) {
  std::vector<int> best(index.num_frames(), 1);  // support of the best partner
  std::vector<int> support_of_frames;            // per pair of frames
  for (const FramePair& frames : index.frame_pairs()) {
    int sum = 0;
    for (const size_t i : frames.pair_idxs) {
      if (is_candidate[i] && frames.IsBetweenFrames()) sum += support[i];
    }
    support_of_frames.push_back(sum);
    best[frames.frame_idx1] = std::max(best[frames.frame_idx1], sum);
    best[frames.frame_idx2] = std::max(best[frames.frame_idx2], sum);
  }
  std::vector<double> strengths(index.num_pairs(), 0.0);
  for (size_t k = 0; k < index.frame_pairs().size(); ++k) {
    const FramePair& frames = index.frame_pairs()[k];
    const int smaller_best =
        std::min(best[frames.frame_idx1], best[frames.frame_idx2]);
    for (const size_t i : frames.pair_idxs) {
      if (!is_candidate[i] || support[i] == 0) continue;
      strengths[i] = static_cast<double>(support_of_frames[k]) / smaller_best;
    }
  }
  return strengths;
}

void SelectAll(const FramePairIndex& index,
               const std::vector<size_t>& pair_idxs, Skeleton* skeleton) {
  for (const size_t i : pair_idxs) skeleton->Select(i, index.Of(i));
}

// Erases the loops between two components that show another place than the
// strongest one.
void KeepStrongestPlaces(const FramePairIndex& index,
                         const std::vector<double>& strengths,
                         UnionFind* components,
                         std::vector<size_t>* pair_idxs) {
  if (!index.is_sequence()) return;
  const auto components_of = [&](const FramePair& frames) {
    return std::minmax({components->Find(frames.frame_idx1),
                        components->Find(frames.frame_idx2)});
  };
  std::map<std::pair<size_t, size_t>, size_t> strongest;
  for (const size_t i : *pair_idxs) {
    if (!index.IsLoop(index.Of(i))) continue;
    const auto [it, is_new] = strongest.emplace(components_of(index.Of(i)), i);
    if (!is_new && strengths[i] > strengths[it->second]) it->second = i;
  }
  EraseIf(pair_idxs, [&](size_t i) {
    const FramePair& a = index.Of(i);
    if (!index.IsLoop(a)) return false;
    const FramePair& b = index.Of(strongest.at(components_of(a)));
    return !(index.AreNear(a.frame_idx1, b.frame_idx1) &&
             index.AreNear(a.frame_idx2, b.frame_idx2)) &&
           !(index.AreNear(a.frame_idx1, b.frame_idx2) &&
             index.AreNear(a.frame_idx2, b.frame_idx1));
  });
}

// False if no pair with any strength leaves a component.
bool ConnectComponents(const FramePairIndex& index,
                       const std::vector<double>& strengths,
                       double min_connecting_strength, Skeleton* skeleton) {
  UnionFind& components = skeleton->components;
  std::vector<double> strongest(components.size(), 0.0);  // by representative
  for (size_t i = 0; i < strengths.size(); ++i) {
    const FramePair& frames = index.Of(i);
    if (skeleton->Connects(frames)) continue;
    for (const int frame : {frames.frame_idx1, frames.frame_idx2}) {
      double& max = strongest[components.Find(frame)];
      max = std::max(max, strengths[i]);
    }
  }
  std::vector<size_t> connecting;
  for (size_t i = 0; i < strengths.size(); ++i) {
    const FramePair& frames = index.Of(i);
    if (strengths[i] == 0.0 || skeleton->Connects(frames)) continue;
    const double weaker_max =
        std::min(strongest[components.Find(frames.frame_idx1)],
                 strongest[components.Find(frames.frame_idx2)]);
    if (strengths[i] >= min_connecting_strength * weaker_max) {
      connecting.push_back(i);
    }
  }
  KeepStrongestPlaces(index, strengths, &components, &connecting);
  SelectAll(index, connecting, skeleton);
  return !connecting.empty();
}

void SelectPairsBetweenFrames(const FramePairIndex& index,
                              const Mask& is_candidate,
                              const std::vector<int>& support,
                              const PairFilteringOptions& options,
                              Skeleton* skeleton) {
  const std::vector<double> strengths =
      ComputeStrengths(index, is_candidate, support);
  std::vector<size_t> strong;
  for (size_t i = 0; i < strengths.size(); ++i) {
    if (strengths[i] > options.min_strength &&
        !skeleton->Connects(index.Of(i))) {
      strong.push_back(i);
    }
  }
  KeepStrongestPlaces(index, strengths, &skeleton->components, &strong);
  SelectAll(index, strong, skeleton);
  while (ConnectComponents(index, strengths, options.min_connecting_strength,
                           skeleton)) {
  }
}

// The candidates of each round: in a sequence, first its neighbors only.
std::vector<Mask> CandidatesOfRounds(const FramePairIndex& index,
                                     const Mask& pair_is_used) {
  std::vector<Mask> rounds;
  if (index.is_sequence()) {
    for (const double share : kSharesOfReach) {
      Mask is_near = pair_is_used;
      for (size_t i = 0; i < is_near.size(); ++i) {
        const FramePair& frames = index.Of(i);
        if (!frames.time_gap ||
            *frames.time_gap > std::max<double>(kMaxNeighborGap,
                                                share * index.Reach(frames))) {
          is_near[i] = false;
        }
      }
      rounds.push_back(std::move(is_near));
    }
  }
  rounds.push_back(pair_is_used);
  return rounds;
}

}  // namespace

Mask SelectSkeletalGraph(const PairEvidence& evidence) {
  const auto& [scene, index, view_graph, pair_is_used, options, num_threads] =
      evidence;
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  std::vector<int> num_triplet_consistent;
  if (options.use_triplet_support) {
    num_triplet_consistent =
        CountTripletConsistentMatches(view_graph, pair_is_used, num_threads);
  }
  const std::vector<int> num_matches =
      Transformed(view_graph.pairs, [](const ImagePair& pair) {
        return static_cast<int>(pair.matches.size());
      });
  return SelectSkeletalGraph(index, num_matches, num_triplet_consistent,
                             pair_is_used, options);
}

Mask SelectSkeletalGraph(const FramePairIndex& index,
                         const std::vector<int>& num_matches,
                         const std::vector<int>& num_triplet_consistent,
                         const Mask& pair_is_used,
                         const PairFilteringOptions& options) {
  MGSFM_CHECK_EQ(index.num_pairs(), num_matches.size());
  MGSFM_CHECK_EQ(pair_is_used.size(), num_matches.size());
  Skeleton skeleton{Mask(pair_is_used.size(), false),
                    UnionFind(static_cast<size_t>(index.num_frames()))};
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    skeleton.is_selected[i] = pair_is_used[i] && !index.Of(i).IsBetweenFrames();
  }
  std::vector<std::vector<int>> supports;
  if (options.use_triplet_support) {
    MGSFM_CHECK_EQ(num_triplet_consistent.size(), num_matches.size());
    supports.push_back(num_triplet_consistent);
  }
  supports.push_back(num_matches);
  // A pair without known matches counts as one match.
  for (int& support : supports.back()) support = std::max(1, support);
  const std::vector<Mask> rounds = CandidatesOfRounds(index, pair_is_used);
  for (const std::vector<int>& support : supports) {
    for (size_t i = 0; i + 1 < rounds.size(); ++i) {
      SelectPairsBetweenFrames(index, rounds[i], support, options, &skeleton);
    }
  }
  for (const std::vector<int>& support : supports) {
    SelectPairsBetweenFrames(index, rounds.back(), support, options, &skeleton);
  }
  return skeleton.is_selected;
}

}  // namespace mgsfm
