// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/preconditioner_pattern.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "mgsfm/base/mask.h"
#include "rig_solver/chunk_builder.h"

namespace mgsfm {

PreconditionerPattern::PreconditionerPattern(
    const std::vector<WeightedPair>& pairs, int num_blocks, int num_kept)
    : neighbors_(num_blocks) {
  struct Neighbor {
    int block;
    int weight;
  };
  std::vector<std::vector<Neighbor>> all(num_blocks);
  for (const WeightedPair& pair : pairs) {
    const int a = pair.column, b = pair.row;
    all[a].push_back({b, pair.weight});
    all[b].push_back({a, pair.weight});
  }
  for (int a = 0; a < num_blocks; ++a) {
    const auto key = [a](const Neighbor& n) {
      return std::make_tuple(-n.weight, std::abs(n.block - a), n.block);
    };
    SortBy(&all[a], key);
    for (size_t i = 0; i < all[a].size(); ++i) {
      const auto [b, weight] = all[a][i];
      if (i >= static_cast<size_t>(num_kept) && weight != kInfiniteWeight) {
        break;
      }
      neighbors_[a].push_back(b);
      neighbors_[b].push_back(a);
    }
  }
  for (std::vector<int>& blocks : neighbors_) {
    SortUnique(&blocks);
  }
}

bool PreconditionerPattern::Contains(int a, int b) const {
  return a == b ||
         std::binary_search(neighbors_[a].begin(), neighbors_[a].end(), b);
}

namespace {

// Chunks repeat each other's pairs. Summing the pairs of a few chunks at a time
// needs far less memory than storing all pairs.
constexpr size_t kNumChunksAtATime = 8;

bool IsBefore(const WeightedPair& a, const WeightedPair& b) {
  return a.Key() < b.Key();
}

// Replaces equal neighbors by their sum.
void SumEqualPairs(std::vector<WeightedPair>* weights) {
  size_t num_sums = 0;
  for (const WeightedPair weight : *weights) {
    if (num_sums == 0 || (*weights)[num_sums - 1].Key() != weight.Key()) {
      (*weights)[num_sums++] = weight;
      continue;
    }
    int& sum = (*weights)[num_sums - 1].weight;
    sum += std::min(weight.weight, kInfiniteWeight - sum);
  }
  weights->resize(num_sums);
}

// Moves weights into sorted sums.
void AddWeights(std::vector<WeightedPair>* added,
                std::vector<WeightedPair>* sums) {
  std::sort(added->begin(), added->end(), IsBefore);
  SumEqualPairs(added);
  const auto middle = sums->insert(sums->end(), added->begin(), added->end());
  std::inplace_merge(sums->begin(), middle, sums->end(), IsBefore);
  SumEqualPairs(sums);
  added->clear();
}

}  // namespace

PointPartitioner::PointPartitioner(bool points_are_free,
                                   const Mask& block_is_border,
                                   const std::vector<BlockPairKey>& inseparable,
                                   int num_threads, RigStructure* structure)
    : points_are_free_(points_are_free),
      block_is_border_(block_is_border),
      num_threads_(num_threads),
      s_(*structure) {
  WeighPairs(inseparable);
}

// The number of groups that two blocks share. Ignores border blocks.
std::vector<WeightedPair> PointPartitioner::WeightsOfChunk(
    const ChunkRanges& chunk) const {
  const size_t num_blocks = chunk.blocks.size();
  const int* blocks = s_.chunk_blocks.data() + chunk.blocks.begin;
  std::vector<int> count(num_blocks * num_blocks, 0);
  const auto add = [&](const std::vector<int>& met) {
    for (const int a : met) {
      for (const int b : met) ++count[a * num_blocks + b];
    }
  };
  ForEachGroup(s_, chunk, points_are_free_, add);
  std::vector<WeightedPair> weights;
  for (size_t i = 0; i < num_blocks; ++i) {
    for (size_t k = 0; k < i; ++k) {
      const int a = std::min(blocks[i], blocks[k]);
      const int b = std::max(blocks[i], blocks[k]);
      if (count[i * num_blocks + k] == 0 || block_is_border_[a] ||
          block_is_border_[b]) {
        continue;
      }
      weights.push_back({a, b, count[i * num_blocks + k]});
    }
  }
  return weights;
}

// Sums the weights over all chunks.
void PointPartitioner::WeighPairs(
    const std::vector<BlockPairKey>& inseparable) {
  std::vector<WeightedPair> added =
      Transformed(inseparable, [&](BlockPairKey pair) {
        return WeightedPair{ColumnOf(pair), RowOf(pair), kInfiniteWeight};
      });
  for (size_t first = 0; first < s_.chunks.size(); first += kNumChunksAtATime) {
    std::vector<std::vector<WeightedPair>> of_chunks(
        std::min(kNumChunksAtATime, s_.chunks.size() - first));
    ParallelFor(
        of_chunks.size(), num_threads_,
        [&](size_t c) { of_chunks[c] = WeightsOfChunk(s_.chunks[first + c]); },
        1);
    for (const std::vector<WeightedPair>& weights : of_chunks) {
      added.insert(added.end(), weights.begin(), weights.end());
    }
    // A merge is linear in the number of sums. It waits until new pairs reach
    // this fraction of them, to limit both time and memory.
    if (4 * added.size() > weights_.size()) {
      AddWeights(&added, &weights_);
    }
  }
  AddWeights(&added, &weights_);
  weights_.shrink_to_fit();
}

void PointPartitioner::Cut(int num_kept) {
  const PreconditionerPattern pattern(
      weights_, static_cast<int>(s_.block_size.size()), num_kept);
  s_.observation_starts_part.assign(s_.observation_image.size(), false);
  s_.term_is_cut.assign(s_.term_images.size(), false);
  const auto cut_chunk = [&](size_t c) {
    const ChunkRanges& chunk = s_.chunks[c];
    for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
      if (!points_are_free_) break;
      CutPoint(pattern, chunk, s_.point_begin[p], s_.point_begin[p + 1]);
    }
    for (size_t t = chunk.terms.begin; t < chunk.terms.end; ++t) {
      s_.term_is_cut[t] = IsCut(pattern, chunk, t);
    }
  };
  ParallelFor(s_.chunks.size(), num_threads_, cut_chunk, 1);
}

