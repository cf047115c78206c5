// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rotation/rotation_averaging.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/spanning_tree.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/skeletal_graph.h"
#include "pair_filtering/unsupported_bridges.h"
#include "priors/gravity_levelling.h"
#include "rotation/gravity.h"
#include "rotation/rotation_initialization.h"
#include "rotation/rotation_problem.h"
#include "rotation/rotation_solver.h"
#include "rotation/sensor_rotations.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// A problem and, per edge, the pair of the view graph it comes from.
struct PairProblem {
  RotationProblem problem;
  std::vector<size_t> pair_idxs;
};

RotationEdge MakeEdge(const ImagePair& pair,
                      const RotationAveragingOptions& options) {
  RotationEdge edge;
  edge.cam2_from_cam1 = pair.relative_pose->cam2_from_cam1.normalized();
  edge.support = std::max<double>(1.0, pair.matches.size());
  const double cap = options.inlier_cap;
  edge.weight = std::sqrt(std::min(edge.support, cap) / cap);
  return edge;
}

class RotationAverager {
 public:
  RotationAverager(const Scene& scene, const ViewGraph& view_graph,
                   const Mask& pair_is_used, const RotationEstimate* start,
                   const GravityPriors& gravity,
                   const RotationAveragingOptions& options,
                   const Context& context)
      : scene_(scene),
        view_graph_(view_graph),
        pair_is_used_(pair_is_used),
        start_(start),
        gravity_(gravity),
        options_(options),
        context_(context),
        max_error_(DegToRad(options.max_error_deg)) {}

  RotationResult Run() {
    constexpr int kNumSteps = 4;
    const auto report = [this](int num_done) {
      context_.ReportProgress("rotation averaging", num_done, kNumSteps);
    };
    const ImageRotations images =
        HasUnknownSensor() ? AverageImages() : NoImages();
    report(1);
    SensorRotations internal =
        EstimateSensorRotations(scene_, images, options_);
    if (IsJoint()) StartTheOthers(&internal);
    SetSensorRotations(std::move(internal));
    report(2);
    if (AverageFrames() && !pairs_.problem.edges.empty()) {
      report(3);
      AddGravity();
      RefineJointly();
      KeepConsistentPairs();
      RefineJointly();
    }
    JudgePairs();
    RejectUnsupportedBridges();
    NumberComponents();
    WriteSensorRotations();
    CountPairs();
    SummarizeGravity();
    report(kNumSteps);
    return std::move(result_);
  }

 private:
  bool IsJoint() const { return options_.strategy == RotationStrategy::kJoint; }
  bool HasUnknownSensor() const;
  ImageRotations NoImages();
  ImageRotations AverageImages();
  NodeStart StartOfImages() const;
  NodeStart StartOfFrames() const;
  PairProblem BuildImageProblem() const;
  ImageRotations CollectImageRotations(const PairProblem& pairs,
                                       const RotationState& state) const;
  void StartTheOthers(SensorRotations* internal) const;
  void SetSensorRotations(SensorRotations internal);
  bool IsUsable(const ImagePair& pair) const;
  PairProblem BuildFrameProblem() const;
  bool AverageFrames();
  void AddGravity();
  void RefineJointly();
  void KeepConsistentPairs();
  void JudgePairs();
  void RejectUnsupportedBridges();
  void NumberComponents();
  void WriteSensorRotations();
  void CountPairs();
  void SummarizeGravity();
  std::vector<GraphEdge> InlierFrameEdges() const;

