// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_equations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "geometry/so3.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Stacks each three consecutive columns of `matrix` to one.
Eigen::Map<const MatrixXd> Stacked(const MatrixXd& matrix) {
  return {matrix.data(), 3 * matrix.rows(), matrix.cols() / 3};
}

}  // namespace

RotationUnknowns NumberUnknowns(const RotationProblem& problem) {
  RotationUnknowns unknowns;
  const ConnectedComponents components = FindComponents(problem);
  Mask is_fixed(components.num_components, false);  // gauge of the component
  Mask has_gravity(components.num_components, false);
  for (const GravityTerm& term : problem.gravity) {
    has_gravity[components.component[term.node]] = true;
  }
  unknowns.column_of_node.resize(problem.num_nodes);
  for (int node = 0; node < problem.num_nodes; ++node) {
    const int component = components.component[node];
    if (has_gravity[component] && !is_fixed[component]) {
      unknowns.leveled_columns.push_back(unknowns.num_node_columns);
    }
    if (has_gravity[component] || is_fixed[component]) {
      unknowns.column_of_node[node] = unknowns.num_node_columns++;
    }
    is_fixed[component] = true;
  }
  for (const bool is_free : problem.sensor_is_free) {
    unknowns.column_of_sensor.emplace_back();
    if (!is_free) continue;
    unknowns.column_of_sensor.back() = unknowns.num_sensor_columns++;
  }
  return unknowns;
}

double RotationStep::MaxNorm() const {
  double max = 0.0;
  if (nodes.rows() > 0) max = nodes.rowwise().norm().maxCoeff();
  if (sensors.cols() > 0) {
    max = std::max(max, sensors.colwise().norm().maxCoeff());
  }
  return max;
}

void ApplyStep(const RotationUnknowns& unknowns, const RotationStep& step,
               RotationState* state) {
  for (size_t node = 0; node < state->nodes.size(); ++node) {
    const std::optional<int> column = unknowns.column_of_node[node];
    if (!column) continue;
    Eigen::Quaterniond& G = state->nodes[node];
    G = (G * ExpSO3(step.nodes.row(*column))).normalized();
  }
  for (size_t sensor = 0; sensor < state->sensors.size(); ++sensor) {
    const std::optional<int> column = unknowns.column_of_sensor[sensor];
    if (!column) continue;
    Eigen::Quaterniond& S = state->sensors[sensor];
    S = (S * ExpSO3(step.sensors.col(*column))).normalized();
  }
}

RotationEquations::RotationEquations(const RotationProblem& problem,
                                     int num_threads)
    : problem_(problem),
      unknowns_(NumberUnknowns(problem)),
      solver_(num_threads),
      leveled_solver_(num_threads) {
  const int num_nodes = unknowns_.num_node_columns;
  const int num_sensors = unknowns_.num_sensor_columns;
  node_gradient_.resize(num_nodes, 3);
  border_.resize(num_nodes, 9 * num_sensors);
  solved_border_.resize(num_nodes, 9 * num_sensors);
  sensor_gradient_.resize(3 * num_sensors);
  sensor_block_.resize(3 * num_sensors, 3 * num_sensors);
  BuildPattern();
}

void RotationEquations::BuildPattern() {
  const int size = unknowns_.num_node_columns;
  std::vector<Eigen::Triplet<double>> triplets;
  for (int i = 0; i < size; ++i) triplets.emplace_back(i, i, 1.0);
  for (const RotationEdge& edge : problem_.edges) {
    const std::optional<int> c1 = unknowns_.column_of_node[edge.node1];
    const std::optional<int> c2 = unknowns_.column_of_node[edge.node2];
    if (c1 && c2 && *c1 != *c2) {
      triplets.emplace_back(std::max(*c1, *c2), std::min(*c1, *c2), 0.0);
    }
  }
  laplacian_.resize(size, size);
  laplacian_.setFromTriplets(triplets.begin(), triplets.end());
  laplacian_.makeCompressed();
  if (size > 0) solver_.Analyze(laplacian_);
  if (!unknowns_.leveled_columns.empty()) leveled_solver_.Analyze(laplacian_);

  entries_.resize(problem_.edges.size());
  for (size_t e = 0; e < entries_.size(); ++e) {
    const RotationEdge& edge = problem_.edges[e];
    const std::optional<int> c1 = unknowns_.column_of_node[edge.node1];
    const std::optional<int> c2 = unknowns_.column_of_node[edge.node2];
    if (edge.node1 == edge.node2) continue;
    if (c1) entries_[e].diagonal1 = FindEntry(*c1, *c1);
    if (c2) entries_[e].diagonal2 = FindEntry(*c2, *c2);
    if (c1 && c2) {
      entries_[e].off_diagonal =
          FindEntry(std::max(*c1, *c2), std::min(*c1, *c2));
    }
  }
}

