// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rotation_averaging/rotation_averaging.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/graph.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "rotation_averaging/geodesic_median.h"
#include "rotation_averaging/hand_eye.h"
#include "rotation_averaging/rotation_estimation.h"
#include "rotation_averaging/rotation_initialization.h"
#include "rotation_averaging/rotation_problem.h"
#include "rotation_averaging/rotation_solver.h"

namespace mgsfm {
namespace {

// Rotations of single images, ignoring rigs. Each connected component has its
// own world.
struct ImageRotations {
  std::vector<std::optional<Eigen::Quaterniond>> cam_from_world;  // per image
  std::vector<int> component;                                     // per image
  std::vector<double> support;  // per image: matches in consistent pairs
};

struct SensorRotations {
  std::vector<std::optional<Eigen::Quaterniond>> sensor_from_rig;
  std::vector<SensorRotationSummary> summaries;
};

using Eigen::Quaterniond;

// Larger rotations are excluded from hand-eye calibration: near 180 deg, a
// small error flips the sign of the logarithm.
constexpr double kMaxMotionRad = DegToRad(150.0);
// Number of evenly spaced frames from longer sequences. Bounds the quadratic
// number of motions: 64 frames have 2016.
constexpr size_t kMaxNumHandEyeFrames = 64;

// Rotations of a sensor and of its rig in one frame, each in the world of its
// component.
struct HandEyeFrame {
  Quaterniond sensor_from_world1;
  Quaterniond rig_from_world2;
};

std::vector<HandEyeFrame> Thin(const std::vector<HandEyeFrame>& frames) {
  if (frames.size() <= kMaxNumHandEyeFrames) return frames;
  std::vector<HandEyeFrame> thinned;
  for (size_t i = 0; i < kMaxNumHandEyeFrames; ++i) {
    thinned.push_back(frames[i * frames.size() / kMaxNumHandEyeFrames]);
  }
  return thinned;
}

void AddMotions(const std::vector<HandEyeFrame>& frames,
                std::vector<MotionPair>* motions) {
  for (size_t i = 0; i < frames.size(); ++i) {
    for (size_t j = i + 1; j < frames.size(); ++j) {
      const MotionPair motion{LogSO3(frames[j].sensor_from_world1 *
                                     frames[i].sensor_from_world1.conjugate()),
                              LogSO3(frames[j].rig_from_world2 *
                                     frames[i].rig_from_world2.conjugate())};
      if (motion.alpha.norm() <= kMaxMotionRad &&
          motion.beta.norm() <= kMaxMotionRad) {
        motions->push_back(motion);
      }
    }
  }
}

struct Samples {
  std::vector<Quaterniond> rotations;
  std::vector<double> weights;
};

struct Motions {
  std::vector<MotionPair> pairs;
  int num_frames = 0;
};

// The sensors determined so far.
struct DeterminedSensors {
  SensorRotations result;
  // Per sensor: its position in the order in which sensors were determined.
  std::vector<std::optional<int>> rank;
  int num_determined = 0;
  Mask samples_disagree;  // per sensor: its median was refused

