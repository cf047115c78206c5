// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "bundle/problem_builder.h"
#include "least_squares/rig_equations.h"

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

// The equations of a block after Linearize(), for the unknowns of the model.
struct ReducedBlock {
  std::vector<int> unknowns;           // per row
  Eigen::SparseMatrix<double> matrix;  // lower triangle
  Eigen::VectorXd rhs;
  Eigen::VectorXd damping;  // of a unit lambda; 0 for held coordinates
};

ReducedBlock ReduceBlock(std::vector<int> unknowns,
                         const RigEquationsBase& equations);

// The sum of blocks that were reduced with `reduced_lambda`, damped by lambda.
// Unknowns that are held, or that no block has, do not move.
class SummedSystem {
 public:
  SummedSystem(const std::vector<ReducedBlock>& blocks, const Mask& is_held);

  // False if the matrix is not positive definite.
  bool Solve(double lambda, double reduced_lambda, int num_threads,
             Eigen::VectorXd* step) const;

 private:
  Eigen::SparseMatrix<double> matrix_;  // lower triangle
  Eigen::VectorXd rhs_, damping_;
};

}  // namespace mgsfm
