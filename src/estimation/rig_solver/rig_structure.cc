// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_structure.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/sparse_solver.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "rig_solver/chunk_builder.h"
#include "rig_solver/preconditioner_pattern.h"

namespace mgsfm {
namespace {

using Pairs = std::vector<BlockPairKey>;

int NumBlocks(const RigStructure& s) {
  return static_cast<int>(s.block_size.size());
}

BlockPairKey MakeSortedPair(int a, int b) {
  return MakeBlockPairKey(std::min(a, b), std::max(a, b));
}

// 6 if any rotation is free, otherwise 3.
int ChoosePoseSize(const RigProblemBase& problem) {
  const auto any_rotation_is_free = [](const std::vector<PoseMask>& masks) {
    return AnyOf(masks, [](const PoseMask& mask) {
      return !mask.head<3>().isZero(0.0);
    });
  };
  if (!any_rotation_is_free(problem.frame_masks) &&
      !any_rotation_is_free(problem.sensor_masks)) {
    return 3;
  }
  MGSFM_CHECK(problem.baselines.empty());
  MGSFM_CHECK(problem.held_cam_from_world.empty());
  return 6;
}

// Whether any residual depends on these elements of the problem.
struct UsedElements {
  Mask frames;
  Mask sensors;
  Mask cameras;
};

UsedElements FindUsedElements(const RigProblemBase& problem,
                              const std::vector<int>& image_of_observation) {
  Mask image_is_used(problem.images.size(), false);
  for (const int image : image_of_observation) image_is_used[image] = true;
  for (const BaselineTerm& term : problem.baselines) {
    image_is_used[term.image1] = image_is_used[term.image2] = true;
  }
  UsedElements used{Mask(problem.frame_masks.size(), false),
                    Mask(problem.sensor_masks.size(), false),
                    Mask(problem.cameras.size(), false)};
  for (size_t i = 0; i < image_is_used.size(); ++i) {
    if (!image_is_used[i]) continue;
    const RigProblemBase::Image& image = problem.images[i];
    used.frames[image.frame] = used.sensors[image.sensor] = true;
    if (image.camera >= 0) used.cameras[image.camera] = true;
  }
  for (const LinearTerm& term : problem.linear_terms) {
    for (const LinearTerm::Part& part : term.parts) {
      (part.is_frame ? used.frames : used.sensors)[part.idx] = true;
    }
  }
  return used;
}

int AddBlock(int size, RigStructure* s) {
  s->block_size.push_back(size);
  s->block_is_masked.push_back(false);
  return NumBlocks(*s) - 1;
}

std::vector<int> AddPoseBlocks(const Mask& is_used,
                               const std::vector<PoseMask>& masks,
                               RigStructure* s) {
  std::vector<int> blocks;
  for (size_t i = 0; i < masks.size(); ++i) {
    if (!is_used[i] || masks[i].isZero(0.0)) {
      blocks.push_back(kNoBlock);
      continue;
    }
    blocks.push_back(AddBlock(s->pose_size, s));
    s->block_is_masked[blocks.back()] =
        (masks[i].tail(s->pose_size).array() == 0.0).any();
  }
  return blocks;
}

void NumberBlocks(const RigProblemBase& problem,
                  const std::vector<int>& image_of_observation,
                  RigStructure* s) {
  const UsedElements used = FindUsedElements(problem, image_of_observation);
  s->frame_block = AddPoseBlocks(used.frames, problem.frame_masks, s);
  s->sensor_block = AddPoseBlocks(used.sensors, problem.sensor_masks, s);
  for (size_t i = 0; i < problem.cameras.size(); ++i) {
    const int size = static_cast<int>(problem.cameras[i].free_params.size());
    s->camera_block.push_back(used.cameras[i] && size > 0 ? AddBlock(size, s)
                                                          : kNoBlock);
  }
  s->num_unknowns =
      std::accumulate(s->block_size.begin(), s->block_size.end(), 0);
}

// The blocks that are eliminated last.
Mask ChooseBorder(const RigProblemBase& problem, const RigStructure& s) {
  std::vector<int> num_images(NumBlocks(s), 0);
  for (size_t i = 0; i < problem.images.size(); ++i) {
    const ImageBlockIndices blocks =
        BlocksOfImage(problem, s, static_cast<int>(i));
    for (const int block : {blocks.sensor, blocks.camera}) {
      if (block != kNoBlock) ++num_images[block];
    }
  }
  std::vector<int> candidates;
  int size = 0;
  for (const std::vector<int>* blocks : {&s.sensor_block, &s.camera_block}) {
    for (const int block : *blocks) {
      if (block == kNoBlock) continue;
      candidates.push_back(block);
      size += s.block_size[block];
    }
  }
  Mask is_border(NumBlocks(s), false);
  for (const int block : candidates) {
    // Extrinsics and intrinsics are eliminated last if all of them together are
    // small, or if each is connected to many frames. This affects only fill-in.
    is_border[block] = size <= 200 || num_images[block] >= 64;
  }
  return is_border;
}

// The connected pairs of blocks of a chunk, by their positions in the chunk.
Pairs PairsOfChunk(const RigStructure& s, const ChunkRanges& chunk,
                   bool points_are_free) {
  const size_t num_blocks = chunk.blocks.size();
  Mask is_met(num_blocks * num_blocks, false);
  const auto add = [&](const std::vector<int>& met) {
    for (const int a : met) {
      for (const int b : met) is_met[a * num_blocks + b] = true;
    }
  };
  ForEachGroup(s, chunk, points_are_free, add);
  Pairs pairs;
  for (size_t a = 0; a < num_blocks; ++a) {
    for (size_t b = 0; b <= a; ++b) {
      if (!is_met[a * num_blocks + b]) continue;
      pairs.push_back(
          MakeBlockPairKey(static_cast<int>(b), static_cast<int>(a)));
    }
  }
  return pairs;
}

std::vector<Pairs> PairsOfChunks(const RigStructure& s, bool points_are_free,
                                 int num_threads) {
  std::vector<Pairs> pairs(s.chunks.size());
  ParallelFor(
      s.chunks.size(), num_threads,
      [&](size_t c) {
        pairs[c] = PairsOfChunk(s, s.chunks[c], points_are_free);
      },
      1);
  return pairs;
}

// Calls function(a, b) for all pairs of blocks that linear terms or priors
// connect.
template <class Function>
void ForEachPairOfTerms(const RigProblemBase& problem, const RigStructure& s,
                        const Function& function) {
  const auto block_of = [&](const LinearTerm::Part& part) {
    return (part.is_frame ? s.frame_block : s.sensor_block)[part.idx];
  };
  for (const LinearTerm& term : problem.linear_terms) {
    for (const LinearTerm::Part& a : term.parts) {
      for (const LinearTerm::Part& b : term.parts) {
        if (block_of(a) != kNoBlock && block_of(b) != kNoBlock) {
          function(block_of(a), block_of(b));
        }
      }
    }
  }
  const auto visit_poses_of = [&](int image) {
    const ImageBlockIndices blocks = BlocksOfImage(problem, s, image);
    if (blocks.frame != kNoBlock && blocks.sensor != kNoBlock) {
      function(blocks.frame, blocks.sensor);
    }
  };
  for (const PositionPrior& prior : problem.position_priors) {
    visit_poses_of(prior.image);
  }
  for (const GravityPrior& prior : problem.gravity_priors) {
    visit_poses_of(prior.image);
  }
}

// All pairs of blocks in the Schur complement, sorted.
Pairs UnitePairs(const RigProblemBase& problem, const RigStructure& s,
                 const Mask& is_border,
                 const std::vector<Pairs>& pairs_of_chunks) {
  Pairs all;
  const auto add = [&all](int a, int b) {
    all.push_back(MakeSortedPair(a, b));
  };
  for (size_t c = 0; c < s.chunks.size(); ++c) {
    const int* blocks = s.chunk_blocks.data() + s.chunks[c].blocks.begin;
    for (const BlockPairKey pair : pairs_of_chunks[c]) {
      add(blocks[ColumnOf(pair)], blocks[RowOf(pair)]);
    }
  }
  ForEachPairOfTerms(problem, s, add);
  for (int a = 0; a < NumBlocks(s); ++a) {
    add(a, a);
    if (!is_border[a]) continue;
    for (int b = 0; b < a; ++b) {
      if (is_border[b]) add(a, b);
    }
  }
  SortUnique(&all);
  return all;
}

// The elimination order of the blocks outside the border, as a graph with one
// node per block.
EliminationOrder OrderGraph(const RigStructure& s, const Mask& is_border,
                            const Pairs& pairs) {
  std::vector<std::optional<int>> node_of_block(NumBlocks(s));
  std::vector<int> block_of_node;
  for (int b = 0; b < NumBlocks(s); ++b) {
    if (is_border[b]) continue;
    node_of_block[b] = static_cast<int>(block_of_node.size());
    block_of_node.push_back(b);
  }
  Pairs node_pairs;
  for (const BlockPairKey pair : pairs) {
    const auto column = node_of_block[ColumnOf(pair)];
    const auto row = node_of_block[RowOf(pair)];
    if (column && row) node_pairs.push_back(MakeBlockPairKey(*column, *row));
  }
  EliminationOrder order = FindEliminationOrder(
      BlockPattern(std::vector<int>(block_of_node.size(), 1), node_pairs)
          .MakeMatrix());
  for (int& position : order.order) position = block_of_node[position];
  return order;
}

bool IsAffordable(const EliminationOrder& order, int pose_size,
                  size_t num_observations) {
  const double size = pose_size;
  // The largest factor of the direct solver: 1.6 GB, and as many operations as
  // one core does in 0.1 s, or about those of 17 products per step
  // (docs/results/constants.md).
  const double affordable =
      std::max(4e9, 2e4 * static_cast<double>(num_observations));
  return order.num_factor_entries * size * size <= 2e8 &&
         order.num_flops * size * size * size <= affordable;
}

// The pairs of blocks of one image or prior that no cut may separate, without
// border blocks.
Pairs InseparablePairs(const RigProblemBase& problem, const RigStructure& s,
                       const Mask& is_border) {
  Pairs pairs;
  const auto add = [&](int a, int b) {
    if (a == kNoBlock || b == kNoBlock || a == b) return;
    if (is_border[a] || is_border[b]) return;
    pairs.push_back(MakeSortedPair(a, b));
  };
  ForEachPairOfTerms(problem, s, add);
  for (size_t i = 0; i < problem.images.size(); ++i) {
    const ImageBlockIndices blocks =
        BlocksOfImage(problem, s, static_cast<int>(i));
    add(blocks.frame, blocks.sensor);
    add(blocks.frame, blocks.camera);
    add(blocks.sensor, blocks.camera);
  }
  SortUnique(&pairs);
  return pairs;
}

// The Schur complement before its blocks are ordered.
struct ReducedGraph {
  std::vector<Pairs> pairs_of_chunks;
  Pairs pairs;
  EliminationOrder order;
};

ReducedGraph MakeGraph(const RigProblemBase& problem, const RigStructure& s,
                       const Mask& is_border, int num_threads) {
  ReducedGraph graph;
  graph.pairs_of_chunks =
      PairsOfChunks(s, problem.points_are_free, num_threads);
  graph.pairs = UnitePairs(problem, s, is_border, graph.pairs_of_chunks);
  graph.order = OrderGraph(s, is_border, graph.pairs);
  return graph;
}

// Cuts points until the factor of the preconditioner is affordable.
ReducedGraph MakePreconditionerGraph(const RigProblemBase& problem,
                                     const Mask& is_border,
                                     size_t num_observations, int num_threads,
                                     RigStructure* s) {
  PointPartitioner cutter(problem.points_are_free, is_border,
                          InseparablePairs(problem, *s, is_border), num_threads,
                          s);
  // Neighbors per block in the first preconditioner. Their number is halved
  // whenever the factor is too large.
  for (int num_kept = 64;; num_kept /= 2) {
    cutter.Cut(num_kept);
    ReducedGraph graph = MakeGraph(problem, *s, is_border, num_threads);
    if (num_kept == 0 ||
        IsAffordable(graph.order, s->pose_size, num_observations)) {
      return graph;
    }
  }
}

// Sets block_rank, block_first and pattern.
void PlaceBlocks(const Mask& is_border, ReducedGraph graph, RigStructure* s) {
  std::vector<int>& order = graph.order.order;
  for (int b = 0; b < NumBlocks(*s); ++b) {
    if (is_border[b]) order.push_back(b);
  }
  s->block_rank.resize(NumBlocks(*s));
  s->block_first.resize(NumBlocks(*s));
  std::vector<int> sizes;
  int first = 0;
  for (const int block : order) {
    s->block_rank[block] = static_cast<int>(sizes.size());
    s->block_first[block] = first;
    sizes.push_back(s->block_size[block]);
    first += sizes.back();
  }
  for (BlockPairKey& pair : graph.pairs) {
    pair = MakeSortedPair(s->block_rank[ColumnOf(pair)],
                          s->block_rank[RowOf(pair)]);
  }
  std::sort(graph.pairs.begin(), graph.pairs.end());
  s->pattern = BlockPattern(sizes, graph.pairs);
}

// Sorts the blocks of a chunk by their elimination order. Returns the new
// position of each.
std::vector<int> SortBlocksOfChunk(const ChunkRanges& chunk, RigStructure* s) {
  const size_t num_blocks = chunk.blocks.size();
  int* blocks = s->chunk_blocks.data() + chunk.blocks.begin;
  std::vector<int> order = Indices(num_blocks), position(num_blocks);
  SortBy(&order, [&](int a) { return s->block_rank[blocks[a]]; });
  std::vector<int> sorted;
  size_t num_unknowns = 0;
  for (size_t k = 0; k < num_blocks; ++k) {
    position[order[k]] = static_cast<int>(k);
    sorted.push_back(blocks[order[k]]);
    num_unknowns += s->block_size[sorted.back()];
  }
  std::copy(sorted.begin(), sorted.end(), blocks);
  s->max_num_unknowns = std::max(s->max_num_unknowns, num_unknowns);
  return position;
}

// Sorts the blocks of a chunk and adds its pairs.
void PlaceChunk(Pairs pairs, ChunkRanges* chunk, RigStructure* s) {
  const std::vector<int> position = SortBlocksOfChunk(*chunk, s);
  for (size_t i = chunk->images.begin; i < chunk->images.end; ++i) {
    ChunkImage& image = s->chunk_images[i];
    for (int* block : {&image.frame, &image.sensor, &image.camera}) {
      if (*block != kNoBlock) *block = position[*block];
    }
  }
  for (BlockPairKey& pair : pairs) {
    pair = MakeSortedPair(position[ColumnOf(pair)], position[RowOf(pair)]);
  }
  std::sort(pairs.begin(), pairs.end());
  const int* blocks = s->chunk_blocks.data() + chunk->blocks.begin;
  chunk->pairs.begin = s->chunk_pairs.size();
  size_t num_values = 0;
  // A chunk has a dense table of its blocks, so there must be few.
  MGSFM_CHECK_LE(chunk->blocks.size(), size_t{1} << 16);
  for (const BlockPairKey pair : pairs) {
    const int column = blocks[ColumnOf(pair)], row = blocks[RowOf(pair)];
    s->chunk_pairs.push_back({static_cast<uint16_t>(RowOf(pair)),
                              static_cast<uint16_t>(ColumnOf(pair))});
    num_values +=
        static_cast<size_t>(s->block_size[column]) * s->block_size[row];
  }
  chunk->pairs.end = s->chunk_pairs.size();
  s->max_num_pair_values = std::max(s->max_num_pair_values, num_values);
}

}  // namespace

RigStructure::RigStructure(const RigProblemBase& problem,
                           const std::vector<int>& image_of_observation,
                           ReducedSolver solver, int num_threads) {
  // 32-bit observation indices save memory.
  MGSFM_CHECK_LT(image_of_observation.size(), size_t{1} << 32);
  pose_size = ChoosePoseSize(problem);
  NumberBlocks(problem, image_of_observation, this);
  const Mask is_border = ChooseBorder(problem, *this);
  BuildChunks(problem, image_of_observation, num_threads, this);
  const size_t num_observations = image_of_observation.size();
  ReducedGraph graph;
  is_iterative = solver == ReducedSolver::kIterative;
  if (!is_iterative) {
    graph = MakeGraph(problem, *this, is_border, num_threads);
    is_iterative = solver == ReducedSolver::kAuto &&
                   !IsAffordable(graph.order, pose_size, num_observations);
  }
  if (is_iterative) {
    graph = ReducedGraph();  // frees its memory
    graph = MakePreconditionerGraph(problem, is_border, num_observations,
                                    num_threads, this);
  }
  std::vector<Pairs> pairs_of_chunks = std::move(graph.pairs_of_chunks);
  PlaceBlocks(is_border, std::move(graph), this);
  size_t num_pairs = 0;
  for (const Pairs& of_chunk : pairs_of_chunks) num_pairs += of_chunk.size();
  chunk_pairs.reserve(num_pairs);
  for (size_t c = 0; c < chunks.size(); ++c) {
    PlaceChunk(std::move(pairs_of_chunks[c]), &chunks[c], this);
  }
  PlacePairs();
}

void RigStructure::PlacePairs() {
  for (const ChunkRanges& chunk : chunks) {
    const int* blocks = chunk_blocks.data() + chunk.blocks.begin;
    for (size_t i = chunk.pairs.begin; i < chunk.pairs.end; ++i) {
      ChunkPair& pair = chunk_pairs[i];
      const auto [position, stride] = pattern.Find(
          block_rank[blocks[pair.column]], block_rank[blocks[pair.row]]);
      MGSFM_CHECK_LT(position, size_t{1} << 32);
      pair.position = static_cast<uint32_t>(position);
      pair.stride = static_cast<uint32_t>(stride);
    }
  }
}

}  // namespace mgsfm