  void SetDetermined(int sensor_idx, const Quaterniond& sensor_from_rig) {
    rank[sensor_idx] = num_determined++;
    result.sensor_from_rig[sensor_idx] = sensor_from_rig;
    result.summaries[sensor_idx].is_observable = true;
  }
};

// Reference sensors come first, so that samples prefer them.
DeterminedSensors StartWithKnownSensors(const Scene& scene) {
  const size_t num_sensors = scene.sensors.size();
  DeterminedSensors sensors;
  sensors.result.sensor_from_rig.resize(num_sensors);
  sensors.result.summaries.resize(num_sensors);
  sensors.rank.resize(num_sensors);
  sensors.samples_disagree.resize(num_sensors);
  for (const bool is_reference : {true, false}) {
    for (size_t k = 0; k < num_sensors; ++k) {
      const int sensor_idx = static_cast<int>(k);
      const auto& sensor_from_rig = scene.sensors[k].sensor_from_rig;
      if (!sensor_from_rig || scene.IsReference(sensor_idx) != is_reference) {
        continue;
      }
      sensors.SetDetermined(sensor_idx,
                            ToUnitQuaternion(sensor_from_rig->rotation));
      sensors.result.summaries[k].message =
          is_reference ? "reference sensor" : "known";
    }
  }
  return sensors;
}

// The image by a sensor, if it has a rotation.
std::optional<int> FindImage(const Scene& scene, const ImageRotations& images,
                             const Frame& frame, int sensor_idx) {
  for (const int image_idx : frame.image_idxs) {
    if (scene.images[image_idx].sensor_idx == sensor_idx &&
        images.cam_from_world[image_idx]) {
      return image_idx;
    }
  }
  return std::nullopt;
}

// The image with a rotation whose sensor was determined first; only in
// `component` if given.
std::optional<int> FindDeterminedImage(const Scene& scene,
                                       const ImageRotations& images,
                                       const DeterminedSensors& sensors,
                                       const Frame& frame,
                                       std::optional<int> component) {
  std::optional<int> best;
  const auto rank = [&](int image_idx) {
    return sensors.rank[scene.images[image_idx].sensor_idx];
  };
  for (const int image_idx : frame.image_idxs) {
    if (!rank(image_idx) || !images.cam_from_world[image_idx]) continue;
    if (component && images.component[image_idx] != *component) continue;
    if (!best || *rank(image_idx) < *rank(*best)) best = image_idx;
  }
  return best;
}

Samples CollectSamples(const Scene& scene, const ImageRotations& images,
                       const DeterminedSensors& sensors, int sensor_idx) {
  Samples samples;
  for (const Frame& frame : scene.frames) {
    if (frame.rig_idx != scene.sensors[sensor_idx].rig_idx) continue;
    const std::optional<int> k = FindImage(scene, images, frame, sensor_idx);
    if (!k) continue;
    const std::optional<int> a = FindDeterminedImage(
        scene, images, sensors, frame, images.component[*k]);
    if (!a) continue;
    samples.rotations.push_back(
        *images.cam_from_world[*k] * images.cam_from_world[*a]->conjugate() *
        *sensors.result.sensor_from_rig[scene.images[*a].sensor_idx]);
    samples.weights.push_back(
        std::max(1.0, std::min(images.support[*k], images.support[*a])));
  }
  return samples;
}

bool AcceptMedian(int sensor_idx, const Samples& samples, double max_error_deg,
                  DeterminedSensors* sensors) {
  const GeodesicMedian median = FindGeodesicMedian(
      samples.rotations, samples.weights, DegToRad(max_error_deg));
  SensorRotationSummary& summary = sensors->result.summaries[sensor_idx];
  const double deviation_deg = RadToDeg(median.median_deviation_rad);
  summary.num_samples = static_cast<int>(samples.rotations.size());
  summary.median_deviation_deg = deviation_deg;
  if (!median.summary.IsUsable() || deviation_deg > max_error_deg) {
    summary.message =
        Formatted("samples disagree: %.3g deg median deviation in %d frames",
                  deviation_deg, summary.num_samples);
    return false;
  }
  sensors->SetDetermined(sensor_idx, median.rotation);
  summary.message = Formatted("median of %d frames, %.3g deg median deviation",
                              summary.num_samples, deviation_deg);
  return true;
}

// Determines the sensor with most samples among those whose samples agree.
// False if there is none.
bool DetermineBySamples(const Scene& scene, const ImageRotations& images,
                        double max_error_deg, DeterminedSensors* sensors) {
  while (true) {
    std::optional<int> best;
    Samples best_samples;
    for (size_t k = 0; k < scene.sensors.size(); ++k) {
      if (sensors->rank[k] || sensors->samples_disagree[k]) continue;
      const int sensor_idx = static_cast<int>(k);
      Samples samples = CollectSamples(scene, images, *sensors, sensor_idx);
      if (samples.rotations.size() > best_samples.rotations.size()) {
        best = sensor_idx;
        best_samples = std::move(samples);
      }
    }
    if (!best) return false;
    if (AcceptMedian(*best, best_samples, max_error_deg, sensors)) return true;
    sensors->samples_disagree[*best] = true;
  }
}

// The motions of all pairs of frames in which the sensor stays in one component
// and the rest of the rig in one component; and the number of these frames.
Motions CollectMotions(const Scene& scene, const ImageRotations& images,
                       const DeterminedSensors& sensors, int sensor_idx) {
  std::map<std::pair<int, int>, std::vector<HandEyeFrame>> frames_of_components;
  for (const Frame& frame : scene.frames) {
    if (frame.rig_idx != scene.sensors[sensor_idx].rig_idx) continue;
    const std::optional<int> k = FindImage(scene, images, frame, sensor_idx);
    const std::optional<int> a =
        FindDeterminedImage(scene, images, sensors, frame, std::nullopt);
    if (!k || !a) continue;
    const Quaterniond& S_a =
        *sensors.result.sensor_from_rig[scene.images[*a].sensor_idx];
    frames_of_components[{images.component[*k], images.component[*a]}]
        .push_back({*images.cam_from_world[*k],
                    S_a.conjugate() * *images.cam_from_world[*a]});
  }
  Motions motions;
  for (const auto& [components, frames] : frames_of_components) {
    if (frames.size() < 2) continue;
    motions.num_frames += static_cast<int>(frames.size());
    AddMotions(Thin(frames), &motions.pairs);
  }
  return motions;
}

bool AcceptHandEye(int sensor_idx, const Motions& motions,
                   const RotationAveragingOptions& options,
                   DeterminedSensors* sensors) {
  SensorRotationSummary& summary = sensors->result.summaries[sensor_idx];
  const std::string prefix =
      sensors->samples_disagree[sensor_idx] ? summary.message + "; " : "";
  if (motions.pairs.empty()) {
    summary.message = prefix +
                      "not observable: no frame has rotations both of this "
                      "sensor and of another one of its rig";
    return false;
  }
  const HandEyeResult hand_eye =
      CalibrateHandEye(motions.pairs, motions.num_frames);
  const double second_axis_deg = RadToDeg(hand_eye.second_axis_rms_rad);
  const double error_deg = RadToDeg(hand_eye.median_error_rad);
  // Pairs of the sensor stay well within max_error_deg if the standard
  // deviation is at most a fifth of it.
  if (second_axis_deg < options.min_hand_eye_rotation_deg ||
      error_deg > options.max_error_deg ||
      RadToDeg(hand_eye.uncertainty_rad) > 0.2 * options.max_error_deg) {
    summary.message =
        prefix +
        Formatted(
            "not observable: no pairs connect it with the other sensors, "
            "and the rig rotated only %.3g deg about a second axis "
            "(median error %.3g deg)",
            second_axis_deg, error_deg);
    return false;
  }
  summary.num_samples = motions.num_frames;
  summary.median_deviation_deg = error_deg;
  summary.message =
      prefix + Formatted(
                   "hand-eye calibration with rotations of %.3g deg about a "
                   "second axis, %.3g deg median error",
                   second_axis_deg, error_deg);
  sensors->SetDetermined(sensor_idx, hand_eye.a_from_b);
  return true;
}

bool DetermineByHandEye(const Scene& scene, const ImageRotations& images,
                        const RotationAveragingOptions& options,
                        DeterminedSensors* sensors) {
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    if (sensors->rank[k]) continue;
    const int sensor_idx = static_cast<int>(k);
    if (AcceptHandEye(sensor_idx,
                      CollectMotions(scene, images, *sensors, sensor_idx),
                      options, sensors)) {
      return true;
    }
  }
  return false;
}

// The sensor_from_rig rotations S_k (step 2 of rotation_averaging.h).
//
// A sensor is determined once S_k is known. Each frame with images of an
// undetermined sensor k and a determined sensor a in the same component gives a
// sample R_k R_a^T S_a; a is the sensor of the frame that was determined first.
// The sensor with most samples is next: S_k is the geodesic L1 median of its
// samples, each weighted with the smaller support of its two images. The result
// is rejected if the median deviation of the samples exceeds max_error_deg.
//
// If no sensor has samples, hand-eye calibration is tried with all pairs of
// frames in which sensor k is in one component and determined sensors are in
// another. The result is rejected if the rotations about the second axis are
// below min_hand_eye_rotation_deg, the median error exceeds max_error_deg, or
// the uncertainty exceeds max_error_deg / 5.
SensorRotations EstimateSensorRotations(
    const Scene& scene, const ImageRotations& images,
    const RotationAveragingOptions& options) {
  DeterminedSensors sensors = StartWithKnownSensors(scene);
  while (DetermineBySamples(scene, images, options.max_error_deg, &sensors) ||
         DetermineByHandEye(scene, images, options, &sensors)) {
  }
  return std::move(sensors.result);
}

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
  return AnyOf(scene.sensors, [](const Sensor& sensor) {
    return !sensor.sensor_from_rig.has_value();
  });
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
