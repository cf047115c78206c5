// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/gravity.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geometry/mean_direction.h"
#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"

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

}  // namespace mgsfm
