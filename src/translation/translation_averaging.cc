// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/translation/translation_averaging.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/pair_filtering/skeletal_graph.h"
#include "translation/angle_refinement.h"
#include "translation/bilinear_refinement.h"
#include "translation/impossible_pairs.h"
#include "translation/pair_consistency.h"
#include "translation/position_initialization.h"
#include "translation/position_problem.h"
#include "translation/random_start.h"
#include "translation/relative_translation.h"
#include "translation/scale_averaging.h"
#include "translation/track_points.h"
#include "translation/track_support.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Cameras are some degrees wrong before points are used.
constexpr double kCoarseErrorRad = DegToRad(4.0);
constexpr double kCoarseLossRad = DegToRad(1.0);
constexpr double kMinLossRad = DegToRad(0.01);
// Only to tell the possible from the impossible.
constexpr int kMaxNumBackboneIterations = 60;
// Of L1 positions that are only a start: what ten times as exact ones would
// tell better, about long bends, the first step of the refinement tells, too.
constexpr double kStartTolerance = 1e-3;
// What a backbone may drift, of the way. The least strict is taken that leaves
// most of the backbone whole: one camera drifts in scale, and a loop must
// close.
constexpr double kMaxDrifts[] = {0.2, 0.1, 0.05, 0.02};
constexpr int kNumCoarseIterations = 10;
constexpr double kFunctionTolerance = 1e-5;
// Of points, compared with the median depth of points.
constexpr double kMinRelativeDepth = 0.02;
// From a random start, as global positioning has it.
constexpr double kRandomStartLossRad = 0.1;
constexpr int kNumRandomStartIterations = 100;

TranslationSource InputOf(const TranslationAveragingOptions& options) {
  if (options.input != TranslationSource::kAuto) return options.input;
  return options.objective == TranslationObjective::kDistance
             ? TranslationSource::kRelativeTranslations
             : TranslationSource::kHybrid;
}

// Null if positions are not refined.
const PositionObjective* ObjectiveOf(
    const TranslationAveragingOptions& options) {
  switch (options.objective) {
    case TranslationObjective::kDistance:
      return nullptr;
    case TranslationObjective::kBilinear:
      return &kBilinearObjective;
    case TranslationObjective::kAuto:
    case TranslationObjective::kNonBilinear:
      break;
  }
  return &kNonBilinearObjective;
}

class TranslationAverager {
 public:
  TranslationAverager(const Scene& scene, const Bearings& bearings,
                      const ViewGraph& view_graph,
                      const RotationEstimate& rotations,
                      const ObservationGroups& tracks,
                      const TranslationAveragingOptions& options,
                      const Context& context)
      : scene_(scene),
        bearings_(bearings),
        view_graph_(view_graph),
        rotations_(rotations),
        options_(options),
        context_(context),
        input_(InputOf(options)),
        objective_(ObjectiveOf(options)),
        max_angle_rad_(DegToRad(options.max_angle_error_deg)),
        problem_(MakePositionProblem(scene, rotations)),
        rays_(ComputeTrackRays(problem_, bearings, tracks,
                               context.num_threads)) {}

  TranslationResult Run() {
    switch (input_) {
      case TranslationSource::kAuto:
      case TranslationSource::kHybrid:
        PositionByPairs();
        RefineWithPoints();
        break;
      case TranslationSource::kRelativeTranslations:
        PositionByPairs();
        TriangulateOnly();
        break;
      case TranslationSource::kTracks:
        PositionByTracks();
        break;
    }
    NormalizeScale();
    FindContradictions();
    WriteEstimate();
    DescribeSensors();
    return std::move(result_);
  }

