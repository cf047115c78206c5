// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <string>
#include <vector>

#include "bundle/problem_builder.h"
#include "least_squares/rig_equations.h"
#include "math/sparse_solver.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// The unknowns of a bundle adjustment but for the points. A pose has six, a
// camera as many as parameters.
struct ModelUnknowns {
  // The first unknown of each element of the scene; -1 for frames without pose.
  std::vector<int> first_of_frame, first_of_sensor, first_of_camera;
  int num_unknowns = 0;
};

ModelUnknowns NumberUnknowns(const Scene& scene, const Reconstruction& model);

// Per unknown of the equations of a block: that of the model.
std::vector<int> FindUnknowns(const BuiltProblem& built,
                              const ModelUnknowns& unknowns,
                              const RigStructure& structure);

// The sum of the equations of blocks for the unknowns of the model. Unknowns
// that are held, or that no block has, do not move.
class SummedSystem {
 public:
  // Sets everything to zero, but keeps the pattern of the matrix.
  void Start(int num_unknowns, double lambda);
  // Adds the equations of a block after Linearize(lambda).
  void Add(const std::vector<int>& unknowns, const RigEquationsBase& equations,
           const Mask& is_held);
  // Ends the reduction after the last block.
  void Finish();
  // Changes lambda.
  void Damp(double lambda);

  const Eigen::SparseMatrix<double>& matrix() const { return matrix_; }
  const Eigen::VectorXd& rhs() const { return rhs_; }

 private:
  using Triplets = std::vector<Eigen::Triplet<double>>;
  void AddEntry(int row, int column, double value, Triplets* missing);
  void AddMissing(const Triplets& missing);

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
