// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "math/sparse_solver.h"

namespace mgsfm {

// A linear least-squares operator for the ADMM of math/l1_admm.h. A is a sparse
// matrix of full column rank. Its first 3 n columns belong to n points of three
// coordinates, with equal weight in all directions; the few other columns are
// the border:
//
//   A^T A = [ L (x) I_3   B ]
//           [ B^T         D ].
//
// L, n x n, is the only factorized matrix; the border is eliminated by its
// Schur complement S = D - B^T (L^-1 (x) I_3) B. Compared with the
// factorization of A^T A, this takes 1/9 of the entries and 1/27 of the
// operations. Cost of an application: linear in the entries of A, on several
// threads; each sum has a fixed order.
class ArrowLeastSquares {
 public:
  ArrowLeastSquares(const Eigen::SparseMatrix<double>& A, int num_points,
                    int num_threads);

  bool IsPositiveDefinite() const { return is_positive_definite_; }

  Eigen::Index rows() const { return A_.rows(); }
  Eigen::Index cols() const { return A_.cols(); }
  // y = A x, x = A^T y, x = (A^T A)^-1 g, for one column each.
  void Apply(const Eigen::MatrixXd& x, Eigen::MatrixXd* y) const;
  void ApplyTranspose(const Eigen::MatrixXd& y, Eigen::MatrixXd* x) const;
  void SolveNormal(const Eigen::MatrixXd& g, Eigen::MatrixXd* x) const;

 private:
  bool Factorize();
  // x = (L^-1 (x) I_3) g.
  void SolvePoints(const Eigen::Ref<const Eigen::VectorXd>& g,
                   Eigen::Ref<Eigen::VectorXd> x) const;

  const int num_points_;
  const int num_threads_;
  Eigen::SparseMatrix<double> A_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> by_row_;
  // Columns of A with about the same number of entries, those of the border
  // first.
  std::vector<int> range_begin_;
  SparseCholesky points_;          // L
  Eigen::MatrixXd border_;         // B
  Eigen::MatrixXd solved_border_;  // (L^-1 (x) I_3) B
  Eigen::LLT<Eigen::MatrixXd> schur_;
  bool is_positive_definite_ = false;
};

}  // namespace mgsfm
