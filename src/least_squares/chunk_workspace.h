// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <vector>

#include "base/parallel.h"
#include "least_squares/image_poses.h"
#include "least_squares/rig_structure.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// The most that a block couples to a point: kMaxNumCameraParams x 3.
constexpr int kCouplingSize = 3 * kMaxNumCameraParams;

// The local system of one chunk at a time, with the arrays its points need.
// Blocks are those of the chunk; symmetric matrices are stored as a whole,
// column by column.
struct ChunkWorkspace {
  explicit ChunkWorkspace(const RigStructure& structure);

  // Takes the blocks and images of a chunk, with zeros for vectors; what
  // products with a vector need.
  void StartVectors(const RigProblemBase& problem,
                    const RigStructure& structure, const ChunkRanges& chunk,
                    const std::vector<ImagePose>& poses);
  // The pairs as well, with zeros for all sums.
  void Start(const RigProblemBase& problem, const RigStructure& structure,
             const ChunkRanges& chunk, const std::vector<ImagePose>& poses);

  double* Pair(int row, int column) {
    return pair_values.data() + pair_begin[row * num_blocks + column];
  }
  bool HasPair(int row, int column) const {
    return pair_begin[row * num_blocks + column] >= 0;
  }

  size_t num_blocks = 0;
  std::vector<int> block_size;
  std::vector<int> block_first;
  Mask block_is_masked;
  std::vector<double> block_mask;  // 6 for each block, if it is masked
  std::vector<int> pair_begin;     // row major; -1: not kept
  std::vector<double> pair_values;
  std::vector<double> gradient;    // J^T W r
  std::vector<double> correction;  // what points add to minus the gradient
  std::vector<double> diagonal;    // of J^T W J
  std::vector<double> product;     // of the matrix with a vector

  // Per image: products of its columns [turn, shift, free parameters], and
  // with the residuals. Images with nothing free have no columns.
  std::vector<int> image_num_columns;
  std::vector<size_t> image_hessian_begin;
  std::vector<double> image_hessians;
  std::vector<double> image_gradients;

  // Of one point: the blocks it meets, and what couples it to each; three
  // columns, one after the other.
  std::vector<int> met;
  size_t num_met = 0;
  std::vector<size_t> last_point;  // that met the block
  std::vector<double> couplings;   // kCouplingSize for each block
};

constexpr int kMaxNumImageColumns = 6 + kMaxNumCameraParams;

// Adds the products of images to the local system: to that of sensors and
// cameras directly, to that of frames by how these move the images.
void AddImagesToSystem(const RigProblemBase& problem,
                       const RigStructure& structure, const ChunkRanges& chunk,
                       const std::vector<ImagePose>& poses,
                       ChunkWorkspace* workspace);

// Adds sums over images alone, products of columns with a vector, to
// workspace->product.
void AddImageVectors(const RigProblemBase& problem,
                     const RigStructure& structure, const ChunkRanges& chunk,
                     const std::vector<ImagePose>& poses,
                     ChunkWorkspace* workspace);

// Workspaces of threads, and gates that let the chunks through in order. Chunks
// must be handed out in ascending order.
class OrderedChunks {
 public:
  OrderedChunks(const RigStructure& structure, int num_threads);

  // Calls compute(chunk, workspace) for all chunks in parallel, and
  // merge(chunk, section, workspace) for the sections of what they are merged
  // to: in each section for one chunk after the other, while other threads are
  // in other sections. compute must not throw.
  template <class Compute, class Merge>
  void Run(size_t num_sections, const Compute& compute, const Merge& merge);

 private:
  ChunkWorkspace* Take();
  void PutBack(ChunkWorkspace* workspace);
  void WaitForTurn(size_t chunk, size_t section);
  void FinishTurn(size_t section);

  const size_t num_chunks_;
  const int num_threads_;
  std::vector<ChunkWorkspace> workspaces_;
  std::vector<ChunkWorkspace*> free_;
  std::mutex mutex_;
  std::condition_variable turn_changed_;
  std::vector<size_t> turns_;  // the next chunk, per section
};

template <class Compute, class Merge>
void OrderedChunks::Run(size_t num_sections, const Compute& compute,
                        const Merge& merge) {
  turns_.assign(num_sections, 0);
  ParallelFor(
      num_chunks_, num_threads_,
      [&](size_t chunk) {
        ChunkWorkspace* workspace = Take();
        compute(chunk, workspace);
        for (size_t section = 0; section < num_sections; ++section) {
          WaitForTurn(chunk, section);
          merge(chunk, section, workspace);
          FinishTurn(section);
        }
        PutBack(workspace);
      },
      1);
}

}  // namespace mgsfm
