// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_problem.h"

#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "base/ranges.h"
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
  return Transformed(residuals, [](const Vector3d& r) { return r.norm(); });
}

ConnectedComponents FindComponents(const RotationProblem& problem) {
  return FindConnectedComponents(
      problem.num_nodes,
      Transformed(problem.edges, [](const RotationEdge& edge) {
        return GraphEdge{edge.node1, edge.node2, 1.0};
      }));
}

namespace {

RotationEdge MakeEdge(const ImagePair& pair,
                      const RotationAveragingOptions& options) {
  RotationEdge edge;
  edge.cam2_from_cam1 = pair.relative_pose->cam2_from_cam1.normalized();
  edge.support = std::max<double>(1.0, pair.matches.size());
  const double share =
      std::min(1.0, edge.support / static_cast<double>(options.inlier_cap));
  edge.weight = std::sqrt(share);
  // The inverse variance for matches with independent errors.
  edge.final_weight = share;
  return edge;
}

}  // namespace

PairProblem BuildImageProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const RotationAveragingOptions& options) {
  const bool is_joint = options.strategy == RotationStrategy::kJoint;
  PairProblem pairs;
  pairs.problem.num_nodes = static_cast<int>(scene.images.size());
  pairs.problem.sensor_is_free = {false};
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i] || !pair.relative_pose) continue;
    if (is_joint && scene.images[pair.image_idx1].frame_idx !=
                        scene.images[pair.image_idx2].frame_idx) {
      continue;
    }
    RotationEdge edge = MakeEdge(pair, options);
    edge.node1 = pair.image_idx1;
    edge.node2 = pair.image_idx2;
    pairs.problem.edges.push_back(edge);
    pairs.pair_idxs.push_back(i);
  }
  return pairs;
}

bool IsUsable(const Scene& scene, const ImagePair& pair,
              const SensorFromRig& sensor_from_rig) {
  return pair.relative_pose &&
         sensor_from_rig[scene.images[pair.image_idx1].sensor_idx] &&
         sensor_from_rig[scene.images[pair.image_idx2].sensor_idx];
}

PairProblem BuildFrameProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const SensorFromRig& sensor_from_rig,
                              const RotationAveragingOptions& options) {
  PairProblem pairs;
  pairs.problem.num_nodes = static_cast<int>(scene.frames.size());
  pairs.problem.sensor_is_free.assign(scene.sensors.size(), false);
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i] || !IsUsable(scene, pair, sensor_from_rig)) continue;
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    RotationEdge edge = MakeEdge(pair, options);
    edge.node1 = image1.frame_idx;
    edge.node2 = image2.frame_idx;
    edge.sensor1 = image1.sensor_idx;
    edge.sensor2 = image2.sensor_idx;
    pairs.problem.edges.push_back(edge);
    pairs.pair_idxs.push_back(i);
  }
  return pairs;
}

RotationProblem WithoutLoops(const RotationProblem& problem) {
  RotationProblem without_loops = problem;
  auto& edges = without_loops.edges;
  EraseIf(&edges,
          [](const RotationEdge& edge) { return edge.node1 == edge.node2; });
  return without_loops;
}

PairProblem KeepConsistentEdges(const PairProblem& pairs,
                                const RotationState& state,
                                double max_error_rad) {
  PairProblem kept = pairs;
  kept.problem.edges.clear();
  kept.pair_idxs.clear();
  for (size_t e = 0; e < pairs.pair_idxs.size(); ++e) {
    const RotationEdge& edge = pairs.problem.edges[e];
    if (RotationResidual(edge, state).norm() > max_error_rad) continue;
    kept.problem.edges.push_back(edge);
    kept.pair_idxs.push_back(pairs.pair_idxs[e]);
  }
  return kept;
}

}  // namespace mgsfm