  int FrameOf(int image_idx) const {
    return scene_.images[image_idx].frame_idx;
  }
  int SensorOf(int image_idx) const {
    return scene_.images[image_idx].sensor_idx;
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const Mask& pair_is_used_;
  const RotationEstimate* start_;  // null: none
  const GravityPriors& gravity_;
  const RotationAveragingOptions& options_;
  const Context& context_;
  const double max_error_;
  PairProblem pairs_;    // of frames
  RotationState state_;  // of frames and sensors
  bool has_frames_ = false;
  RotationResult result_;
};

bool RotationAverager::HasUnknownSensor() const {
  return std::any_of(
      scene_.sensors.begin(), scene_.sensors.end(),
      [](const Sensor& sensor) { return !sensor.sensor_from_rig.has_value(); });
}

ImageRotations RotationAverager::NoImages() {
  SolveSummary& summary = result_.summary.images;
  summary.termination = Termination::kConverged;
  summary.message = "Not needed: all internal rotations are known.";
  ImageRotations images;
  images.cam_from_world.resize(scene_.images.size());
  images.component.resize(scene_.images.size());
  images.support.resize(scene_.images.size());
  return images;
}

// Every image is a node, and all are of one sensor with the identity. Of the
// joint strategy only frames by themselves are solved.
PairProblem RotationAverager::BuildImageProblem() const {
  PairProblem pairs;
  pairs.problem.num_nodes = static_cast<int>(scene_.images.size());
  pairs.problem.sensor_is_free = {0};
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const ImagePair& pair = view_graph_.pairs[i];
    if (!pair_is_used_[i] || !pair.relative_pose) continue;
    if (IsJoint() && FrameOf(pair.image_idx1) != FrameOf(pair.image_idx2)) {
      continue;
    }
    RotationEdge edge = MakeEdge(pair, options_);
    edge.node1 = pair.image_idx1;
    edge.node2 = pair.image_idx2;
    pairs.problem.edges.push_back(edge);
    pairs.pair_idxs.push_back(i);
  }
  return pairs;
}

NodeStart RotationAverager::StartOfFrames() const {
  if (start_ == nullptr) return {};
  return {start_->rig_from_world, start_->component};
}

NodeStart RotationAverager::StartOfImages() const {
  NodeStart start;
  if (start_ == nullptr) return start;
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    start.rotations.push_back(start_->CamFromWorld(scene_, image_idx));
    start.parts.push_back(start_->component[FrameOf(image_idx)]);
  }
  return start;
}

ImageRotations RotationAverager::AverageImages() {
  const PairProblem pairs = BuildImageProblem();
  RotationState state;
  state.sensors = {Quaterniond::Identity()};
  result_.summary.images =
      AverageNodes(pairs.problem, StartOfImages(), options_, context_, &state);
  return CollectImageRotations(pairs, state);
}

// Of images that consistent pairs connect with others.
ImageRotations RotationAverager::CollectImageRotations(
    const PairProblem& pairs, const RotationState& state) const {
  const size_t num_images = scene_.images.size();
  ImageRotations images;
  images.cam_from_world.resize(num_images);
  images.support.resize(num_images, 0.0);
  std::vector<GraphEdge> edges;
  for (const RotationEdge& edge : pairs.problem.edges) {
    if (RotationResidual(edge, state).norm() > max_error_) continue;
    edges.push_back({edge.node1, edge.node2, 1.0});
    images.support[edge.node1] += edge.support;
    images.support[edge.node2] += edge.support;
  }
  images.component =
      FindConnectedComponents(static_cast<int>(num_images), edges).component;
  for (size_t i = 0; i < num_images; ++i) {
    if (images.support[i] > 0.0) images.cam_from_world[i] = state.nodes[i];
  }
  return images;
}

// What frames by themselves do not tell, the joint solve must find.
void RotationAverager::StartTheOthers(SensorRotations* internal) const {
  for (size_t k = 0; k < scene_.sensors.size(); ++k) {
    if (internal->sensor_from_rig[k]) continue;
    internal->sensor_from_rig[k] = Quaterniond::Identity();
    internal->summaries[k].is_observable = true;
    internal->summaries[k].message = "Found jointly, from the identity";
  }
}

void RotationAverager::SetSensorRotations(SensorRotations internal) {
  state_.sensors.assign(scene_.sensors.size(), Quaterniond::Identity());
  for (size_t k = 0; k < scene_.sensors.size(); ++k) {
    if (internal.sensor_from_rig[k]) {
      state_.sensors[k] = *internal.sensor_from_rig[k];
      continue;
    }
    context_.Warning(
        "Sensor " + scene_.sensors[k].name +
        " has no internal rotation: " + internal.summaries[k].message + ".");
  }
  result_.estimate.sensor_from_rig = std::move(internal.sensor_from_rig);
  result_.summary.sensors = std::move(internal.summaries);
}

// With a relative rotation, between images of sensors with internal rotation.
bool RotationAverager::IsUsable(const ImagePair& pair) const {
  const auto& sensor_from_rig = result_.estimate.sensor_from_rig;
  return pair.relative_pose && sensor_from_rig[SensorOf(pair.image_idx1)] &&
         sensor_from_rig[SensorOf(pair.image_idx2)];
}

