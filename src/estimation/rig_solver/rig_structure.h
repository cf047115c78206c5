// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCore>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/base/mask.h"
#include "rig_solver/block_pattern.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_solver.h"

namespace mgsfm {

// The structure of the reduced system of a rig problem, and its partition into
// chunks: some thousand observations of nearby points, or baseline terms. A
// chunk affects few blocks of unknowns. Its contribution is accumulated in a
// small local system, which is then added to the global one. Chunks depend on
// the problem alone, so results do not depend on the number of threads.

// Marks constant or unused elements in arrays of block indices. The indices are
// dense ints because kernels read them for each observation.
constexpr int kNoBlock = -1;

// A range of positions in an array.
struct IndexRange {
  size_t begin = 0;
  size_t end = 0;
  size_t size() const { return end - begin; }
};

// An image in a chunk. Its blocks are positions in ChunkRanges::blocks, or
// kNoBlock.
struct ChunkImage {
  int image = 0;  // of the problem
  int frame = kNoBlock;
  int sensor = kNoBlock;
  int camera = kNoBlock;
};

// A nonzero block of the Schur complement: two blocks of unknowns of a chunk,
// row not before column in the elimination order. Column k of the block starts
// at position + k * stride in the values of the matrix. There can be millions
// of them.
struct ChunkPair {
  uint16_t row = 0;
  uint16_t column = 0;
  uint32_t stride = 0;
  uint32_t position = 0;  // Eigen counts values by int
};

struct ChunkRanges {
  IndexRange points;        // in RigStructure::point_order
  IndexRange observations;  // in RigStructure::observation_image
  IndexRange terms;         // in RigStructure::term_order
  IndexRange images;        // in RigStructure::chunk_images
  IndexRange blocks;  // in RigStructure::chunk_blocks, in elimination order
  IndexRange pairs;   // in RigStructure::chunk_pairs
};

// Computed once for all iterations. Linear in the observations and in the
// number of pairs of blocks that points connect.
struct RigStructure {
  // `image_of_observation` lists the images of the problem's observations.
  RigStructure(const RigProblemBase& problem,
               const std::vector<int>& image_of_observation,
               ReducedSolver solver, int num_threads);

  // Coordinates of a pose block: 6, or 3 if no rotation is free.
  int pose_size = 3;
  // Block indices, frames first; kNoBlock without unknowns or residuals.
  std::vector<int> frame_block;
  std::vector<int> sensor_block;
  std::vector<int> camera_block;
  std::vector<int> block_size;
  std::vector<int> block_rank;   // in the elimination order
  std::vector<int> block_first;  // position in the vector of unknowns
  int num_unknowns = 0;
  // Whether some coordinates of a pose block are constant.
  Mask block_is_masked;

  // The pattern of the Schur complement or, if the solver is iterative, of the
  // preconditioner, whose points are cut into parts and which lacks some terms.
  bool is_iterative = false;
  BlockPattern pattern;

  // Points in chunk order. The observations of a point are sorted by part, then
  // by frame.
  std::vector<int> point_order;
  std::vector<uint32_t> point_begin;        // in the new order
  std::vector<uint32_t> observation_order;  // may be cleared after use
  std::vector<uint16_t> observation_image;  // in the images of the chunk
  // Per observation: whether it begins a new part of its point. Empty if no
  // point is cut.
  Mask observation_starts_part;
  // Per term: whether its images are separated. Empty if no point is cut.
  Mask term_is_cut;
  std::vector<int> term_order;
  std::vector<std::array<int, 2>> term_images;  // in the images of the chunk

  std::vector<ChunkRanges> chunks;
  std::vector<ChunkImage> chunk_images;
  std::vector<int> chunk_blocks;
  std::vector<ChunkPair> chunk_pairs;
  // Maxima over all chunks.
  size_t max_num_images = 0;
  size_t max_num_blocks = 0;
  size_t max_num_unknowns = 0;
  size_t max_num_pair_values = 0;
  size_t max_num_image_values = 0;

 private:
  // Sets strides and positions of chunk_pairs.
  void PlacePairs();
};

}  // namespace mgsfm
