// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rotation_averaging/rotation_averaging.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/graph.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "rotation_averaging/gravity.h"
#include "rotation_averaging/rotation_components.h"
#include "rotation_averaging/rotation_initialization.h"
#include "rotation_averaging/rotation_problem.h"
#include "rotation_averaging/rotation_solver.h"
#include "rotation_averaging/sensor_rotations.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// The arguments of AverageRotations().
struct Input : RotationAveragingInput {
  const RotationAveragingOptions& options;
  const Context& context;

  bool IsJoint() const { return options.strategy == RotationStrategy::kJoint; }
  double MaxErrorRad() const { return DegToRad(options.max_error_deg); }
};

void CheckInput(const Input& input) {
  const int num_images = static_cast<int>(input.scene.images.size());
  MGSFM_CHECK(input.gravity.IsEmpty() ||
              input.gravity.images.size() == input.scene.images.size());
  MGSFM_CHECK_EQ(input.pair_is_used.size(), input.view_graph.pairs.size());
  MGSFM_CHECK(input.start == nullptr ||
              input.start->rig_from_world.size() == input.scene.frames.size());
  bool has_relative_pose = false;
  for (size_t i = 0; i < input.view_graph.pairs.size(); ++i) {
    const ImagePair& pair = input.view_graph.pairs[i];
    MGSFM_CHECK(pair.image_idx1 >= 0 && pair.image_idx1 < num_images);
    MGSFM_CHECK(pair.image_idx2 >= 0 && pair.image_idx2 < num_images);
    MGSFM_CHECK_NE(pair.image_idx1, pair.image_idx2);
    has_relative_pose |= input.pair_is_used[i] && pair.relative_pose;
  }
  if (has_relative_pose) return;
  throw Error("rotation averaging needs relative poses, but none of the " +
              std::to_string(input.pair_is_used.Count()) +
              " image pairs used has one; estimate them first, with "
              "EstimateViewGraph()");
}

bool HasUnknownSensor(const Scene& scene) {
  return std::any_of(
      scene.sensors.begin(), scene.sensors.end(),
      [](const Sensor& sensor) { return !sensor.sensor_from_rig.has_value(); });
}

NodeStart StartOfFrames(const Input& input) {
  if (input.start == nullptr) return {};
  return {input.start->rig_from_world, input.start->component};
}

NodeStart StartOfImages(const Input& input) {
  NodeStart start;
  if (input.start == nullptr) return start;
  for (size_t i = 0; i < input.scene.images.size(); ++i) {
    start.rotations.push_back(
        input.start->CamFromWorld(input.scene, static_cast<int>(i)));
    start.components.push_back(
        input.start->component[input.scene.images[i].frame_idx]);
  }
  return start;
}

ImageRotations NoImageRotations(const Scene& scene) {
  const size_t num_images = scene.images.size();
  return {std::vector<std::optional<Quaterniond>>(num_images),
          std::vector<int>(num_images, 0),
          std::vector<double>(num_images, 0.0)};
}

// Rotations of the images that consistent pairs connect with others.
ImageRotations CollectImageRotations(const Scene& scene,
                                     const RotationProblem& problem,
                                     const RotationState& state,
                                     double max_error_rad) {
  ImageRotations images = NoImageRotations(scene);
  std::vector<GraphEdge> edges;
  for (const RotationEdge& edge : problem.edges) {
    if (RotationResidual(edge, state).norm() > max_error_rad) continue;
    edges.push_back({edge.node1, edge.node2, 1.0});
    images.support[edge.node1] += edge.support;
    images.support[edge.node2] += edge.support;
  }
  images.component =
      FindConnectedComponents(problem.num_nodes, edges).component;
  for (size_t i = 0; i < images.support.size(); ++i) {
    if (images.support[i] > 0.0) images.cam_from_world[i] = state.nodes[i];
  }
  return images;
}

// Step 1.
ImageRotations AverageImages(const Input& input, SolveSummary* summary) {
  if (!HasUnknownSensor(input.scene)) {
    summary->termination = Termination::kConverged;
    summary->message = "Not needed: all sensor_from_rig rotations are known.";
    return NoImageRotations(input.scene);
  }
  const RotationProblem problem =
      BuildImageProblem(input.scene, input.view_graph, input.pair_is_used,
                        input.options)
          .problem;
  RotationState state;
  state.sensors = {Quaterniond::Identity()};
  *summary = AverageNodes(problem, StartOfImages(input), input.options,
                          input.context, &state);
  return CollectImageRotations(input.scene, problem, state,
                               input.MaxErrorRad());
}

// Step 2. With the joint strategy, step 4 determines the sensors that pairs
// within frames do not determine.
SensorRotations EstimateSensors(const Input& input,
                                const ImageRotations& images) {
  SensorRotations sensors =
      EstimateSensorRotations(input.scene, images, input.options);
  for (size_t k = 0; k < input.scene.sensors.size(); ++k) {
    if (sensors.sensor_from_rig[k]) continue;
    SensorRotationSummary& summary = sensors.summaries[k];
    if (input.IsJoint()) {
      sensors.sensor_from_rig[k] = Quaterniond::Identity();
      summary.is_observable = true;
      summary.message = "estimated jointly, from the identity";
    } else {
      input.context.Warning("The sensor_from_rig rotation of sensor " +
                            input.scene.sensors[k].name +
                            " is unknown: " + summary.message + ".");
    }
  }
  return sensors;
}

RotationState MakeState(const SensorFromRig& sensor_from_rig) {
  RotationState state;
  for (const auto& rotation : sensor_from_rig) {
    state.sensors.push_back(rotation.value_or(Quaterniond::Identity()));
  }
  return state;
}

