// SPDX-License-Identifier: BSD-3-Clause
#include "solver/pass_cost.h"

#include <algorithm>
#include <vector>

namespace mgsfm {
namespace {

constexpr double kDim = 2.0;
constexpr double kTransform = 3.0 + 15.0 + 3.0;    // x = S R (p - c) + t
constexpr double kTimesMatrix = kDim * 3.0 * 5.0;  // kDim rows by 3 x 3
constexpr double kCrossProducts = kDim * 3.0 * 3.0;
constexpr double kSquaredNorm = 2.0 * kDim;
constexpr double kFactorPoint = 30.0;
constexpr double kSolveTriangle = 9.0;

// The product of two matrices of kDim rows, rows^T rows.
constexpr double Product(double rows, double columns) {
  return 2.0 * kDim * rows * columns;
}

// V and g of a point.
constexpr double kSums = Product(3.0, 3.0) * 2.0 / 3.0 + Product(3.0, 1.0);

class Counter {
 public:
  Counter(const RigProblemBase& problem, const RigStructure& structure)
      : problem_(problem), s_(structure) {}

  PassCost Run() {
    for (const ChunkRanges& chunk : s_.chunks) {
      for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
        AddPoint(chunk, p);
      }
    }
    return cost_;
  }

 private:
  void AddPoint(const ChunkRanges& chunk, size_t p) {
    blocks_.clear();
    for (size_t k = s_.point_begin[p]; k < s_.point_begin[p + 1]; ++k) {
      AddObservation(
          chunk, s_.chunk_images[chunk.images.begin + s_.observation_image[k]]);
    }
    const double num = static_cast<double>(s_.point_begin[p + 1]) -
                       static_cast<double>(s_.point_begin[p]);
    // Pixel and image of each observation; position and first observation of
    // each point.
    constexpr double kObservation = 2.0 * sizeof(float) + sizeof(int);
    constexpr double kPoint = 3.0 * sizeof(double);
    cost_.linearize_bytes += num * kObservation + kPoint + sizeof(size_t);
    cost_.step_bytes += num * kObservation + 2.0 * kPoint + sizeof(size_t);
    if (problem_.points_are_free) AddElimination();
  }

  void AddObservation(const ChunkRanges& chunk, const ChunkImage& image) {
    const RigProblemBase::Image& in_problem = problem_.images[image.image];
    const double num_free =
        in_problem.camera < 0
            ? 0.0
            : problem_.cameras[in_problem.camera].free_params.size();
    const double size = s_.pose_size;
    double flops = kTransform + kDim + kSquaredNorm + kTimesMatrix;
    if (size == 6.0) flops += kCrossProducts + kTimesMatrix;
    flops += kSums;
    flops += Product(size + num_free, size + num_free + 1.0);
    for (const int block : {image.frame, image.sensor, image.camera}) {
      if (block < 0) continue;
      const int in_structure = s_.chunk_blocks[chunk.blocks.begin + block];
      flops += Product(s_.block_size[in_structure], 3.0);
      blocks_.push_back(in_structure);
    }
    cost_.linearize_flops += flops;
    // The step of the point and the cost at its new position.
    cost_.step_flops += 2.0 * (kTransform + kDim + kSquaredNorm) + 12.0 +
                        kDim * (5.0 + 2.0 * num_free) + kTimesMatrix + kSums +
                        kDim + Product(3.0, 1.0);
  }

  void AddElimination() {
    std::sort(blocks_.begin(), blocks_.end());
    blocks_.erase(std::unique(blocks_.begin(), blocks_.end()), blocks_.end());
    double flops = kFactorPoint + kSolveTriangle;
    double sum_of_sizes = 0.0;
    for (const int block : blocks_) {
      const double size = s_.block_size[block];
      sum_of_sizes += size;
      flops += 15.0 * size + 6.0 * size * sum_of_sizes;
    }
    cost_.eliminate_flops += flops;
    cost_.step_flops += kFactorPoint + 2.0 * kSolveTriangle;
  }

  const RigProblemBase& problem_;
  const RigStructure& s_;
  std::vector<int> blocks_;  // that the point meets
  PassCost cost_;
};

}  // namespace

PassCost CountPassCost(const RigProblemBase& problem,
                       const RigStructure& structure) {
  return Counter(problem, structure).Run();
}

}  // namespace mgsfm
