// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

namespace mgsfm {

// A fill-reducing elimination order, the better of minimum degree and nested
// dissection, and the cost of the Cholesky factorization.
struct EliminationOrder {
  std::vector<int> order;  // order[0] is eliminated first
  double num_factor_entries = 0.0;
  double num_flops = 0.0;
};

// Uses the sparsity pattern of the lower triangle of H, including the diagonal.
// H must be compressed.
EliminationOrder FindEliminationOrder(const Eigen::SparseMatrix<double>& H);

// Solves H X = B for a sparse symmetric positive definite H and any number of
// right-hand sides by Cholesky factorization (CHOLMOD, Chen et al. 2008, ACM
// TOMS 887; supernodal factors use several threads). Only the lower triangle of
// H, including the diagonal, is read. Results do not depend on the number of
// threads.
//
//   SparseCholesky solver;
//   solver.Analyze(H);               // once per sparsity pattern
//   if (!solver.Factorize(H)) ...    // whenever the values change
//   solver.Solve(B, X);              // any number of times
//
// Objects are not thread-safe.
class SparseCholesky {
 public:
  explicit SparseCholesky(int num_threads = 1);
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  enum class Order {
    kFillReducing,
    kNatural,  // the order of the rows, for matrices that are already ordered
  };

  // Ordering and symbolic factorization. H must be compressed and not empty.
  void Analyze(const Eigen::SparseMatrix<double>& H,
               Order order = Order::kFillReducing);

  // Numeric factorization of a matrix with the pattern passed to Analyze().
  // Returns false if H is not finite or not numerically positive definite;
  // Solve() must not be called then.
  [[nodiscard]] bool Factorize(const Eigen::SparseMatrix<double>& H);

  // The squared ratio of the smallest to the largest diagonal element of the
  // factor: an upper bound on the reciprocal condition number of H. O(n).
  double ReciprocalCondition() const;

  // X = H^-1 B. X must have the size of B and may alias it.
  void Solve(const Eigen::Ref<const Eigen::MatrixXd>& B,
             Eigen::Ref<Eigen::MatrixXd> X) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The least-squares operator of a sparse matrix A of full column rank, with one
// factorization of A^T A. Implements the Operator concept of l1_admm.h.
class SparseLeastSquares {
 public:
  // Factorizes A^T A; IsPositiveDefinite() returns whether that succeeded.
  explicit SparseLeastSquares(Eigen::SparseMatrix<double> A,
                              int num_threads = 1);

  bool IsPositiveDefinite() const { return is_positive_definite_; }
  double ReciprocalCondition() const { return solver_.ReciprocalCondition(); }

  Eigen::Index rows() const { return A_.rows(); }
  Eigen::Index cols() const { return A_.cols(); }
  // y = A x.
  void Apply(const Eigen::MatrixXd& x, Eigen::MatrixXd* y) const {
    y->noalias() = A_ * x;
  }
  // x = A^T y.
  void ApplyTranspose(const Eigen::MatrixXd& y, Eigen::MatrixXd* x) const {
    x->noalias() = A_.transpose() * y;
  }
  // x = (A^T A)^-1 g.
  void SolveNormal(const Eigen::MatrixXd& g, Eigen::MatrixXd* x) const {
    x->resize(g.rows(), g.cols());
    solver_.Solve(g, *x);
  }

 private:
  Eigen::SparseMatrix<double> A_;
  SparseCholesky solver_;
  bool is_positive_definite_ = false;
};

}  // namespace mgsfm