 private:
  void PositionByPairs();
  void PositionByTracks();
  void TriangulateOnly();
  void EstimatePairs();
  struct Backbone {
    Mask is_in_skeleton;  // per pair
    InitialPositions positions;
  };
  Backbone FindBackbone() const;
  Backbone PositionBackbone(Mask is_in_skeleton) const;
  Mask FindInconsistent(const Backbone& backbone, double max_drift) const;
  void SetAside(const Mask& is_set_aside);
  void Initialize();
  void RefineWithPairs();
  void SetContradictingPairsAside();
  void RefineWithPoints();
  void Triangulate(double max_error_rad);
  SolveSummary RefineJointly(const RefinementOptions& options);
  SolveSummary RefineJointly(double loss_scale_rad, double function_tolerance,
                             int max_num_iterations);
  void PlaceRemainingFrames();
  void FindContradictions();
  void NormalizeScale();
  double ScaleOfPairs() const;
  double ScaleOfNeighbours() const;
  void WriteEstimate();
  void DescribeSensors();
  RefinementInput Input() const {
    return {problem_, motions_, scales_, initial_};
  }
  bool IsPlaced(int image_idx1, int image_idx2) const {
    return positions_.IsPlaced(problem_, image_idx1) &&
           positions_.IsPlaced(problem_, image_idx2);
  }
  double Distance(int image_idx1, int image_idx2) const {
    return (positions_.CamCenter(problem_, image_idx2) -
            positions_.CamCenter(problem_, image_idx1))
        .norm();
  }
  void LogTime(const char* step) {
    char line[128];
    std::snprintf(line, sizeof(line), "Translation averaging: %s %.3f s", step,
                  timer_.Seconds() - last_seconds_);
    last_seconds_ = timer_.Seconds();
    context_.Debug(line);
  }

  const Scene& scene_;
  const Bearings& bearings_;
  const ViewGraph& view_graph_;
  const RotationEstimate& rotations_;
  const TranslationAveragingOptions& options_;
  const Context& context_;
  const TranslationSource input_;
  const PositionObjective* objective_;
  const double max_angle_rad_;
  const PositionProblem problem_;
  const TrackRays rays_;
  Timer timer_;
  double last_seconds_ = 0.0;

  std::vector<BaselineDirection> motions_;
  PairScales scales_;
  InitialPositions initial_;
  Positions positions_;
  TrackPoints points_;
  TranslationResult result_;
};

void TranslationAverager::PositionByPairs() {
  EstimatePairs();
  Initialize();
  if (objective_ == nullptr) {
    result_.summary.camera_refinement = NothingToDo("Not asked for.");
    return;
  }
  RefineWithPairs();
  SetContradictingPairsAside();
}

void TranslationAverager::PositionByTracks() {
  RandomStart start = StartAtRandom(problem_, rays_, context_.random_seed);
  initial_ = std::move(start.initial);
  positions_ = initial_.positions;
  points_ = std::move(start.points);
  TranslationSummary& summary = result_.summary;
  summary.initialization = initial_.solve;
  summary.is_metric = initial_.is_metric;
  summary.camera_refinement = NothingToDo("Not needed: points tell all.");
  RefinementOptions options;
  options.loss = RobustLossType::kHuber;
  options.loss_scale_rad = kRandomStartLossRad;
  options.starts_at_random = true;
  options.backend = options_.backend;
  options.function_tolerance = kFunctionTolerance;
  options.max_num_iterations =
      std::max(kNumRandomStartIterations, options_.max_num_iterations);
  summary.joint_refinement = RefineJointly(options);
  LogTime("positions from a random start");
  Triangulate(2.0 * max_angle_rad_);
  LogTime("triangulation");
}

// Positions are as rough as pairs leave them.
void TranslationAverager::TriangulateOnly() {
  result_.summary.joint_refinement = NothingToDo("Not asked for.");
  Triangulate(kCoarseErrorRad);
  LogTime("triangulation");
}

void TranslationAverager::EstimatePairs() {
  motions_ = EstimateBaselineDirections(scene_, bearings_, view_graph_,
                                        rotations_.pair_is_inlier, problem_,
                                        options_.min_parallax_deg, context_);
  LogTime("directions of pairs");
  scales_ =
      AverageScales(motions_, static_cast<int>(scene_.images.size()), context_);
  LogTime("scales of pairs");
  for (BaselineDirection& motion : motions_) {
    for (auto& depths : motion.depths) std::vector<DepthSample>().swap(depths);
  }
  TranslationSummary& summary = result_.summary;
  for (size_t i = 0; i < motions_.size(); ++i) {
    switch (motions_[i].kind) {
      case BaselineKind::kDirection:
        ++summary.num_pairs_used;
        break;
      case BaselineKind::kNoParallax:
        ++summary.num_pairs_without_parallax;
        break;
      case BaselineKind::kUnused:
        summary.num_pairs_inconsistent += rotations_.pair_is_inlier[i] != 0;
    }
  }
  summary.num_scale_groups = static_cast<int>(scales_.group_sizes.size());
}

void TranslationAverager::SetAside(const Mask& is_set_aside) {
  for (size_t i = 0; i < motions_.size(); ++i) {
    if (is_set_aside[i]) motions_[i].kind = BaselineKind::kUnused;
  }
}