// Step 3. Pairs within a frame do not constrain frames, and their errors would
// distort the scale of the loss.
SolveSummary AverageFrames(const Input& input, const RotationProblem& problem,
                           RotationState* state) {
  const RotationProblem between_frames = WithoutLoops(problem);
  const NodeStart start = StartOfFrames(input);
  if (!input.IsJoint()) {
    return AverageNodes(between_frames, start, input.options, input.context,
                        state);
  }
  InitializeNodes(between_frames, input.MaxErrorRad(), start, state);
  SolveSummary summary;
  summary.termination = Termination::kConverged;
  summary.message = "Only initialized: frames are estimated jointly.";
  return summary;
}

std::vector<GravityTerm> MakeGravityTerms(
    const Input& input, const SensorFromRig& sensor_from_rig) {
  std::vector<GravityTerm> terms;
  if (input.gravity.IsEmpty()) return terms;
  for (size_t i = 0; i < input.scene.images.size(); ++i) {
    const Image& image = input.scene.images[i];
    if (!input.gravity.images[i] || !sensor_from_rig[image.sensor_idx]) {
      continue;
    }
    terms.push_back(
        {image.frame_idx, image.sensor_idx, *input.gravity.images[i]});
  }
  return terms;
}

// Steps 4 and 5. Returns the problem of the pairs kept.
RotationProblem RefineJointly(const Input& input, PairProblem pairs,
                              const SensorFromRig& sensor_from_rig,
                              RotationState* state, SolveSummary* summary) {
  RotationProblem& problem = pairs.problem;
  for (size_t k = 0; k < sensor_from_rig.size(); ++k) {
    problem.sensor_is_free[k] =
        !input.scene.sensors[k].sensor_from_rig && sensor_from_rig[k];
  }
  problem.gravity = MakeGravityTerms(input, sensor_from_rig);
  problem.gravity_sigma_rad = DegToRad(input.options.gravity_sigma_deg);
  if (!problem.gravity.empty()) LevelComponents(problem, state);
  AverageRobust(problem, input.options, input.context, state);
  pairs = KeepConsistentEdges(pairs, *state, input.MaxErrorRad());
  *summary = AverageRobust(pairs.problem, input.options, input.context, state);
  return std::move(pairs.problem);
}

// Tests all pairs, including those that step 5 removed. Components that were
// solved separately have no common world in which to test a pair between them.
Mask FindInliers(const Input& input, const PairProblem& pairs,
                 const RotationProblem& kept, const RotationState& state,
                 std::optional<double>* median_error_deg) {
  Mask is_inlier(input.view_graph.pairs.size(), false);
  const std::vector<int> component = FindComponents(kept).component;
  std::vector<double> errors;
  for (size_t e = 0; e < pairs.pair_idxs.size(); ++e) {
    const RotationEdge& edge = pairs.problem.edges[e];
    if (component[edge.node1] != component[edge.node2]) continue;
    const double error = RotationResidual(edge, state).norm();
    if (error > input.MaxErrorRad()) continue;
    is_inlier[pairs.pair_idxs[e]] = true;
    errors.push_back(error);
  }
  if (!errors.empty()) *median_error_deg = RadToDeg(Median(std::move(errors)));
  return is_inlier;
}

RotationEstimate MakeEstimate(const Input& input, SensorFromRig sensor_from_rig,
                              const RotationState& state,
                              const Mask& is_inlier) {
  RotationEstimate estimate;
  estimate.rig_from_world.assign(state.nodes.begin(), state.nodes.end());
  estimate.sensor_from_rig = std::move(sensor_from_rig);
  for (size_t k = 0; k < state.sensors.size(); ++k) {
    auto& rotation = estimate.sensor_from_rig[k];
    if (rotation) rotation = state.sensors[k];
  }
  return RestrictToPairs(input.scene, input.view_graph, is_inlier,
                         std::move(estimate));
}

}  // namespace

RotationResult AverageRotations(const RotationAveragingInput& measured,
                                const RotationAveragingOptions& options,
                                const Context& context) {
  const Input input{measured, options, context};
  CheckInput(input);
  constexpr int kNumSteps = 4;  // the reports below
  const auto report = [&](int num_done) {
    context.ReportProgress("rotation averaging", num_done, kNumSteps);
  };
  RotationResult result;
  RotationSummary& summary = result.summary;
  const ImageRotations images = AverageImages(input, &summary.images);
  report(1);
  SensorRotations sensors = EstimateSensors(input, images);
  summary.sensors = std::move(sensors.summaries);
  report(2);
  const PairProblem pairs =
      BuildFrameProblem(input.scene, input.view_graph, input.pair_is_used,
                        sensors.sensor_from_rig, options);
  RotationState state = MakeState(sensors.sensor_from_rig);
  summary.frames = AverageFrames(input, pairs.problem, &state);
  report(3);
  Mask is_inlier(input.view_graph.pairs.size(), false);
  if (summary.frames.IsUsable()) {
    RotationProblem kept = pairs.problem;
    if (!pairs.problem.edges.empty()) {
      kept = RefineJointly(input, pairs, sensors.sensor_from_rig, &state,
                           &summary.joint);
    }
    is_inlier =
        FindInliers(input, pairs, kept, state, &summary.median_error_deg);
  }
  result.estimate =
      MakeEstimate(input, std::move(sensors.sensor_from_rig), state, is_inlier);
  SummarizeEstimate(input.scene, input.view_graph, result.estimate,
                    input.gravity, options, &summary);
  report(kNumSteps);
  return result;
}

}  // namespace mgsfm
