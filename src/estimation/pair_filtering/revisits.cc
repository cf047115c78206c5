// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/revisits.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "math/union_find.h"

namespace mgsfm {
namespace {

// The shortest revisit in reaches of pairs of neighbors: a structure is
// visible within one reach before and one after its frame.
// docs/results/constants.md has the lengths of revisits and of
// duplicate structures.
constexpr int kMinRevisit = 2;
// A share of the reach, which bridges missing images or matches.
constexpr double kMaxLoopGap = 0.3;

// The loop pairs of two frames, by their places in the sequences.
struct Loop {
  std::pair<int, int> sequences;
  int rank1 = 0;
  int rank2 = 0;
  int reach = 0;
  std::vector<size_t> pair_idxs;

  int MaxGap() const {
    return static_cast<int>(std::ceil(kMaxLoopGap * reach));
  }
};

struct Place {
  int sequence = 0;
  int rank = 0;
};

std::vector<Place> PlacesOf(const FramePairIndex& index) {
  std::vector<Place> places(index.num_frames());
  const auto& sequences = index.order()->sequences();
  for (size_t s = 0; s < sequences.size(); ++s) {
    for (size_t k = 0; k < sequences[s].size(); ++k) {
      places[sequences[s][k]] = {static_cast<int>(s), static_cast<int>(k)};
    }
  }
  return places;
}

// Sorted by sequences and first frame.
std::vector<Loop> CollectLoops(const FramePairIndex& index,
                               const Mask& pair_is_used) {
  const std::vector<Place> places = PlacesOf(index);
  std::vector<Loop> loops;
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    if (!index.IsLoop(frames)) continue;
    Place first = places[frames.frame_idx1], second = places[frames.frame_idx2];
    if (std::tie(first.sequence, first.rank) >
        std::tie(second.sequence, second.rank)) {
      std::swap(first, second);
    }
    const int reach = index.Reach(frames);
    if (frames.time_gap && *frames.time_gap <= kMinRevisit * reach) continue;
    Loop loop{
        {first.sequence, second.sequence}, first.rank, second.rank, reach, {}};
    for (const size_t i : frames.pair_idxs) {
      if (pair_is_used[i]) loop.pair_idxs.push_back(i);
    }
    if (!loop.pair_idxs.empty()) loops.push_back(std::move(loop));
  }
  std::sort(loops.begin(), loops.end(), [](const Loop& a, const Loop& b) {
    return std::tie(a.sequences, a.rank1, a.rank2) <
           std::tie(b.sequences, b.rank1, b.rank2);
  });
  return loops;
}

UnionFind JoinNeighbors(const std::vector<Loop>& loops) {
  UnionFind sets(loops.size());
  for (size_t i = 0; i < loops.size(); ++i) {
    for (size_t k = i + 1; k < loops.size(); ++k) {
      if (loops[k].sequences != loops[i].sequences ||
          loops[k].rank1 - loops[i].rank1 > loops[i].MaxGap()) {
        break;
      }
      if (std::abs(loops[k].rank2 - loops[i].rank2) <= loops[i].MaxGap()) {
        sets.Union(i, k);
      }
    }
  }
  return sets;
}

// The steps between the first and the last frame of one pass.
struct Extent {
  int first = std::numeric_limits<int>::max();
  int last = std::numeric_limits<int>::min();

  void Add(int rank) {
    first = std::min(first, rank);
    last = std::max(last, rank);
  }
  bool IsLong(int reach) const { return last - first > kMinRevisit * reach; }
};

}  // namespace

Mask FindRevisits(const FramePairIndex& index, const Mask& pair_is_used) {
  Mask is_revisit(pair_is_used.size(), false);
  if (!index.is_sequence()) return is_revisit;
  const std::vector<Loop> loops = CollectLoops(index, pair_is_used);
  UnionFind sets = JoinNeighbors(loops);
  std::vector<std::pair<Extent, Extent>> extents(loops.size());
  for (size_t i = 0; i < loops.size(); ++i) {
    auto& [first, second] = extents[sets.Find(i)];
    first.Add(loops[i].rank1);
    second.Add(loops[i].rank2);
  }
  for (size_t i = 0; i < loops.size(); ++i) {
    const auto& [first, second] = extents[sets.Find(i)];
    if (!first.IsLong(loops[i].reach) || !second.IsLong(loops[i].reach)) {
      continue;
    }
    for (const size_t pair_idx : loops[i].pair_idxs) {
      is_revisit[pair_idx] = true;
    }
  }
  return is_revisit;
}

}  // namespace mgsfm