PairProblem RotationAverager::BuildFrameProblem() const {
  PairProblem pairs;
  pairs.problem.num_nodes = static_cast<int>(scene_.frames.size());
  pairs.problem.sensor_is_free.assign(scene_.sensors.size(), 0);
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const ImagePair& pair = view_graph_.pairs[i];
    if (!pair_is_used_[i] || !IsUsable(pair)) continue;
    RotationEdge edge = MakeEdge(pair, options_);
    edge.node1 = FrameOf(pair.image_idx1);
    edge.node2 = FrameOf(pair.image_idx2);
    edge.sensor1 = SensorOf(pair.image_idx1);
    edge.sensor2 = SensorOf(pair.image_idx2);
    pairs.problem.edges.push_back(edge);
    pairs.pair_idxs.push_back(i);
  }
  return pairs;
}

// Step 3. Pairs inside a frame say nothing of frames; they are left out here,
// for their errors would blur the scale of the others.
bool RotationAverager::AverageFrames() {
  pairs_ = BuildFrameProblem();
  RotationProblem between_frames = pairs_.problem;
  auto& edges = between_frames.edges;
  edges.erase(std::remove_if(edges.begin(), edges.end(),
                             [](const RotationEdge& edge) {
                               return edge.node1 == edge.node2;
                             }),
              edges.end());
  if (IsJoint()) {
    InitializeNodes(between_frames, max_error_, StartOfFrames(), &state_);
    result_.summary.frames.termination = Termination::kConverged;
    result_.summary.frames.message = "Only a start: all are solved jointly.";
    has_frames_ = true;
    return true;
  }
  result_.summary.frames = AverageNodes(between_frames, StartOfFrames(),
                                        options_, context_, &state_);
  has_frames_ = result_.summary.frames.IsUsable();
  return has_frames_;
}

// Also turns the world of each part so that gravity is along y.
void RotationAverager::AddGravity() {
  if (gravity_.IsEmpty()) return;
  RotationProblem& problem = pairs_.problem;
  problem.gravity_sigma_rad = DegToRad(options_.gravity_sigma_deg);
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    const int sensor = SensorOf(static_cast<int>(i));
    if (!gravity_.images[i] || !result_.estimate.sensor_from_rig[sensor]) {
      continue;
    }
    problem.gravity.push_back(
        {FrameOf(static_cast<int>(i)), sensor, *gravity_.images[i]});
  }
  LevelParts(problem, &state_);
}

void RotationAverager::SummarizeGravity() {
  if (gravity_.IsEmpty()) return;
  std::vector<std::optional<Quaterniond>> cam_from_world;
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    cam_from_world.push_back(
        result_.estimate.CamFromWorld(scene_, static_cast<int>(i)));
  }
  result_.summary.gravity =
      JudgeGravity(gravity_, cam_from_world, options_.gravity_sigma_deg);
}

// Step 4. After a failure the state is what it was.
void RotationAverager::RefineJointly() {
  for (size_t k = 0; k < scene_.sensors.size(); ++k) {
    pairs_.problem.sensor_is_free[k] =
        !scene_.sensors[k].sensor_from_rig &&
        result_.estimate.sensor_from_rig[k].has_value();
  }
  result_.summary.joint =
      AverageRobust(pairs_.problem, options_, context_, &state_);
}

void RotationAverager::KeepConsistentPairs() {
  PairProblem kept;
  kept.problem = pairs_.problem;
  kept.problem.edges.clear();
  for (size_t e = 0; e < pairs_.pair_idxs.size(); ++e) {
    const RotationEdge& edge = pairs_.problem.edges[e];
    if (RotationResidual(edge, state_).norm() > max_error_) continue;
    kept.problem.edges.push_back(edge);
    kept.pair_idxs.push_back(pairs_.pair_idxs[e]);
  }
  pairs_ = std::move(kept);
}

// All usable pairs, also those that were dropped on the way; but two parts that
// were solved apart have no common world in which a pair could be judged.
void RotationAverager::JudgePairs() {
  Mask& is_inlier = result_.estimate.pair_is_inlier;
  is_inlier.assign(view_graph_.pairs.size(), 0);
  if (!has_frames_) return;
  const ConnectedComponents parts = FindParts(pairs_.problem);
  const PairProblem all = BuildFrameProblem();
  std::vector<double> errors;
  for (size_t e = 0; e < all.pair_idxs.size(); ++e) {
    const RotationEdge& edge = all.problem.edges[e];
    if (parts.component[edge.node1] != parts.component[edge.node2]) continue;
    const double error = RotationResidual(edge, state_).norm();
    if (error > max_error_) continue;
    is_inlier[all.pair_idxs[e]] = 1;
    errors.push_back(error);
  }
  if (!errors.empty()) {
    result_.summary.median_error_deg = RadToDeg(Median(std::move(errors)));
  }
}

