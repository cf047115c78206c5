// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <vector>

#include "base/parallel.h"
#include "mgsfm/base/mask.h"
#include "rig_solver/image_poses.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// The largest coupling of a block to a point: kMaxNumCameraParams x 3.
constexpr int kCouplingSize =
    Eigen::Vector3d::SizeAtCompileTime * kMaxNumCameraParams;

// Marks pairs of blocks that are not in the pattern; a dense int for the
// kernels.
constexpr int kNoPair = -1;

// An observation in a product with the Schur complement, or of a cut point: its
// derivatives, with J with respect to the point, and the change u of its
// residual. Rows have their own length.
struct ProductTerms {
  double y[3];
  double residual[3];
  double P[3 * 3];
  double K[3 * kMaxNumCameraParams];
  double J[3 * 3];
  double u[3];
};

// The local system of one chunk, with temporaries for its points. It contains
// the blocks of the chunk. Symmetric matrices are stored completely,
// column-major.
struct SchurWorkspace {
  explicit SchurWorkspace(const RigStructure& structure);

  // Sets the blocks and images of a chunk and clears vectors. Sufficient for
  // products with a vector.
  void StartVectors(const RigProblemBase& problem,
                    const RigStructure& structure, const ChunkRanges& chunk,
                    const std::vector<ImagePose>& poses);
  // The same, and sets the pairs and clears all sums.
  void Start(const RigProblemBase& problem, const RigStructure& structure,
             const ChunkRanges& chunk, const std::vector<ImagePose>& poses);

  double* Pair(int row, int column) {
    return pair_values.data() + pair_begin[row * num_blocks + column];
  }
  bool HasPair(int row, int column) const {
    return pair_begin[row * num_blocks + column] != kNoPair;
  }

  size_t num_blocks = 0;
  std::vector<int> block_size;
  std::vector<int> block_first;
  Mask block_is_masked;
  std::vector<double> block_mask;  // 6 per masked block
  std::vector<int> pair_begin;     // row-major, or kNoPair
  std::vector<double> pair_values;
  std::vector<double> gradient;    // J^T W r
  std::vector<double> correction;  // W^T V^-1 g_p
  std::vector<double> diagonal;    // of J^T W J
  std::vector<double> product;     // of the matrix with a vector

  // Per image: products of its columns [rotation, shift, free parameters] with
  // each other and with the residuals. Constant images have no columns.
  std::vector<int> image_num_columns;
  std::vector<size_t> image_hessian_begin;
  std::vector<double> image_hessians;
  std::vector<double> image_gradients;

  // The blocks of the current point, and its coupling W^T to each of them
  // (three columns).
  std::vector<int> met;
  size_t num_met = 0;
  std::vector<size_t> last_point;  // the last point of each block
  std::vector<double> couplings;   // kCouplingSize per block
  // The terms of the current point, if the solver is iterative.
  std::vector<ProductTerms> product_terms;
};

constexpr int kMaxNumImageColumns =
    PoseVector::SizeAtCompileTime + kMaxNumCameraParams;

// Adds the products of images to the local system. The adjoint of
// sensor_from_frame maps image columns to frame columns.
void AddImagesToSystem(const RigProblemBase& problem,
                       const RigStructure& structure, const ChunkRanges& chunk,
                       const std::vector<ImagePose>& poses,
                       SchurWorkspace* workspace);

// Adds the vectors of images to workspace->product.
void AddImageVectors(const RigProblemBase& problem,
                     const RigStructure& structure, const ChunkRanges& chunk,
                     const std::vector<ImagePose>& poses,
                     SchurWorkspace* workspace);

// Processes chunks in parallel and merges them in order, so that sums do not
// depend on the number of threads. Keeps one workspace per thread.
class OrderedChunks {
 public:
  OrderedChunks(const RigStructure& structure, int num_threads);

  // Calls compute(chunk, workspace) for all chunks in parallel, then
  // merge(chunk, section, workspace) for each section of the destination.
  // Within a section, chunks are merged in ascending order; different sections
  // are merged concurrently. compute must not throw.
  template <class Compute, class Merge>
  void Run(size_t num_sections, const Compute& compute, const Merge& merge);

 private:
  SchurWorkspace* Take();
  void PutBack(SchurWorkspace* workspace);
  void WaitForTurn(size_t chunk, size_t section);
  void FinishTurn(size_t section);

  const size_t num_chunks_;
  const int num_threads_;
  std::vector<SchurWorkspace> workspaces_;
  std::vector<SchurWorkspace*> free_;
  std::mutex mutex_;
  std::condition_variable next_chunk_changed_;
  std::vector<size_t> next_chunk_;  // per section
};

template <class Compute, class Merge>
void OrderedChunks::Run(size_t num_sections, const Compute& compute,
                        const Merge& merge) {
  next_chunk_.assign(num_sections, 0);
  ParallelFor(
      num_chunks_, num_threads_,
      [&](size_t chunk) {
        SchurWorkspace* workspace = Take();
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
