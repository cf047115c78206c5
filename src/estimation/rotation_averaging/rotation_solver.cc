// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_solver.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "base/text_streams.h"
#include "geometry/mean_direction.h"
#include "geometry/so3.h"
#include "math/l1_admm.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "math/sparse_solver.h"
#include "rotation_averaging/rotation_equations.h"
#include "rotation_averaging/rotation_initialization.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Angles to a direction are norms of vectors with two coordinates.
double SigmaOfAngles(double prior_sigma, std::vector<double> angles) {
  return std::max(prior_sigma, RobustSigma<2>(std::move(angles)));
}

}  // namespace

void GravityWeighting::AdjustScale(const std::vector<double>& angles,
                                   const std::vector<double>& edge_norms,
                                   bool edges_are_final) {
  const double sigma = SigmaOfAngles(problem_.gravity_sigma_rad, angles);
  std::vector<double> unit_norms = edge_norms;
  for (size_t e = 0; e < unit_norms.size(); ++e) {
    unit_norms[e] *= std::sqrt(problem_.edges[e].final_weight);
  }
  const double edge_sigma =
      unit_norms.empty() ? 0.0 : RobustSigma<3>(std::move(unit_norms));
  // A chain has zero residuals, whatever the errors of its edges. The lower
  // limit lets gravity affect a chain nevertheless.
  const double ratio = std::max(0.1, edge_sigma / sigma);
  variance_ratio_ = ratio * ratio;
  // The last scale of the loss keeps 99 % of the normal gravity priors:
  // exp(-3^2 / 2) = 1.1 % of 2-vectors are longer.
  const double target = 3.0 * sigma;
  scale_rad_ = scale_.Next(target);
  is_final_ = edges_are_final && scale_.IsAtTarget();
}

const GravityValues& GravityWeighting::Next(
    const RotationState& state, const std::vector<double>& edge_norms,
    bool edges_are_final) {
  values_.residuals.clear();
  for (const GravityTerm& term : problem_.gravity) {
    values_.residuals.push_back(GravityResidual(term, state));
  }
  if (!is_final_) {
    AdjustScale(Norms(values_.residuals), edge_norms, edges_are_final);
  }
  const RobustLoss loss = {RobustLossType::kGemanMcClure, scale_rad_};
  values_.weights.clear();
  for (const Vector3d& residual : values_.residuals) {
    // Keeps the equations regular in spite of outliers; otherwise negligible.
    values_.weights.push_back(
        variance_ratio_ * std::max(1e-6, loss.Weight(residual.squaredNorm())));
  }
  return values_;
}

void LevelComponents(const RotationProblem& problem, RotationState* state) {
  const ConnectedComponents components = FindComponents(problem);
  const std::vector<int>& component = components.component;
  std::vector<std::vector<Vector3d>> directions(components.num_components);
  for (const GravityTerm& term : problem.gravity) {
    directions[component[term.node]].push_back(
        (state->sensors[term.sensor] * state->nodes[term.node]).conjugate() *
        term.direction);
  }
  std::vector<Quaterniond> old_from_new(components.num_components,
                                        Quaterniond::Identity());
  for (int i = 0; i < components.num_components; ++i) {
    if (directions[i].empty()) continue;
    old_from_new[i] =
        RotationBetween(Vector3d::UnitY(), RobustMeanDirection(directions[i]));
  }
  for (int node = 0; node < problem.num_nodes; ++node) {
    Quaterniond& G = state->nodes[node];
    if (directions[component[node]].empty()) continue;
    G = (G * old_from_new[component[node]]).normalized();
  }
}

namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

// The matrix of d_2 - d_1 for the edges between different nodes.
struct Differences {
  Eigen::SparseMatrix<double> matrix;
  std::vector<size_t> edges;  // per row
};