// Of all pairs, not of those of a backbone that is but a start.
void RotationAverager::RejectUnsupportedBridges() {
  if (start_ == nullptr) return;
  const Mask is_unsupported = FindUnsupportedBridges(
      scene_, view_graph_, result_.estimate.pair_is_inlier,
      context_.num_threads);
  for (size_t i = 0; i < is_unsupported.size(); ++i) {
    if (!is_unsupported[i]) continue;
    result_.estimate.pair_is_inlier[i] = 0;
    ++result_.summary.num_unsupported_bridges;
    const ImagePair& pair = view_graph_.pairs[i];
    context_.Warning("The images '" + scene_.images[pair.image_idx1].name +
                     "' and '" + scene_.images[pair.image_idx2].name +
                     "' alone would join two parts of the frames; no third "
                     "image confirms their matches, and other pairs "
                     "contradict. The parts are left apart.");
  }
}

std::vector<GraphEdge> RotationAverager::InlierFrameEdges() const {
  std::vector<GraphEdge> edges;
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    if (!result_.estimate.pair_is_inlier[i]) continue;
    const ImagePair& pair = view_graph_.pairs[i];
    const int frame1 = FrameOf(pair.image_idx1);
    const int frame2 = FrameOf(pair.image_idx2);
    if (frame1 != frame2) edges.push_back({frame1, frame2, 1.0});
  }
  return edges;
}

// Frames that no consistent pair connects with another have no rotation.
void RotationAverager::NumberComponents() {
  RotationEstimate& estimate = result_.estimate;
  const int num_frames = static_cast<int>(scene_.frames.size());
  const ConnectedComponents parts =
      FindConnectedComponents(num_frames, InlierFrameEdges());
  std::vector<int> size(parts.num_components, 0);
  for (const int part : parts.component) ++size[part];
  std::vector<int> by_size(parts.num_components);
  std::iota(by_size.begin(), by_size.end(), 0);
  std::stable_sort(by_size.begin(), by_size.end(),
                   [&](int a, int b) { return size[a] > size[b]; });
  std::vector<int> number(parts.num_components);
  for (int i = 0; i < parts.num_components; ++i) number[by_size[i]] = i;

  estimate.rig_from_world.resize(num_frames);
  estimate.component.resize(num_frames);
  for (int frame = 0; frame < num_frames; ++frame) {
    const int part = parts.component[frame];
    if (size[part] < 2) continue;
    estimate.rig_from_world[frame] = state_.nodes[frame];
    estimate.component[frame] = number[part];
  }
  result_.summary.num_components = static_cast<int>(
      std::count_if(size.begin(), size.end(), [](int s) { return s >= 2; }));
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const int frame = FrameOf(view_graph_.pairs[i].image_idx1);
    if (!estimate.rig_from_world[frame]) estimate.pair_is_inlier[i] = 0;
  }
}

void RotationAverager::WriteSensorRotations() {
  for (size_t k = 0; k < scene_.sensors.size(); ++k) {
    auto& sensor_from_rig = result_.estimate.sensor_from_rig[k];
    if (sensor_from_rig) sensor_from_rig = state_.sensors[k];
  }
}

void RotationAverager::CountPairs() {
  RotationSummary& summary = result_.summary;
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const ImagePair& pair = view_graph_.pairs[i];
    if (!pair.relative_pose) {
      ++summary.num_pairs_without_rotation;
    } else if (!IsUsable(pair)) {
      ++summary.num_pairs_unobservable;
    } else if (!result_.estimate.pair_is_inlier[i]) {
      ++summary.num_pairs_dropped;
    }
  }
}

// How far pairs are from the rotations of the backbone alone; nullopt where it
// does not tell.
std::vector<std::optional<double>> DistancesFromBackbone(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const RotationEstimate& by_skeleton) {
  std::vector<std::optional<double>> distances(view_graph.pairs.size());
  for (size_t i = 0; i < distances.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i] || !pair.relative_pose) continue;
    const auto rotation1 = by_skeleton.CamFromWorld(scene, pair.image_idx1);
    const auto rotation2 = by_skeleton.CamFromWorld(scene, pair.image_idx2);
    const auto part = [&](int image_idx) {
      return by_skeleton.component[scene.images[image_idx].frame_idx];
    };
    if (rotation1 && rotation2 &&
        part(pair.image_idx1) == part(pair.image_idx2)) {
      distances[i] = AngleBetween(
          pair.relative_pose->cam2_from_cam1 * *rotation1, *rotation2);
    }
  }
  return distances;
}