// Copies may be strong enough for the backbone where a road shows little else.
// The spine does not have them; what it cannot explain is not let in.
TranslationAverager::Backbone TranslationAverager::FindBackbone() const {
  Mask is_candidate(motions_.size());
  for (size_t i = 0; i < motions_.size(); ++i) {
    is_candidate[i] = motions_[i].kind == BaselineKind::kDirection;
  }
  const Mask is_beyond_strict_skeleton =
      FindInconsistent(PositionBackbone(SelectSkeletalGraph(
                           scene_, view_graph_, is_candidate,
                           kStrictSkeletalGraph, context_.num_threads)),
                       kMaxDrifts[0]);
  for (size_t i = 0; i < motions_.size(); ++i) {
    if (is_beyond_strict_skeleton[i]) is_candidate[i] = false;
  }
  return PositionBackbone(SelectSkeletalGraph(scene_, view_graph_, is_candidate,
                                              {}, context_.num_threads));
}

TranslationAverager::Backbone TranslationAverager::PositionBackbone(
    Mask is_in_skeleton) const {
  std::vector<BaselineDirection> motions = motions_;
  for (size_t i = 0; i < motions.size(); ++i) {
    if (motions[i].kind == BaselineKind::kDirection && !is_in_skeleton[i]) {
      motions[i].kind = BaselineKind::kUnused;
    }
  }
  return {std::move(is_in_skeleton),
          InitializePositions(
              problem_, motions, scales_, options_.min_parallax_deg,
              {kMaxNumBackboneIterations, kStartTolerance}, context_)};
}

// Per pair: whether positions by a backbone make it impossible.
Mask TranslationAverager::FindInconsistent(const Backbone& backbone,
                                           double max_drift) const {
  std::vector<int> num_matches(motions_.size());
  for (size_t i = 0; i < motions_.size(); ++i) {
    num_matches[i] = static_cast<int>(view_graph_.pairs[i].matches.size());
  }
  return FindInconsistentBaselines(problem_, motions_, num_matches,
                                   backbone.is_in_skeleton, scales_,
                                   backbone.positions, max_drift);
}

// Where copies that drift might explain outvote the backbone, the road is torn.
void TranslationAverager::Initialize() {
  const Backbone backbone = FindBackbone();
  LogTime("backbone");
  InitializationOptions options;
  if (objective_ != nullptr) options.relative_tolerance = kStartTolerance;
  const std::vector<BaselineDirection> all_motions = motions_;
  std::vector<BaselineDirection> best_motions;
  InitialPositions best;
  int fewest_violated = std::numeric_limits<int>::max();
  for (const double max_drift : kMaxDrifts) {
    motions_ = std::vector<BaselineDirection>(all_motions);
    SetAside(FindInconsistent(backbone, max_drift));
    initial_ =
        InitializePositions(problem_, motions_, scales_,
                            options_.min_parallax_deg, options, context_);
    const int num_violated =
        CountViolatedSkeletonEdges(problem_, motions_, backbone.is_in_skeleton,
                                   scales_, backbone.positions, initial_);
    context_.Debug("Translation averaging: a drift of " +
                   std::to_string(max_drift) + " tears " +
                   std::to_string(num_violated) + " pairs of the backbone");
    if (num_violated < fewest_violated) {
      fewest_violated = num_violated;
      best_motions = std::vector<BaselineDirection>(motions_);
      best = initial_;
    }
    if (num_violated == 0) break;
  }
  motions_ = std::move(best_motions);
  initial_ = std::move(best);
  positions_ = initial_.positions;
  result_.summary.initialization = initial_.solve;
  result_.summary.is_metric = initial_.is_metric;
  LogTime("L1 positions");
}

void TranslationAverager::RefineWithPairs() {
  context_.CheckInterrupted();
  RefinementOptions options;
  options.max_num_iterations = options_.max_num_iterations;
  options.loss_scale_rad = max_angle_rad_;
  options.backend = options_.backend;
  Positions refined = positions_;
  result_.summary.camera_refinement =
      objective_->refine_cameras(Input(), options, context_, &refined);
  if (result_.summary.camera_refinement.IsUsable()) positions_ = refined;
  LogTime("refinement of cameras");
}

void TranslationAverager::SetContradictingPairsAside() {
  SetAside(
      FindInconsistentPairs(problem_, motions_, scales_, initial_, positions_));
}

