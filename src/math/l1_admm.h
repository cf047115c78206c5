// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/summary.h"

namespace mgsfm {

// The one ADMM of the project: sums of norms of linear expressions,
//
//   minimise  f(z)   subject to  A x - b = z                              (1)
//
// over x (n x c) and z (m x c; c right-hand sides that share A), where f is
// convex and separable, so that its proximal map is cheap:
//
//   Prox(rho, v) = argmin_z f(z) + rho/2 |z - v|^2.
//
// L1 regression, sums of lengths, distances to rays, and inequality rows
// C x >= d (stacked below A; f is 0 where z >= 0 and infinite elsewhere) are
// all of this kind; see the functions below.
//
// Method: alternating directions in scaled form with over-relaxation alpha
// (Boyd et al. 2011, "Distributed optimization and statistical learning via
// the alternating direction method of multipliers", sections 3.1.1, 3.4.3, 6.1)
//
//   x <- argmin_x |A x - b - z + u|^2              (one factorisation of A^T A)
//   h <- alpha (A x - b) + (1 - alpha) z
//   z <- Prox(rho, h + u)
//   u <- u + h - z.
//
// By the last two steps y = rho u is a subgradient of f at z, so the optimum is
// reached when both the constraint (1) and A^T y = 0 hold. With P the
// orthogonal projection onto the range of A, the solver stops when
//
//   |A x - b - z| <= tol max(|A x - b|, |z|) + eps max(|A x|, |b|)    primal
//   |P y|         <= tol |y|                                          dual
//
// with tol = relative_tolerance and eps = 1e-12 for round-off. Both tests, the
// first penalty and its later changes are relative to residuals, never to x or
// b: the result does not depend on units nor, apart from round-off, on the
// origin of x. P y = A (A^T A)^-1 A^T y.
//
// The first penalty is rho = f(r) / |r - r*|^2 with r = A x - b at the start
// and r* the nearest point that minimises f: the reciprocal of the size of the
// residuals times their typical weight. It then balances the two ratios above
// (section 3.4.1); u is rescaled along, y = rho u stays as it was. Changes come
// at geometrically growing intervals, so that the penalty settles, as the proof
// of convergence needs.
//
// Start: the least-squares solution, or what AdmmState holds.
// Cost: an iteration applies A and A^T once and solves with A^T A once; nothing
// is allocated.

struct AdmmOptions {
  int max_num_iterations = 1000;
  double relative_tolerance = 1e-4;
  double over_relaxation = 1.6;  // in [1, 2)
  int check_interval = 10;       // iterations between tests
  Context context;               // checked for an interruption at each test
};

// A solution, and the warm start of a next problem of the same size.
struct AdmmState {
  Eigen::MatrixXd x;  // n x c; empty: cold start
  Eigen::MatrixXd z;  // m x c
  Eigen::MatrixXd y;  // m x c, the dual variable of (1)
  double rho = 0.0;   // 0: chosen from the residuals
};

// f(z) = sum_kj w_k |z_kj|: plain L1 with a weight for each row.
struct L1Norm {
  Eigen::VectorXd weights;

  double Cost(const Eigen::MatrixXd& z) const {
    return weights.dot(z.cwiseAbs().rowwise().sum());
  }
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const {
    for (Eigen::Index j = 0; j < v.cols(); ++j) {
      for (Eigen::Index k = 0; k < v.rows(); ++k) {
        const double length = std::abs(v(k, j)) - weights[k] / rho;
        (*z)(k, j) = length > 0.0 ? std::copysign(length, v(k, j)) : 0.0;
      }
    }
  }
};

// f(z) = sum_k w_k |z_k|_2 over the rows z_k: does not depend on the directions
// of the coordinate axes.
struct RowNorms {
  Eigen::VectorXd weights;

  double Cost(const Eigen::MatrixXd& z) const {
    return weights.dot(z.rowwise().norm());
  }
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const {
    for (Eigen::Index k = 0; k < v.rows(); ++k) {
      const double norm = v.row(k).norm();
      const double left = norm - weights[k] / rho;
      z->row(k) = (left > 0.0 ? left / norm : 0.0) * v.row(k);
    }
  }
};

// L1 over the first rows, as many as there are weights; z >= 0 for the others,
// which is C x >= d where [A; C] and [b; d] are stacked. Cost() leaves the
// inequalities out.
struct L1NormWithInequalities {
  Eigen::VectorXd weights;