// Numbers of frames along the strongest tree of the backbone.
TreePathLengths WaysOfBackbone(const Scene& scene, const ViewGraph& view_graph,
                               const Mask& is_in_skeleton) {
  std::vector<GraphEdge> edges;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!is_in_skeleton[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    edges.push_back({scene.images[pair.image_idx1].frame_idx,
                     scene.images[pair.image_idx2].frame_idx,
                     static_cast<double>(pair.matches.size())});
  }
  return {static_cast<int>(scene.frames.size()), edges,
          std::vector<double>(edges.size(), 1.0)};
}

// Leaves out pairs that the rotations of the backbone alone contradict by more
// than errors of pairs and the drift of the backbone explain: a random walk of
// steps with the robust standard deviation of all distances. Copies of a
// structure often are but some degrees off, and enough of them tear the road
// where few pairs hold it.
Mask FindPairsWithinDrift(const Scene& scene, const ViewGraph& view_graph,
                          const Mask& pair_is_used, const Mask& is_in_skeleton,
                          const RotationEstimate& by_skeleton,
                          double max_error_deg) {
  constexpr double kMaxDriftDeg = 10.0;
  constexpr double kMaxErrorOfPair = 0.3;  // of max_error_deg
  constexpr double kDriftInSigmas = 2.0;
  const std::vector<std::optional<double>> distances =
      DistancesFromBackbone(scene, view_graph, pair_is_used, by_skeleton);
  std::vector<double> known;
  for (const auto& distance : distances) {
    if (distance) known.push_back(*distance);
  }
  if (known.empty()) return pair_is_used;
  const double sigma = RobustSigma<3>(known);
  const TreePathLengths ways =
      WaysOfBackbone(scene, view_graph, is_in_skeleton);
  Mask is_within = pair_is_used;
  size_t num_beyond = 0;
  for (size_t i = 0; i < is_within.size(); ++i) {
    if (!distances[i] || is_in_skeleton[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const double way = ways.Between(scene.images[pair.image_idx1].frame_idx,
                                    scene.images[pair.image_idx2].frame_idx);
    const double drift = std::min(
        kDriftInSigmas * sigma * std::sqrt(way),
        DegToRad(kMaxDriftDeg + (1.0 - kMaxErrorOfPair) * max_error_deg));
    if (*distances[i] <= DegToRad(kMaxErrorOfPair * max_error_deg) + drift) {
      continue;
    }
    is_within[i] = false;
    ++num_beyond;
  }
  return num_beyond > kMaxShareBeyondDrift * known.size() ? pair_is_used
                                                          : is_within;
}

}  // namespace

RotationResult AverageRotations(const Scene& scene, const ViewGraph& view_graph,
                                const RotationAveragingOptions& options,
                                const Context& context,
                                const GravityPriors& gravity) {
  MGSFM_CHECK(gravity.IsEmpty() ||
              gravity.images.size() == scene.images.size());
  for (const ImagePair& pair : view_graph.pairs) {
    const int num_images = static_cast<int>(scene.images.size());
    MGSFM_CHECK(pair.image_idx1 >= 0 && pair.image_idx1 < num_images);
    MGSFM_CHECK(pair.image_idx2 >= 0 && pair.image_idx2 < num_images);
    MGSFM_CHECK_NE(pair.image_idx1, pair.image_idx2);
  }
  Mask pair_is_used(view_graph.pairs.size());
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    pair_is_used[i] = view_graph.pairs[i].relative_pose.has_value();
  }
  const Mask is_in_skeleton = SelectSkeletalGraph(
      scene, view_graph, pair_is_used, {}, context.num_threads);
  Context quiet = context;
  quiet.log = nullptr;
  quiet.progress = nullptr;
  const RotationResult by_skeleton =
      RotationAverager(scene, view_graph, is_in_skeleton, nullptr, {}, options,
                       quiet)
          .Run();
  const Mask is_within =
      FindPairsWithinDrift(scene, view_graph, pair_is_used, is_in_skeleton,
                           by_skeleton.estimate, options.max_error_deg);
  return RotationAverager(scene, view_graph, is_within, &by_skeleton.estimate,
                          gravity, options, context)
      .Run();
}

}  // namespace mgsfm