void TranslationAverager::Triangulate(double max_error_rad) {
  context_.CheckInterrupted();
  TrackPointOptions options;
  options.max_error_rad = max_error_rad;
  options.min_angle_rad = DegToRad(options_.min_parallax_deg);
  if (!initial_.group_factor.empty()) {
    options.min_depth =
        kMinRelativeDepth * scales_.typical_depth * initial_.group_factor[0];
  }
  TriangulateTracks(problem_, rays_, positions_, options, context_.num_threads,
                    &points_);
}

SolveSummary TranslationAverager::RefineJointly(double loss_scale_rad,
                                                double function_tolerance,
                                                int max_num_iterations) {
  RefinementOptions options;
  options.max_num_iterations = max_num_iterations;
  options.loss_scale_rad = loss_scale_rad;
  options.backend = options_.backend;
  options.function_tolerance = function_tolerance;
  return RefineJointly(options);
}

SolveSummary TranslationAverager::RefineJointly(
    const RefinementOptions& options) {
  context_.CheckInterrupted();
  const std::vector<size_t> selected =
      SelectTracks(rays_, points_,
                   FindSupportedTracks(problem_, motions_, rays_, points_,
                                       context_.num_threads),
                   static_cast<int>(scene_.images.size()),
                   options_.min_num_points_per_image);
  Positions refined = positions_;
  TrackPoints refined_points = points_;
  SolveSummary summary = objective_->refine_cameras_and_points(
      Input(), rays_, selected, options, context_, &refined, &refined_points);
  if (summary.IsUsable()) {
    positions_ = std::move(refined);
    points_ = std::move(refined_points);
  }
  return summary;
}

void TranslationAverager::RefineWithPoints() {
  Triangulate(kCoarseErrorRad);
  LogTime("first triangulation");
  RefineJointly(kCoarseLossRad, 1e-3, kNumCoarseIterations);
  LogTime("first joint refinement");
  Triangulate(2.0 * max_angle_rad_);
  PlaceRemainingFrames();
  LogTime("second triangulation");
  // 2.4 standard deviations: 95 % efficient for normal noise.
  const double sigma = AngularSigma(problem_, rays_, points_, positions_);
  const double loss_scale = std::clamp(
      2.4 * sigma, std::min(kMinLossRad, max_angle_rad_), max_angle_rad_);
  result_.summary.joint_refinement = RefineJointly(
      loss_scale, kFunctionTolerance, options_.max_num_iterations);
  LogTime("second joint refinement");
  Triangulate(2.0 * max_angle_rad_);
  PlaceRemainingFrames();
  LogTime("last triangulation");
}

void TranslationAverager::PlaceRemainingFrames() {
  const int num_placed =
      PlaceFramesByPoints(problem_, rays_, points_, 2.0 * max_angle_rad_,
                          context_.num_threads, &positions_);
  result_.summary.num_frames_placed_by_points += num_placed;
  if (num_placed > 0) Triangulate(2.0 * max_angle_rad_);
}

// All pairs are judged, also those set aside: points may have told better.
void TranslationAverager::FindContradictions() {
  if (input_ == TranslationSource::kTracks) {
    result_.pair_is_inconsistent.assign(view_graph_.pairs.size(), false);
    return;
  }
  result_.pair_is_inconsistent =
      FindInconsistentPairs(problem_, motions_, scales_, initial_, positions_);
  result_.summary.num_pairs_inconsistent_with_positions =
      static_cast<int>(std::count(result_.pair_is_inconsistent.begin(),
                                  result_.pair_is_inconsistent.end(), true));
}

// Angles do not tell the common scale; it is set back to that of the pairs.
void TranslationAverager::NormalizeScale() {
  if (initial_.is_metric) return;
  const double factor = input_ == TranslationSource::kTracks
                            ? ScaleOfNeighbours()
                            : ScaleOfPairs();
  for (Vector3d& center : positions_.frame_center) center *= factor;
  for (Vector3d& t : positions_.sensor_translation) t *= factor;
  for (auto& point : points_.point_in_world) {
    if (point) *point *= factor;
  }
}

double TranslationAverager::ScaleOfPairs() const {
  double sum_expected = 0.0, sum_estimated = 0.0;
  for (size_t i = 0; i < motions_.size(); ++i) {
    const BaselineDirection& motion = motions_[i];
    if (motion.kind != BaselineKind::kDirection ||
        !IsPlaced(motion.image_idx1, motion.image_idx2)) {
      continue;
    }
    sum_expected += scales_.scale[i] * initial_.group_factor[scales_.group[i]];
    sum_estimated += Distance(motion.image_idx1, motion.image_idx2);
  }
  return sum_estimated > 0.0 ? sum_expected / sum_estimated : 1.0;
}