  double Cost(const Eigen::MatrixXd& z) const {
    return weights.dot(z.topRows(weights.size()).cwiseAbs().rowwise().sum());
  }
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const {
    const Eigen::Index num_norms = weights.size();
    for (Eigen::Index j = 0; j < v.cols(); ++j) {
      for (Eigen::Index k = 0; k < num_norms; ++k) {
        const double length = std::abs(v(k, j)) - weights[k] / rho;
        (*z)(k, j) = length > 0.0 ? std::copysign(length, v(k, j)) : 0.0;
      }
      for (Eigen::Index k = num_norms; k < v.rows(); ++k) {
        (*z)(k, j) = std::max(v(k, j), 0.0);
      }
    }
  }
};

// f(z) = sum_k w_k min_{p in C_k} |z_k - p|_2: distances of 3-vectors, stacked
// in the one column of z, to convex sets. Project(k, v) is the point of C_k
// nearest to v. With C_k = {s d_k, s >= l_k} it is the sum of the residuals of
// s_k d_k - z_k with the best scales s_k >= l_k, which need not be unknowns.
template <class Project>
struct Distances3 {
  Eigen::VectorXd weights;  // one for each 3-vector
  Project project;

  double Cost(const Eigen::MatrixXd& z) const {
    double cost = 0.0;
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      const Eigen::Vector3d v = z.block<3, 1>(3 * k, 0);
      cost += weights[k] * (v - project(k, v)).norm();
    }
    return cost;
  }
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const {
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      const Eigen::Vector3d from = v.block<3, 1>(3 * k, 0);
      const Eigen::Vector3d nearest = project(k, from);
      const double distance = (from - nearest).norm();
      const double left = distance - weights[k] / rho;
      z->block<3, 1>(3 * k, 0) =
          nearest + (left > 0.0 ? left / distance : 0.0) * (from - nearest);
    }
  }
};

template <class Project>
Distances3<Project> MakeDistances3(Eigen::VectorXd weights, Project project) {
  return {std::move(weights), std::move(project)};
}

namespace internal {

// The two stopping tests; a ratio of at most 1 is a test that holds.
struct AdmmRatios {
  double primal;
  double dual;
};

template <class Operator, class Function>
class Admm {
 public:
  Admm(const Operator& op, const Eigen::MatrixXd& b, const Function& f,
       const AdmmOptions& options, AdmmState* state)
      : op_(op), b_(b), f_(f), options_(options), s_(*state) {
    g_.resize(op_.cols(), b_.cols());
    Ax_.resize(b_.rows(), b_.cols());
    h_.resize(b_.rows(), b_.cols());
    if (s_.x.rows() == op_.cols() && s_.x.cols() == b_.cols()) {
      StartWarm();
    } else {
      StartCold();
    }
  }

  double Cost() {
    h_.noalias() = Ax_ - b_;
    return f_.Cost(h_);
  }

  // False if x minimises f already, to working precision.
  bool ChoosePenalty() {
    h_.noalias() = Ax_ - b_;
    constexpr double kAlmostZero = 1e-100;
    f_.Prox(kAlmostZero, h_, &v_);
    const double distance = (v_ - h_).norm();
    if (!(distance > RoundOff())) return false;
    if (s_.rho > 0.0) return true;
    s_.rho = f_.Cost(h_) / (distance * distance);
    if (!(s_.rho > 0.0) || !std::isfinite(s_.rho)) s_.rho = 1.0 / distance;
    return true;
  }

  void Iterate() {
    const double alpha = options_.over_relaxation;
    const double inverse_rho = 1.0 / s_.rho;
    v_.noalias() = s_.z + b_ - inverse_rho * s_.y;
    UpdateX();
    h_.noalias() =
        alpha * (Ax_ - b_) + (1.0 - alpha) * s_.z + inverse_rho * s_.y;
    f_.Prox(s_.rho, h_, &s_.z);
    s_.y.noalias() = s_.rho * (h_ - s_.z);
  }