int RotationEquations::FindEntry(int row, int column) const {
  const int* begin = laplacian_.innerIndexPtr();
  const int* first = begin + laplacian_.outerIndexPtr()[column];
  const int* last = begin + laplacian_.outerIndexPtr()[column + 1];
  return static_cast<int>(std::lower_bound(first, last, row) - begin);
}

void RotationEquations::AddNodeEntries(size_t e, double weight,
                                       const Vector3d& residual) {
  const RotationEdge& edge = problem_.edges[e];
  const EdgeEntries& entries = entries_[e];
  double* values = laplacian_.valuePtr();
  if (entries.diagonal1) {
    values[*entries.diagonal1] += weight;
    node_gradient_.row(*unknowns_.column_of_node[edge.node1]) -=
        weight * residual.transpose();
  }
  if (entries.diagonal2) {
    values[*entries.diagonal2] += weight;
    node_gradient_.row(*unknowns_.column_of_node[edge.node2]) +=
        weight * residual.transpose();
  }
  if (entries.off_diagonal) values[*entries.off_diagonal] -= weight;
}

void RotationEquations::AddSensorEntries(const RotationEdge& edge,
                                         double weight,
                                         const Vector3d& residual,
                                         const RotationState& state) {
  const std::optional<int> sensors[] = {
      unknowns_.column_of_sensor[edge.sensor1],
      unknowns_.column_of_sensor[edge.sensor2]};
  const std::optional<int> nodes[] = {unknowns_.column_of_node[edge.node1],
                                      unknowns_.column_of_node[edge.node2]};
  const Matrix3d coefficients[] = {
      state.nodes[edge.node1].conjugate().toRotationMatrix(),
      -state.nodes[edge.node2].conjugate().toRotationMatrix()};
  const double node_signs[] = {1.0, -1.0};
  for (int i = 0; i < 2; ++i) {
    if (!sensors[i]) continue;
    const Matrix3d weighted = weight * coefficients[i];
    sensor_gradient_.segment<3>(3 * *sensors[i]) -=
        weighted.transpose() * residual;
    for (int j = 0; j < 2; ++j) {
      if (sensors[j]) {
        sensor_block_.block<3, 3>(3 * *sensors[i], 3 * *sensors[j]) +=
            weighted.transpose() * coefficients[j];
      }
      if (!nodes[j] || edge.node1 == edge.node2) continue;
      for (int column = 0; column < 3; ++column) {
        for (int row = 0; row < 3; ++row) {
          border_(*nodes[j], 3 * (3 * *sensors[i] + column) + row) +=
              node_signs[j] * weighted(row, column);
        }
      }
    }
  }
}

void RotationEquations::Assemble(const std::vector<double>& weights,
                                 const std::vector<Vector3d>& residuals,
                                 const RotationState& state,
                                 const GravityValues& gravity) {
  std::fill_n(laplacian_.valuePtr(), laplacian_.nonZeros(), 0.0);
  node_gradient_.setZero();
  border_.setZero();
  sensor_gradient_.setZero();
  sensor_block_.setZero();
  for (size_t e = 0; e < problem_.edges.size(); ++e) {
    AddNodeEntries(e, weights[e], residuals[e]);
  }
  if (unknowns_.num_sensor_columns > 0) {
    for (size_t e = 0; e < problem_.edges.size(); ++e) {
      AddSensorEntries(problem_.edges[e], weights[e], residuals[e], state);
    }
  }
  if (!unknowns_.leveled_columns.empty()) AddGravity(gravity, state);
}