// Adds each observation to the first part whose blocks all are strong pairs
// with its blocks.
void PointPartitioner::CutPoint(const PreconditionerPattern& pattern,
                                const ChunkRanges& chunk, size_t begin,
                                size_t end) {
  struct Part {
    std::vector<int> blocks;
    std::vector<std::pair<uint32_t, uint16_t>> observations;  // order, image
  };
  std::vector<Part> parts;
  for (size_t k = begin; k < end; ++k) {
    const ChunkImage& image =
        s_.chunk_images[chunk.images.begin + s_.observation_image[k]];
    std::vector<int> blocks;
    for (const int position : {image.frame, image.sensor, image.camera}) {
      if (position == kNoBlock) continue;
      const int block = s_.chunk_blocks[chunk.blocks.begin + position];
      if (!block_is_border_[block]) blocks.push_back(block);
    }
    const auto fits = [&](const Part& part) {
      return AllOf(blocks, [&](int a) {
        return AllOf(part.blocks,
                     [&](int b) { return IsStrong(pattern, a, b); });
      });
    };
    auto part = std::find_if(parts.begin(), parts.end(), fits);
    if (part == parts.end()) part = parts.insert(part, Part());
    part->blocks.insert(part->blocks.end(), blocks.begin(), blocks.end());
    part->observations.emplace_back(s_.observation_order[k],
                                    s_.observation_image[k]);
  }
  size_t k = begin;
  for (const Part& part : parts) {
    s_.observation_starts_part[k] = k > begin;
    for (const auto& [order, image] : part.observations) {
      s_.observation_order[k] = order;
      s_.observation_image[k++] = image;
    }
  }
}

bool PointPartitioner::IsCut(const PreconditionerPattern& pattern,
                             const ChunkRanges& chunk, size_t term) const {
  const int* blocks = s_.chunk_blocks.data() + chunk.blocks.begin;
  const ChunkImage& image1 =
      s_.chunk_images[chunk.images.begin + s_.term_images[term][0]];
  const ChunkImage& image2 =
      s_.chunk_images[chunk.images.begin + s_.term_images[term][1]];
  for (const int a : {image1.frame, image1.sensor}) {
    for (const int b : {image2.frame, image2.sensor}) {
      if (a == kNoBlock || b == kNoBlock) continue;
      if (!IsStrong(pattern, blocks[a], blocks[b])) return true;
    }
  }
  return false;
}

}  // namespace mgsfm
