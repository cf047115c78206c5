// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <vector>

#include "mgsfm/base/mask.h"
#include "rig_solver/block_pattern.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// A pair of blocks, weighted by the number of points that they share. There can
// be millions of them.
struct WeightedPair {
  int column = 0;
  int row = 0;
  int weight = 0;

  BlockPairKey Key() const { return MakeBlockPairKey(column, row); }
};

// The weight of pairs that are always kept.
constexpr int kInfiniteWeight = std::numeric_limits<int>::max();

// The strongest edges of a graph of blocks: for each block, the edges to the
// `num_kept` neighbors with the largest weights, and all edges of infinite
// weight. Ties prefer neighbors with a close index. O(n log n) in the pairs.
class PreconditionerPattern {
 public:
  // `pairs` are sorted and unique, without diagonal pairs.
  PreconditionerPattern(const std::vector<WeightedPair>& pairs, int num_blocks,
                        int num_kept);

  // Whether two blocks are equal or a strong pair. O(log num_kept).
  bool Contains(int a, int b) const;

 private:
  std::vector<std::vector<int>> neighbors_;  // per block, ascending
};

// Cuts points into parts, each observed only by images that share many points.
// The Schur complement of the parts has few blocks and is cheap to factorize;
// it is the preconditioner of the iterative solver (docs/maths/rig_solver.md).
// Terms of two images are cut in the same way. Border blocks are in all parts.
class PointPartitioner {
 public:
  // Counts the points and terms that two blocks share. `structure` must have
  // chunks without cuts and outlive this object. `inseparable` are pairs that
  // no cut may separate, sorted and unique. Linear in the observations and in
  // the pairs of blocks of chunks.
  PointPartitioner(bool points_are_free, const Mask& block_is_border,
                   const std::vector<BlockPairKey>& inseparable,
                   int num_threads, RigStructure* structure);

  // Cuts such that all blocks of a part are strong pairs for `num_kept`
  // neighbors. Sets observation_starts_part and term_is_cut, and sorts the
  // observations of points by part.
  void Cut(int num_kept);

 private:
  std::vector<WeightedPair> WeightsOfChunk(const ChunkRanges& chunk) const;
  void WeighPairs(const std::vector<BlockPairKey>& inseparable);
  bool IsStrong(const PreconditionerPattern& pattern, int a, int b) const {
    return block_is_border_[a] || block_is_border_[b] || pattern.Contains(a, b);
  }
  void CutPoint(const PreconditionerPattern& pattern, const ChunkRanges& chunk,
                size_t begin, size_t end);
  bool IsCut(const PreconditionerPattern& pattern, const ChunkRanges& chunk,
             size_t term) const;

  const bool points_are_free_;
  const Mask& block_is_border_;
  const int num_threads_;
  RigStructure& s_;
  std::vector<WeightedPair> weights_;
};

}  // namespace mgsfm
