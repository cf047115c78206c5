// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCore>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "least_squares/block_pattern.h"
#include "least_squares/rig_problem.h"
#include "least_squares/rig_solver.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// Work on a rig problem is split into chunks: some thousand observations of
// points that lie close together, or baseline terms. What a chunk adds to the
// reduced system concerns few blocks of unknowns and is summed up in a small
// local system first, which is then added to the common one. Chunks depend on
// the problem alone, so no result depends on the number of threads.

// A run of positions in an array.
struct IndexRange {
  size_t begin = 0;
  size_t end = 0;
  size_t size() const { return end - begin; }
};

// An image in a chunk, with its blocks of unknowns as positions in
// ChunkRanges::blocks; -1: held.
struct ChunkImage {
  int image = 0;  // of the problem
  int frame = -1;
  int sensor = -1;
  int camera = -1;
};

// Two blocks of a chunk that meet in the reduced matrix, row not before column
// in the order of elimination, and where in its values: column k of the pair
// starts at position + k stride.
struct ChunkPair {
  int row = 0;
  int column = 0;
  int stride = 0;
  size_t position = 0;
};

struct ChunkRanges {
  IndexRange points;        // in RigStructure::point_order
  IndexRange observations;  // in RigStructure::observation_image
  IndexRange terms;         // in RigStructure::term_order
  IndexRange images;        // in RigStructure::chunk_images
  IndexRange blocks;        // in RigStructure::chunk_blocks, as eliminated
  IndexRange pairs;         // in RigStructure::chunk_pairs
};

// Which unknowns meet where: made once for all iterations. Linear in the
// observations and in the number of pairs of blocks that points connect.
struct RigStructure {
  // `image_of_observation` is that of the problem's observations; it becomes
  // observation_image.
  RigStructure(const RigProblemBase& problem,
               const std::vector<int>& image_of_observation,
               ReducedSolver solver, int num_threads);

  // Coordinates of a pose in its block: 6, or 3 if no rotation is free.
  int pose_size = 3;
  // Blocks, -1 where there are no unknowns or no residuals; frames first.
  std::vector<int> frame_block;
  std::vector<int> sensor_block;
  std::vector<int> camera_block;
  std::vector<int> block_size;
  std::vector<int> block_rank;   // in the order of elimination
  std::vector<int> block_first;  // position in the vector of unknowns
  int num_unknowns = 0;
  // Per block of a pose: its mask is not all ones.
  Mask block_is_masked;

  // The reduced matrix; if the solution is iterative, that of the problem whose
  // points are cut into parts and which lacks some of the terms.
  bool is_iterative = false;
  BlockPattern pattern;

  // Points, with the observations of each by part, then by frame.
  std::vector<int> point_order;
  std::vector<size_t> point_begin;          // in the new order
  std::vector<uint32_t> observation_order;  // may be cleared after use
  std::vector<int> observation_image;       // in the images of the chunk
  // Of each observation: whether it begins a part of its point, the first left
  // out. Empty if no point is cut.
  Mask observation_starts_part;
  // Of each term: whether its images are apart. Empty if no point is cut.
  Mask term_is_cut;
  std::vector<int> term_order;
  std::vector<std::array<int, 2>> term_images;  // in the images of the chunk

  std::vector<ChunkRanges> chunks;
  std::vector<ChunkImage> chunk_images;
  std::vector<int> chunk_blocks;
  std::vector<ChunkPair> chunk_pairs;
  // The largest of any chunk.
  size_t max_num_images = 0;
  size_t max_num_blocks = 0;
  size_t max_num_unknowns = 0;
  size_t max_num_pair_values = 0;
  size_t max_num_image_values = 0;
};

}  // namespace mgsfm
