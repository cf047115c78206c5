// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "bundle/bundle_problem.h"
#include "bundle/bundle_structure.h"
#include "mgsfm/math/sparse_solver.h"

namespace mgsfm {

// A change of a state: of the unknowns in the blocks of the structure, and of
// the points.
struct BundleStep {
  Eigen::VectorXd blocks;
  std::vector<Eigen::Vector3d> points;
};

// The damped normal equations of a bundle problem,
//
//   [ H    W^T ] [dz]     [g_z]
//   [ W    V   ] [dp] = - [g_p],   H += lambda D_z,  V += lambda D_p,       (1)
//
// with residuals weighted by rho' (iteratively re-weighted least squares), D
// the diagonal of the undamped matrix within [1e-6, 1e32], and V block-diagonal
// over the points. Points are eliminated first:
//
//   (H - W^T V^-1 W) dz = -g_z + W^T V^-1 g_p,   dp = -V^-1 (g_p + W dz).
//
// The reduced matrix is sparse in blocks; frames that see no common point do
// not meet in it. Block columns are assembled independently of each other, each
// over its points in order, so all results are the same to the last bit for
// every number of threads. Cost: for each point the square of the number of
// blocks it meets, plus one sparse Cholesky factorisation.
class NormalEquations {
 public:
  // Both must outlive this.
  NormalEquations(const BundleProblem& problem,
                  const BundleStructure& structure, int num_threads);

  // False if a residual or derivative is not finite or not defined.
  [[nodiscard]] bool Linearize(const BundleState& state);

  // Solves (1). False if it is not positive definite to working precision.
  [[nodiscard]] bool Solve(double lambda, BundleStep* step);

  // By how much the quadratic model says that the last step lowers the cost.
  double PredictedDecrease(double lambda, const BundleStep& step) const;

 private:
  // A block column of the reduced matrix below its diagonal: the blocks it
  // meets, from itself on, and the rows where they start.
  struct Column {
    std::vector<int> blocks;
    std::vector<int> rows;
    int height = 0;
    size_t first_value = 0;
  };

  void MakePattern();
  Column MakeColumn(int block) const;
  bool LinearizePoint(const std::vector<ImagePose>& poses, size_t point);
  void LinearizeImage(const std::vector<ImagePose>& poses, size_t image);
  void AddPriors(const BundleState& state);
  void InvertPoint(double lambda, size_t point);
  void AssembleColumn(double lambda, int block);
  void AddImages(int block, const std::vector<int>& row_of_block);
  void SubtractPoints(int block, const std::vector<int>& row_of_block);
  void DampColumn(double lambda, int block);
  Eigen::Vector3d PointStep(size_t point, const Eigen::VectorXd& dz) const;

  Eigen::Map<Eigen::MatrixXd> Panel(int block) {
    const Column& column = columns_[block];
    return {reduced_.valuePtr() + column.first_value, column.height,
            structure_.blocks[block].size};
  }

  const BundleProblem& problem_;
  const BundleStructure& structure_;
  const int num_threads_;

  std::vector<Eigen::Vector3d> points_;           // of the linearised state
  std::vector<Eigen::Matrix3d> point_hessians_;   // V without damping
  std::vector<Eigen::Vector3d> point_gradients_;  // g_p
  std::vector<Eigen::Matrix3d> point_inverses_;   // V^-1
  std::vector<double> couplings_;                 // W^T by incidence
  std::vector<Eigen::MatrixXd> image_hessians_;   // lower triangles
  std::vector<Eigen::VectorXd> image_gradients_;
  Eigen::VectorXd prior_hessian_;     // diagonal
  Eigen::VectorXd gradient_;          // g_z
  Eigen::VectorXd hessian_diagonal_;  // of H, 0 for held coordinates

  std::vector<Column> columns_;
  Eigen::SparseMatrix<double> reduced_;
  Eigen::VectorXd reduced_rhs_;
  SparseCholesky solver_;
};

}  // namespace mgsfm