Differences BuildDifferences(const RotationProblem& problem,
                             const RotationUnknowns& unknowns) {
  Differences differences;
  std::vector<Eigen::Triplet<double>> triplets;
  for (size_t e = 0; e < problem.edges.size(); ++e) {
    const RotationEdge& edge = problem.edges[e];
    if (edge.node1 == edge.node2) continue;
    const int row = static_cast<int>(differences.edges.size());
    const std::optional<int> c1 = unknowns.column_of_node[edge.node1];
    const std::optional<int> c2 = unknowns.column_of_node[edge.node2];
    if (c1) triplets.emplace_back(row, *c1, -1.0);
    if (c2) triplets.emplace_back(row, *c2, 1.0);
    differences.edges.push_back(e);
  }
  differences.matrix.resize(static_cast<Eigen::Index>(differences.edges.size()),
                            unknowns.num_node_columns);
  differences.matrix.setFromTriplets(triplets.begin(), triplets.end());
  return differences;
}

double SumOfNorms(const RotationProblem& problem,
                  const std::vector<Vector3d>& residuals) {
  double sum = 0.0;
  for (size_t e = 0; e < residuals.size(); ++e) {
    sum += problem.edges[e].weight * residuals[e].norm();
  }
  return sum;
}

double RobustCost(const RotationProblem& problem,
                  const std::vector<double>& norms, const RobustLoss& loss) {
  double sum = 0.0;
  for (size_t e = 0; e < norms.size(); ++e) {
    sum += 0.5 * problem.edges[e].final_weight * loss.Cost(norms[e] * norms[e]);
  }
  return sum;
}

// Solves a sequence of linearized L1 problems with one factorization.
class L1Steps {
 public:
  L1Steps(const RotationProblem& problem, const RotationUnknowns& unknowns,
          int num_threads)
      : L1Steps(problem, BuildDifferences(problem, unknowns), num_threads) {}

  bool IsSolvable() const { return op_.IsPositiveDefinite(); }

  SolveSummary Next(const std::vector<Vector3d>& residuals,
                    const Context& context, RotationStep* step) {
    AdmmOptions options;
    options.context = context;
    // L1 averaging only initializes, so its steps are solved roughly.
    options.max_num_iterations = 300;
    options.relative_tolerance = 1e-3;
    for (size_t row = 0; row < edges_.size(); ++row) {
      b_.row(static_cast<Eigen::Index>(row)) = residuals[edges_[row]];
    }
    admm_.x.setZero(op_.cols(), 3);
    admm_.z.resize(0, 0);
    admm_.rho = 0.0;
    SolveSummary summary = MinimizeByAdmm(op_, b_, norms_, options, &admm_);
    step->nodes = admm_.x;
    return summary;
  }

 private:
  L1Steps(const RotationProblem& problem, Differences differences,
          int num_threads)
      : op_(differences.matrix, num_threads),
        edges_(std::move(differences.edges)),
        b_(op_.rows(), 3) {
    norms_.weights.resize(op_.rows());
    for (size_t row = 0; row < edges_.size(); ++row) {
      norms_.weights[static_cast<Eigen::Index>(row)] =
          problem.edges[edges_[row]].weight;
    }
  }

  SparseLeastSquares op_;
  std::vector<size_t> edges_;  // per row
  MatrixXd b_;
  RowNorms norms_;
  AdmmState admm_;
};

double RootMeanSquare(const MatrixXd& step) {
  return std::sqrt(step.squaredNorm() /
                   static_cast<double>(std::max<Eigen::Index>(1, step.rows())));
}

}  // namespace

RobustLoss RobustScaleSchedule::Next(const std::vector<double>& norms) {
  if (!is_final_) {
    const double sigma = norms.empty() ? 0.0 : RobustSigma<3>(norms);
    // At the last scale of the loss, six sigmas, an error of one sigma keeps 95
    // % of its weight: 1 / (1 + 1 / 36)^2. The lower limit keeps the scale of
    // exact data away from zero.
    const double target = std::max(DegToRad(0.05), 6.0 * sigma);
    scale_rad_ = scale_.Next(target);
    is_final_ = scale_.IsAtTarget();
  }
  return {RobustLossType::kGemanMcClure, scale_rad_};
}

