// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "math/sparse_solver.h"

namespace mgsfm {

// The symmetric positive definite equations H z = b of a block, whose unknowns
// are its own (i) or shared with other blocks (s):
//
//   (H_ss - H_si H_ii^-1 H_is) z_s = b_s - H_si H_ii^-1 b_i            (1)
//   z_i = H_ii^-1 (b_i - H_is z_s)                                     (2)
//
// Cost: one factorisation each. Memory: the factor.
class InteriorElimination {
 public:
  // The unknowns of both kinds, ascending. The rows of H should be in a
  // fill-reducing order. Unknowns of neither kind do not move.
  InteriorElimination(std::vector<int> interior, std::vector<int> shared,
                      int num_threads);

  // Both sides of (1), the left one as a lower triangle. Only the lower
  // triangle of H is read. False if H is not positive definite.
  bool Reduce(const Eigen::SparseMatrix<double>& H, const Eigen::VectorXd& b,
              Eigen::MatrixXd* reduced, Eigen::VectorXd* reduced_b);

  // z by (2) from z_s; 0 for unknowns that do not move.
  bool Expand(const Eigen::SparseMatrix<double>& H, const Eigen::VectorXd& b,
              const Eigen::VectorXd& z_shared, Eigen::VectorXd* z);

 private:
  Eigen::SparseMatrix<double> Permute(const Eigen::SparseMatrix<double>& H,
                                      Eigen::Index size) const;
  Eigen::VectorXd Select(const Eigen::VectorXd& b) const;

  std::vector<int> interior_, shared_;
  SparseCholesky solver_;
};

}  // namespace mgsfm
