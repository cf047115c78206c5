// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

namespace mgsfm {

// An order of the unknowns that keeps a Cholesky factor sparse, by the better
// of minimum degree and nested dissection, and what it costs.
struct EliminationOrder {
  std::vector<int> order;  // order[0] is eliminated first
  double num_factor_entries = 0.0;
  double num_flops = 0.0;
};

// H must be compressed; its values do not matter. Only its lower triangle,
// diagonal included, is read.
EliminationOrder FindEliminationOrder(const Eigen::SparseMatrix<double>& H);

// Solves H X = B for a sparse, symmetric positive definite H and any number of
// right-hand sides by Cholesky factorisation (CHOLMOD; Chen et al. 2008,
// ACM TOMS 887; factors that are not very sparse by several threads). Only the
// lower triangle of H, diagonal included, is read. Results do not depend on the
// number of threads.
//
//   SparseCholesky solver;
//   solver.Analyze(H);                      // once per sparsity pattern
//   if (!solver.Factorize(H)) ...           // once per values
//   solver.Solve(B, X);                     // as often as needed
//
// One object must not be used by several threads at a time.
class SparseCholesky {
 public:
  explicit SparseCholesky(int num_threads = 1);
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  enum class Order {
    kFillReducing,
    kGiven,  // that of the rows; for a matrix that is ordered well already
  };

  // Ordering and symbolic factorisation. H must be compressed and not empty.
  void Analyze(const Eigen::SparseMatrix<double>& H,
               Order order = Order::kFillReducing);

  // Numeric factorisation of a matrix with the pattern given to Analyze().
  // False if H is not positive definite to working precision or not finite;
  // Solve() must not be called then.
  [[nodiscard]] bool Factorize(const Eigen::SparseMatrix<double>& H);

  // The square of the ratio of the smallest and the largest diagonal element
  // of the factor: an upper bound on the reciprocal condition number of H, near
  // zero when H is close to singular. O(n).
  double ReciprocalCondition() const;

  // X = H^-1 B. X must have the size of B; it may be B.
  void Solve(const Eigen::Ref<const Eigen::MatrixXd>& B,
             Eigen::Ref<Eigen::MatrixXd> X) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A linear least-squares operator on a sparse matrix of full column rank, with
// one factorisation of A^T A. Fits the ADMM of l1_admm.h.
class SparseLeastSquares {
 public:
  // Takes A and factorises; IsPositiveDefinite() says whether that worked.
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