SolveSummary AverageL1(const RotationProblem& problem,
                       const RotationAveragingOptions& options,
                       const Context& context, RotationState* state) {
  SolveSummary summary;
  const RotationUnknowns unknowns = NumberUnknowns(problem);
  std::vector<Vector3d> residuals;
  ComputeResiduals(problem, *state, context.num_threads, &residuals);
  summary.initial_cost = summary.final_cost = SumOfNorms(problem, residuals);
  if (unknowns.num_node_columns == 0) {
    summary.termination = Termination::kConverged;
    return summary;
  }
  L1Steps steps(problem, unknowns, context.num_threads);
  if (!steps.IsSolvable()) {
    summary.message = "The equations of the L1 step are singular.";
    return summary;
  }
  RotationStep step;
  summary.termination = Termination::kMaxIterations;
  while (summary.num_iterations < options.max_num_l1_iterations) {
    if (!steps.Next(residuals, context, &step).IsUsable()) {
      summary.termination = Termination::kFailure;
      summary.message = "The ADMM of the L1 step failed.";
      return summary;
    }
    ++summary.num_iterations;
    ApplyStep(unknowns, step, state);
    ComputeResiduals(problem, *state, context.num_threads, &residuals);
    summary.final_cost = SumOfNorms(problem, residuals);
    // As an initialization, it may stop far above step_tolerance_deg.
    if (RootMeanSquare(step.nodes) <= DegToRad(0.05)) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  return summary;
}

SolveSummary AverageRobust(const RotationProblem& problem,
                           const RotationAveragingOptions& options,
                           const Context& context, RotationState* state) {
  SolveSummary summary;
  RotationEquations equations(problem, context.num_threads);
  std::vector<Vector3d> residuals;
  ComputeResiduals(problem, *state, context.num_threads, &residuals);
  const std::vector<double> initial_norms = Norms(residuals);
  std::vector<double> norms = initial_norms;
  std::vector<double> weights(norms.size());
  RobustScaleSchedule schedule;
  GravityWeighting gravity(problem);
  RobustLoss loss;
  RotationStep step;
  summary.termination = Termination::kMaxIterations;
  while (summary.num_iterations < options.max_num_iterations) {
    context.CheckInterrupted();
    loss = schedule.Next(norms);
    const GravityValues& level =
        gravity.Next(*state, norms, schedule.IsFinal());
    for (size_t e = 0; e < norms.size(); ++e) {
      const RotationEdge& edge = problem.edges[e];
      // Keeps the equations regular if all edges of a node are outliers.
      weights[e] = (schedule.IsFinal() ? edge.final_weight : edge.weight) *
                   std::max(1e-10, loss.Weight(norms[e] * norms[e]));
    }
    if (!equations.Solve(weights, residuals, *state, &step, level)) {
      summary.termination = Termination::kFailure;
      summary.message = "The normal equations are singular.";
      return summary;
    }
    ++summary.num_iterations;
    ApplyStep(equations.unknowns(), step, state);
    ComputeResiduals(problem, *state, context.num_threads, &residuals);
    norms = Norms(residuals);
    if (schedule.IsFinal() && gravity.IsFinal() &&
        step.MaxNorm() <= DegToRad(options.step_tolerance_deg)) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  summary.initial_cost = RobustCost(problem, initial_norms, loss);
  summary.final_cost = RobustCost(problem, norms, loss);
  TextOutput message;
  message << "Final scale " << RadToDeg(schedule.scale_rad()) << " deg.";
  summary.message = message.str();
  return summary;
}

SolveSummary AverageNodes(const RotationProblem& problem,
                          const NodeStart& start,
                          const RotationAveragingOptions& options,
                          const Context& context, RotationState* state) {
  InitializeNodes(problem, DegToRad(options.max_error_deg), start, state);
  if (!start.IsEmpty()) return AverageRobust(problem, options, context, state);
  const SolveSummary l1 = AverageL1(problem, options, context, state);
  SolveSummary summary = AverageRobust(problem, options, context, state);
  TextOutput message;
  message << summary.message << " L1 step: " << EnumName(l1.termination)
          << " after " << l1.num_iterations << " iterations. " << l1.message;
  summary.message = message.str();
  return summary;
}

}  // namespace mgsfm