// The median baseline of pairs becomes 1.
double TranslationAverager::ScaleOfNeighbours() const {
  std::vector<double> baselines;
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const ImagePair& pair = view_graph_.pairs[i];
    if (!rotations_.pair_is_inlier[i] ||
        !IsPlaced(pair.image_idx1, pair.image_idx2)) {
      continue;
    }
    baselines.push_back(Distance(pair.image_idx1, pair.image_idx2));
  }
  if (baselines.empty()) return 1.0;
  const double median = Median(std::move(baselines));
  return median > 0.0 ? 1.0 / median : 1.0;
}

void TranslationAverager::WriteEstimate() {
  PositionEstimate& estimate = result_.estimate;
  TranslationSummary& summary = result_.summary;
  estimate.frame_center_in_world.resize(scene_.frames.size());
  for (size_t f = 0; f < scene_.frames.size(); ++f) {
    if (positions_.frame_is_placed[f]) {
      estimate.frame_center_in_world[f] = positions_.frame_center[f];
    }
  }
  Mask has_rotation(scene_.frames.size(), false);
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    if (problem_.IsUsed(static_cast<int>(i))) {
      has_rotation[problem_.frame_idx[i]] = true;
    }
  }
  for (size_t f = 0; f < has_rotation.size(); ++f) {
    summary.num_frames_not_placed +=
        has_rotation[f] && !positions_.frame_is_placed[f];
  }
  estimate.sensor_from_rig_translation.resize(scene_.sensors.size());
  for (size_t s = 0; s < scene_.sensors.size(); ++s) {
    if (problem_.sensor_kind[s] != SensorKind::kAbsent) {
      estimate.sensor_from_rig_translation[s] =
          positions_.sensor_translation[s];
    }
  }
  for (const auto& point : points_.point_in_world) {
    summary.num_points += point.has_value();
  }
  estimate.point_in_world = std::move(points_.point_in_world);
}

void TranslationAverager::DescribeSensors() {
  auto& sensors = result_.summary.sensors;
  sensors.resize(scene_.sensors.size());
  for (size_t s = 0; s < sensors.size(); ++s) {
    if (problem_.sensor_kind[s] == SensorKind::kAbsent) {
      sensors[s] = {false, 3, "No image of the sensor has a known rotation."};
    } else if (problem_.fixed_translation[s].squaredNorm() > 0.0 &&
               !initial_.is_metric) {
      sensors[s].message =
          "The given translation does not show in the matches, so the unit of "
          "length is arbitrary.";
    }
  }
  for (size_t k = 0; k < initial_.free_sensors.size(); ++k) {
    // The part of the undetermined subspace that moves this sensor.
    const Eigen::MatrixXd part = initial_.unobservable.middleCols(3 * k, 3);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(
        part.transpose() * part);
    constexpr double kMinShare = 0.01;
    const auto num_weak =
        static_cast<int>((eigen.eigenvalues().array() > kMinShare).count());
    if (num_weak == 0) continue;
    auto& sensor = sensors[initial_.free_sensors[k]];
    sensor.is_observable = false;
    sensor.num_unobservable_directions = num_weak;
    sensor.message =
        std::to_string(num_weak) +
        " of 3 directions of the internal translation are not determined: the "
        "frames turn too little for the matches of this sensor with others; "
        "they are set to zero.";
  }
}

}  // namespace

void CheckTranslationOptions(const TranslationAveragingOptions& options) {
  if (options.objective == TranslationObjective::kDistance &&
      InputOf(options) != TranslationSource::kRelativeTranslations) {
    throw Error(
        "TranslationAveraging.objective 'distance' knows relative "
        "translations only; leave TranslationAveraging.input out, or give "
        "another objective");
  }
}

TranslationResult AverageTranslations(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const ObservationGroups& tracks,
    const TranslationAveragingOptions& options, const Context& context) {
  CheckTranslationOptions(options);
  MGSFM_CHECK_EQ(rotations.pair_is_inlier.size(), view_graph.pairs.size());
  MGSFM_CHECK_EQ(rotations.rig_from_world.size(), scene.frames.size());
  MGSFM_CHECK_EQ(bearings.images.size(), scene.images.size());
  return TranslationAverager(scene, bearings, view_graph, rotations, tracks,
                             options, context)
      .Run();
}

}  // namespace mgsfm
