// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <optional>
#include <string>
#include <vector>

#include "bundle/problem_builder.h"
#include "least_squares/rig_equations.h"
#include "math/sparse_solver.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// The unknowns that blocks share: of some frames, and of all sensors and
// cameras. A pose has six, a camera as many as parameters.
struct SharedUnknowns {
  // The first unknown of each element of the scene; nullopt for frames that are
  // not shared.
  std::vector<std::optional<int>> first_of_frame;
  std::vector<int> first_of_sensor, first_of_camera;
  int num_unknowns = 0;
};

SharedUnknowns NumberUnknowns(const Scene& scene, const Mask& frame_is_shared);

// The unknowns of the equations of a block.
struct BlockUnknowns {
  std::vector<int> interior;  // of the block alone
  std::vector<int> shared;
  std::vector<int> in_model;  // of the shared ones
};

// Leaves out coordinates that are held or that the block keeps constant.
BlockUnknowns SplitUnknowns(const BuiltProblem& built,
                            const SharedUnknowns& unknowns, const Mask& is_held,
                            const RigEquationsBase& equations);

// The sum of the equations of blocks for the shared unknowns. Unknowns that no
// block has do not move.
class SummedSystem {
 public:
  // Sets everything to zero, but keeps the pattern of the matrix.
  void Start(int num_unknowns, double lambda);
  // Adds equations with the damping lambda. The matrix is a lower triangle;
  // `diagonal` is that before damping and elimination.
  void Add(const std::vector<int>& unknowns, const Eigen::MatrixXd& matrix,
           const Eigen::VectorXd& rhs, const Eigen::VectorXd& diagonal);
  // Ends the reduction after the last block.
  void Finish();
  // Changes lambda.
  void Damp(double lambda);

  const Eigen::SparseMatrix<double>& matrix() const { return matrix_; }
  const Eigen::VectorXd& rhs() const { return rhs_; }

 private:
  Eigen::SparseMatrix<double> matrix_;  // lower triangle
  Eigen::VectorXd rhs_;
  Eigen::VectorXd damping_;  // of a unit lambda; 0 for unknowns that stay
  double lambda_ = 0.0;
};

// Solves systems, most of which have the pattern of the one before.
class SummedSystemSolver {
 public:
  explicit SummedSystemSolver(int num_threads) : solver_(num_threads) {}

  // False if the matrix is not positive definite.
  bool Solve(const SummedSystem& system, Eigen::VectorXd* step);

 private:
  SparseCholesky solver_;
  std::string pattern_;  // a fingerprint
};

}  // namespace mgsfm
