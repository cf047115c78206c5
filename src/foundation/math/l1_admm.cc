// SPDX-License-Identifier: BSD-3-Clause
#include "math/l1_admm.h"

#include <algorithm>
#include <cmath>

#include "base/text_streams.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;

// The ratios of the two stopping criteria, which hold if both are at most 1.
struct AdmmRatios {
  double primal;
  double dual;
};

class Admm {
 public:
  Admm(const internal::AdmmProblem& problem, const MatrixXd& b,
       const AdmmOptions& options, AdmmState* state)
      : p_(problem), b_(b), options_(options), s_(*state) {
    g_.resize(p_.cols, b_.cols());
    Ax_.resize(b_.rows(), b_.cols());
    h_.resize(b_.rows(), b_.cols());
    if (s_.x.rows() == p_.cols && s_.x.cols() == b_.cols()) {
      StartWarm();
    } else {
      StartCold();
    }
  }

  double Cost() {
    h_.noalias() = Ax_ - b_;
    return p_.cost(h_);
  }

  // Returns false if x already minimizes f to working precision.
  bool ChoosePenalty() {
    h_.noalias() = Ax_ - b_;
    // The proximal map for rho -> 0 is the nearest minimizer of f.
    p_.prox(1e-100, h_, &v_);
    const double distance = (v_ - h_).norm();
    if (!(distance > RoundOff())) return false;
    if (s_.rho > 0.0) return true;
    s_.rho = p_.cost(h_) / (distance * distance);
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
    p_.prox(s_.rho, h_, &s_.z);
    s_.y.noalias() = s_.rho * (h_ - s_.z);
  }

  AdmmRatios Ratios() {
    h_.noalias() = Ax_ - b_;
    const double tolerance = options_.relative_tolerance;
    const double primal =
        (h_ - s_.z).norm() /
        (tolerance * std::max(h_.norm(), s_.z.norm()) + RoundOff());
    p_.apply_transpose(s_.y, &g_);
    p_.solve_normal(g_, &dx_);
    p_.apply(dx_, &h_);
    const double norm_y = s_.y.norm();
    const double dual = norm_y > 0.0 ? h_.norm() / (tolerance * norm_y) : 0.0;
    return {primal, dual};
  }

  void BalancePenalty(const AdmmRatios& ratios) {
    constexpr double kSmall = 1e-8;  // avoids division by zero
    const double factor = std::sqrt(std::max(ratios.primal, kSmall) /
                                    std::max(ratios.dual, kSmall));
    if (factor < 0.5 || factor > 2.0) s_.rho *= std::clamp(factor, 0.2, 5.0);
  }

 private:
  void StartCold() {
    s_.x.resize(p_.cols, b_.cols());
    v_ = b_;
    UpdateX();
    s_.z = Ax_ - b_;
    s_.y.setZero(b_.rows(), b_.cols());
    s_.rho = 0.0;
  }

  void StartWarm() {
    p_.apply(s_.x, &Ax_);
    v_.resize(b_.rows(), b_.cols());
    if (s_.z.rows() != b_.rows() || s_.z.cols() != b_.cols()) s_.z = Ax_ - b_;
    if (s_.y.rows() != b_.rows() || s_.y.cols() != b_.cols()) {
      s_.y.setZero(b_.rows(), b_.cols());
    }
  }

  // x = argmin |A x - v|, and A x.
  void UpdateX() {
    p_.apply_transpose(v_, &g_);
    p_.solve_normal(g_, &s_.x);
    p_.apply(s_.x, &Ax_);
  }

  double RoundOff() const { return 1e-12 * std::max(Ax_.norm(), b_.norm()); }

  const internal::AdmmProblem& p_;
  const MatrixXd& b_;
  const AdmmOptions& options_;
  AdmmState& s_;
  MatrixXd Ax_;      // A x of the current x
  MatrixXd v_, h_;   // m x c workspaces
  MatrixXd g_, dx_;  // n x c workspaces
};

}  // namespace

double RowNorms::Cost(const MatrixXd& z) const {
  return weights.dot(z.rowwise().norm());
}

void RowNorms::Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
  for (Eigen::Index k = 0; k < v.rows(); ++k) {
    const double norm = v.row(k).norm();
    const double left = norm - weights[k] / rho;
    z->row(k) = (left > 0.0 ? left / norm : 0.0) * v.row(k);
  }
}

SolveSummary internal::MinimizeByAdmm(const AdmmProblem& problem,
                                      const MatrixXd& b,
                                      const AdmmOptions& options,
                                      AdmmState* state) {
  MGSFM_CHECK_EQ(problem.rows, b.rows());
  Admm admm(problem, b, options, state);
  SolveSummary summary;
  summary.initial_cost = summary.final_cost = admm.Cost();
  if (std::isfinite(summary.initial_cost) && !admm.ChoosePenalty()) {
    summary.termination = Termination::kConverged;
    summary.message = "The initial solution is optimal.";
    return summary;
  }
  summary.termination = Termination::kMaxIterations;
  AdmmRatios ratios{0.0, 0.0};
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
  TextOutput message;
  message << "Ratios of residuals to tolerances: primal " << ratios.primal
          << ", dual " << ratios.dual << '.';
  summary.message = message.str();
  return summary;
}

}  // namespace mgsfm
