// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "bundle/problem_builder.h"
#include "least_squares/rig_equations.h"
#include "math/sparse_solver.h"

namespace mgsfm {

// The unknowns that the blocks of a bundle adjustment share: poses of frames in
// several blocks, poses of sensors, and parameters of cameras.
struct SharedUnknowns {
  // The first unknown of each element of the scene; -1 for frames of one block.
  // A pose has six, a camera as many as parameters.
  std::vector<int> first_of_frame, first_of_sensor, first_of_camera;
  int num_unknowns = 0;
};

// The system of a block for the shared unknowns alone.
struct ReducedBlock {
  std::vector<int> unknowns;  // per row, those of SharedUnknowns
  Eigen::MatrixXd matrix;     // lower triangle
  Eigen::VectorXd rhs;
  Eigen::VectorXd damping;  // of a unit lambda; 0 for held coordinates
};

// The equations of a block after Linearize(), split into inner and shared
// unknowns:
//
//   [ A   B^T ] [inner ]   [ a ]
//   [ B   C   ] [shared] = [ b ]
class SplitSystem {
 public:
  SplitSystem(const BuiltProblem& built, const SharedUnknowns& shared,
              const RigEquationsBase& equations, int num_threads);

  // Whether A is positive definite; nothing else may be called otherwise.
  bool IsUsable() const { return is_usable_; }

  // C - B A^-1 B^T and b - B A^-1 a.
  ReducedBlock Reduce() const;

  // The step of all unknowns of the block for this one of the shared ones.
  Eigen::VectorXd CompleteStep(const Eigen::VectorXd& shared_step) const;

 private:
  void NumberUnknowns(const BuiltProblem& built, const SharedUnknowns& shared);
  void SplitMatrix();

  const RigEquationsBase& equations_;
  // Per unknown of the block: the row in A, or the row in C; else -1.
  std::vector<int> inner_row_, shared_row_;
  std::vector<int> shared_unknowns_;  // per row of C
  int num_inner_ = 0;
  Eigen::SparseMatrix<double> A_;   // lower triangle
  Eigen::SparseMatrix<double> Bt_;  // rows: inner, columns: shared
  Eigen::MatrixXd C_;
  Eigen::VectorXd a_, b_;
  SparseCholesky solver_;
  bool is_usable_ = false;
};

}  // namespace mgsfm
