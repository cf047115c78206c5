// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"

namespace mgsfm {

// ADMM for sums of norms of linear expressions,
//
//   minimize  f(z)   subject to  A x - b = z                              (1)
//
// over x (n x c) and z (m x c; c right-hand sides that share A), where f is
// convex and separable and has an inexpensive proximal map
//
//   Prox(rho, v) = argmin_z f(z) + rho/2 |z - v|^2.
//
// Examples are L1 regression, sums of lengths, distances to convex sets, and
// inequality rows C x >= d stacked below A (f is 0 for z >= 0 and infinite
// otherwise).
//
// Method: alternating directions in scaled form with over-relaxation alpha
// (Boyd et al. 2011, "Distributed optimization and statistical learning via
// the alternating direction method of multipliers", sections 3.1.1, 3.4.3, 6.1)
//
//   x <- argmin_x |A x - b - z + u|^2              (one factorization of A^T A)
//   h <- alpha (A x - b) + (1 - alpha) z
//   z <- Prox(rho, h + u)
//   u <- u + h - z.
//
// The last two steps make y = rho u a subgradient of f at z, so a point is
// optimal if the constraint (1) and A^T y = 0 hold. With P the orthogonal
// projection onto the range of A, the solver stops when
//
//   |A x - b - z| <= tol max(|A x - b|, |z|) + eps max(|A x|, |b|)    primal
//   |P y|         <= tol |y|                                          dual
//
// with tol = relative_tolerance, eps = 1e-12 for round-off, and
// P y = A (A^T A)^-1 A^T y. Both criteria and the penalty are relative to
// residuals, never to x or b. The result therefore does not depend on units
// nor, up to round-off, on the origin of x.
//
// The initial penalty is rho = f(r) / |r - r*|^2 with r = A x - b at the start
// and r* the nearest minimizer of f: the typical weight over the size of the
// residuals. Later changes balance the two ratios above (section 3.4.1) and
// keep y = rho u. They occur at geometrically growing intervals, so that the
// penalty settles as the convergence proof requires.
//
// Start: the least-squares solution, or the contents of AdmmState.
// Cost: each iteration applies A and A^T once, solves with A^T A once and does
// not allocate.

struct AdmmOptions {
  int max_num_iterations = 1000;
  double relative_tolerance = 1e-4;
  double over_relaxation = 1.6;  // in [1, 2)
  int check_interval = 10;       // iterations between convergence tests
  Context context;               // checked for cancellation at each test
};

// A solution, which also warm starts the next problem of the same size.
struct AdmmState {
  Eigen::MatrixXd x;  // n x c; empty: cold start
  Eigen::MatrixXd z;  // m x c
  Eigen::MatrixXd y;  // m x c, the dual variable of (1)
  double rho = 0.0;   // 0: chosen from the residuals
};

// f(z) = sum_k w_k |z_k|_2 over the rows z_k. Invariant to rotations of the
// coordinate axes.
struct RowNorms {
  Eigen::VectorXd weights;

  double Cost(const Eigen::MatrixXd& z) const;
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const;
};

namespace internal {

// Type-erased operator and function, so that the solver is compiled once.
struct AdmmProblem {
  using Map = std::function<void(const Eigen::MatrixXd&, Eigen::MatrixXd*)>;

  Eigen::Index rows = 0;
  Eigen::Index cols = 0;
  Map apply, apply_transpose, solve_normal;
  std::function<double(const Eigen::MatrixXd&)> cost;
  std::function<void(double, const Eigen::MatrixXd&, Eigen::MatrixXd*)> prox;
};

SolveSummary MinimizeByAdmm(const AdmmProblem& problem,
                            const Eigen::MatrixXd& b,
                            const AdmmOptions& options, AdmmState* state);

}  // namespace internal

// Solves (1). Operator provides rows(), cols() and, for matrices of c columns,
// Apply(x, &y): y = A x; ApplyTranspose(y, &x): x = A^T y;
// SolveNormal(g, &x): x = (A^T A)^-1 g. Function provides Cost(z) and
// Prox(rho, v, &z), where z has the size of v. The costs in the summary are
// f(A x - b) at the start and at the returned x.
template <class Operator, class Function>
SolveSummary MinimizeByAdmm(const Operator& op, const Eigen::MatrixXd& b,
                            const Function& f, const AdmmOptions& options,
                            AdmmState* state) {
  using Eigen::MatrixXd;
  internal::AdmmProblem problem;
  problem.rows = op.rows();
  problem.cols = op.cols();
  problem.apply = [&](const MatrixXd& x, MatrixXd* y) { op.Apply(x, y); };
  problem.apply_transpose = [&](const MatrixXd& y, MatrixXd* x) {
    op.ApplyTranspose(y, x);
  };
  problem.solve_normal = [&](const MatrixXd& g, MatrixXd* x) {
    op.SolveNormal(g, x);
  };
  problem.cost = [&](const MatrixXd& z) { return f.Cost(z); };
  problem.prox = [&](double rho, const MatrixXd& v, MatrixXd* z) {
    f.Prox(rho, v, z);
  };
  return internal::MinimizeByAdmm(problem, b, options, state);
}

}  // namespace mgsfm
