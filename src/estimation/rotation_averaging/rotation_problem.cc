// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_problem.h"

#include <cmath>

#include "base/parallel.h"
#include "geometry/so3.h"

namespace mgsfm {

using Eigen::Vector3d;

Vector3d RotationResidual(const RotationEdge& edge,
                          const RotationState& state) {
  const Eigen::Quaterniond cam1 =
      state.sensors[edge.sensor1] * state.nodes[edge.node1];
  const Eigen::Quaterniond cam2 =
      state.sensors[edge.sensor2] * state.nodes[edge.node2];
  return LogSO3(cam2.conjugate() * edge.cam2_from_cam1 * cam1);
}

Vector3d GravityResidual(const GravityTerm& term, const RotationState& state) {
  const Vector3d v =
      (state.sensors[term.sensor] * state.nodes[term.node]).conjugate() *
      term.direction;
  const double sine = std::hypot(v.x(), v.z());
  if (sine == 0.0) return Vector3d(v.y() > 0.0 ? 0.0 : kPi, 0.0, 0.0);
  return std::atan2(sine, v.y()) / sine * Vector3d(-v.z(), 0.0, v.x());
}

void ComputeResiduals(const RotationProblem& problem,
                      const RotationState& state, int num_threads,
                      std::vector<Vector3d>* residuals) {
  residuals->resize(problem.edges.size());
  ParallelFor(
      problem.edges.size(), num_threads,
      [&](size_t e) {
        (*residuals)[e] = RotationResidual(problem.edges[e], state);
      },
      /*block_size=*/4096);  // less work does not justify a thread
}

std::vector<double> Norms(const std::vector<Vector3d>& residuals) {
  std::vector<double> norms;
  norms.reserve(residuals.size());
  for (const Vector3d& r : residuals) norms.push_back(r.norm());
  return norms;
}

ConnectedComponents FindComponents(const RotationProblem& problem) {
  std::vector<GraphEdge> edges;
  edges.reserve(problem.edges.size());
  for (const RotationEdge& edge : problem.edges) {
    edges.push_back({edge.node1, edge.node2, 1.0});
  }
  return FindConnectedComponents(problem.num_nodes, edges);
}

}  // namespace mgsfm