void RotationEquations::AddGravity(const GravityValues& gravity,
                                   const RotationState& state) {
  leveled_laplacian_ = laplacian_;
  for (size_t i = 0; i < problem_.gravity.size(); ++i) {
    const GravityTerm& term = problem_.gravity[i];
    const int column = *unknowns_.column_of_node[term.node];
    const double weight = gravity.weights[i];
    leveled_laplacian_.valuePtr()[FindEntry(column, column)] += weight;
    node_gradient_.row(column) -= weight * gravity.residuals[i].transpose();
    if (unknowns_.column_of_sensor[term.sensor]) {
      AddGravityOfSensor(term, weight, gravity.residuals[i], state);
    }
  }
  for (const int column : unknowns_.leveled_columns) {
    laplacian_.valuePtr()[FindEntry(column, column)] += 1.0;
  }
}

void RotationEquations::AddGravityOfSensor(const GravityTerm& term,
                                           double weight,
                                           const Vector3d& residual,
                                           const RotationState& state) {
  const int node = *unknowns_.column_of_node[term.node];
  const int sensor = *unknowns_.column_of_sensor[term.sensor];
  Matrix3d coefficients = state.nodes[term.node].conjugate().toRotationMatrix();
  coefficients.row(1).setZero();
  sensor_gradient_.segment<3>(3 * sensor) -=
      weight * coefficients.transpose() * residual;
  sensor_block_.block<3, 3>(3 * sensor, 3 * sensor) +=
      weight * coefficients.transpose() * coefficients;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      border_(node, 3 * (3 * sensor + column) + row) +=
          weight * coefficients(row, column);
    }
  }
}

// Eliminates the nodes; step->nodes must be L^-1 times their gradient.
bool RotationEquations::SolveSensors(RotationStep* step) const {
  if (sensor_gradient_.size() == 0) return true;
  const double mean_diagonal = sensor_block_.diagonal().mean();
  MatrixXd schur = sensor_block_;
  // A sensor without edges, or an axis that no edge constrains, keeps its
  // rotation. The ridge is negligible next to the noise of any real data.
  schur.diagonal().array() += mean_diagonal > 0.0 ? 1e-10 * mean_diagonal : 1.0;
  VectorXd gradient = sensor_gradient_;
  if (border_.rows() > 0) {
    schur -= Stacked(border_).transpose() * Stacked(solved_border_);
    gradient -= Stacked(border_).transpose() * step->nodes.reshaped();
  }
  const Eigen::LLT<MatrixXd> llt(schur);
  if (llt.info() != Eigen::Success) return false;
  const VectorXd solution = llt.solve(gradient);
  step->sensors = solution.reshaped(3, solution.size() / 3);
  if (border_.rows() > 0) {
    step->nodes.reshaped() -= Stacked(solved_border_) * solution;
  }
  return true;
}

// Computes L^-1 times the gradient and the border.
bool RotationEquations::SolveNodes(RotationStep* step) {
  if (!solver_.Factorize(laplacian_)) return false;
  if (unknowns_.leveled_columns.empty()) {
    solver_.Solve(node_gradient_, step->nodes);
    solver_.Solve(border_, solved_border_);
    return true;
  }
  if (!leveled_solver_.Factorize(leveled_laplacian_)) return false;
  const auto solve = [this](const MatrixXd& from, MatrixXd* to) {
    for (Eigen::Index column = 0; column < from.cols(); ++column) {
      const bool is_about_gravity = column % 3 == 1;
      (is_about_gravity ? solver_ : leveled_solver_)
          .Solve(from.col(column), to->col(column));
    }
  };
  solve(node_gradient_, &step->nodes);
  solve(border_, &solved_border_);
  return true;
}

bool RotationEquations::Solve(const std::vector<double>& weights,
                              const std::vector<Vector3d>& residuals,
                              const RotationState& state, RotationStep* step,
                              const GravityValues& gravity) {
  Assemble(weights, residuals, state, gravity);
  step->nodes.resize(unknowns_.num_node_columns, 3);
  step->sensors.resize(3, unknowns_.num_sensor_columns);
  if (unknowns_.num_node_columns > 0 && !SolveNodes(step)) return false;
  return SolveSensors(step) && std::isfinite(step->MaxNorm());
}

}  // namespace mgsfm