  AdmmRatios Ratios() {
    h_.noalias() = Ax_ - b_;
    const double tolerance = options_.relative_tolerance;
    const double primal =
        (h_ - s_.z).norm() /
        (tolerance * std::max(h_.norm(), s_.z.norm()) + RoundOff());
    op_.ApplyTranspose(s_.y, &g_);
    op_.SolveNormal(g_, &dx_);
    op_.Apply(dx_, &h_);
    const double norm_y = s_.y.norm();
    const double dual = norm_y > 0.0 ? h_.norm() / (tolerance * norm_y) : 0.0;
    return {primal, dual};
  }

  void BalancePenalty(const AdmmRatios& ratios) {
    constexpr double kSmall = 1e-8;
    const double factor = std::sqrt(std::max(ratios.primal, kSmall) /
                                    std::max(ratios.dual, kSmall));
    if (factor < 0.5 || factor > 2.0) s_.rho *= std::clamp(factor, 0.2, 5.0);
  }

 private:
  void StartCold() {
    s_.x.resize(op_.cols(), b_.cols());
    v_ = b_;
    UpdateX();
    s_.z = Ax_ - b_;
    s_.y.setZero(b_.rows(), b_.cols());
    s_.rho = 0.0;
  }

  void StartWarm() {
    op_.Apply(s_.x, &Ax_);
    v_.resize(b_.rows(), b_.cols());
    if (s_.z.rows() != b_.rows() || s_.z.cols() != b_.cols()) s_.z = Ax_ - b_;
    if (s_.y.rows() != b_.rows() || s_.y.cols() != b_.cols()) {
      s_.y.setZero(b_.rows(), b_.cols());
    }
  }

  // x = argmin |A x - v|, and A x.
  void UpdateX() {
    op_.ApplyTranspose(v_, &g_);
    op_.SolveNormal(g_, &s_.x);
    op_.Apply(s_.x, &Ax_);
  }

  double RoundOff() const { return 1e-12 * std::max(Ax_.norm(), b_.norm()); }

  const Operator& op_;
  const Eigen::MatrixXd& b_;
  const Function& f_;
  const AdmmOptions& options_;
  AdmmState& s_;
  Eigen::MatrixXd Ax_;      // A x of the current x
  Eigen::MatrixXd v_, h_;   // m x c workspaces
  Eigen::MatrixXd g_, dx_;  // n x c workspaces
};

}  // namespace internal

// Solves (1). Operator has rows(), cols() and, on matrices of c columns,
// Apply(x, &y): y = A x; ApplyTranspose(y, &x): x = A^T y;
// SolveNormal(g, &x): x = (A^T A)^-1 g. Function has Cost(z) and
// Prox(rho, v, &z), where z has the size of v. The costs of the summary are
// f(A x - b) at the start and at the returned x.
template <class Operator, class Function>
SolveSummary MinimizeByAdmm(const Operator& op, const Eigen::MatrixXd& b,
                            const Function& f, const AdmmOptions& options,
                            AdmmState* state) {
  MGSFM_CHECK_EQ(op.rows(), b.rows());
  internal::Admm<Operator, Function> admm(op, b, f, options, state);
  SolveSummary summary;
  summary.initial_cost = summary.final_cost = admm.Cost();
  if (std::isfinite(summary.initial_cost) && !admm.ChoosePenalty()) {
    summary.termination = Termination::kConverged;
    summary.message = "The start is optimal.";
    return summary;
  }
  summary.termination = Termination::kMaxIterations;
  internal::AdmmRatios ratios{0.0, 0.0};
  int next_balance = 0;
  while (summary.num_iterations < options.max_num_iterations) {
    admm.Iterate();
    const int i = ++summary.num_iterations;
    if (i % options.check_interval != 0) continue;
    options.context.CheckInterrupted();
    ratios = admm.Ratios();
    if (!std::isfinite(ratios.primal + ratios.dual)) {
      summary.termination = Termination::kFailure;
      break;
    }
    if (ratios.primal <= 1.0 && ratios.dual <= 1.0) {
      summary.termination = Termination::kConverged;
      break;
    }
    if (i < next_balance) continue;
    admm.BalancePenalty(ratios);
    next_balance = i + i / 4;
  }
  summary.final_cost = admm.Cost();
  std::ostringstream message;
  message << "Residuals over tolerances: primal " << ratios.primal << ", dual "
          << ratios.dual << '.';
  summary.message = message.str();
  return summary;
}

}  // namespace mgsfm
