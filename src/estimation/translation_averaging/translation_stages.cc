// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/translation_stages.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

// Errors of scales beyond their own estimates. Half or twice the value does not
// change errors, as for kZeroBaselineWeight (docs/results/constants.md).
constexpr double kScaleSigma = 0.1;
// Relative to the weight of a direction, per unit of length: a pair without
// parallax bounds its baseline only loosely.
constexpr double kZeroBaselineWeight = 0.01;

}  // namespace

bool RefinementInput::IsUsable(size_t pair_idx, BaselineKind kind,
                               const Positions& positions) const {
  if (!pair_is_used[pair_idx] || baselines[pair_idx].kind != kind) return false;
  const int image1 = baselines[pair_idx].image_idx1;
  const int image2 = baselines[pair_idx].image_idx2;
  const bool is_constant =
      problem.frame_idx[image1] == problem.frame_idx[image2] &&
      !IsFree(image1) && !IsFree(image2);
  return !is_constant && positions.IsPlaced(problem, image1) &&
         positions.IsPlaced(problem, image2);
}

double RefinementInput::DirectionSigma(size_t pair_idx) const {
  return std::hypot(baselines[pair_idx].sigma_rad, kDirectionSigma);
}

double RefinementInput::LengthSigma(size_t pair_idx) const {
  return std::hypot(scales.pairs[pair_idx]->sigma_log, kScaleSigma);
}

double RefinementInput::DirectionWeight(size_t pair_idx, double weight) const {
  return weight * kDirectionSigma / DirectionSigma(pair_idx);
}

double RefinementInput::LengthWeight(size_t pair_idx) const {
  return kDirectionSigma / LengthSigma(pair_idx);
}

double RefinementInput::ZeroBaselineWeight() const {
  return kZeroBaselineWeight * kDirectionSigma / initial.group_factor[0];
}

bool IsDetermined(const RefinementInput& input,
                  const std::vector<size_t>& track_idxs) {
  // Fewer points do not support a refinement.
  return (input.HasDirections() || input.baselines.empty()) &&
         track_idxs.size() >= 10;
}

SolveSummary NothingToDo(const char* message) {
  SolveSummary summary;
  summary.termination = Termination::kConverged;
  summary.message = message;
  return summary;
}

namespace {

// The loss scale of the coarse refinement, which prepares a second
// triangulation. Half and twice the scale change errors by at most 8 %
// (docs/results/constants.md).
constexpr double kCoarseLossRad = DegToRad(1.0);
// Lower bound of the depth of points, relative to the typical depth: nearer
// points come from rays with nearly the same origin. Half or twice the value
// does not change errors (docs/results/constants.md).
constexpr double kMinRelativeDepth = 0.02;

RefinementOptions CommonOptions(const TranslationAveragingOptions& options) {
  RefinementOptions common;
  common.max_num_iterations = options.max_num_iterations;
  common.backend = options.backend;
  return common;
}

// The constant arguments of RefineWithTracks().
struct TrackStage {
  const RefinementInput& input;
  const TrackRays& rays;
  const TranslationAveragingOptions& options;
  const Context& context;
  const PositionObjective& objective;
};

// One joint refinement. Replaces positions and points if it is usable.
SolveSummary RefineJointly(const TrackStage& stage,
                           const RefinementOptions& refinement,
                           PositionsAndPoints* placed) {
  stage.context.CheckInterrupted();
  const std::vector<size_t> selected =
      SelectTracks(stage.rays, placed->points,
                   static_cast<int>(stage.input.problem.frame_idx.size()),
                   stage.options.min_num_points_per_image);
  PositionsAndPoints refined = *placed;
  SolveSummary summary = stage.objective.refine_cameras_and_points(
      stage.input, stage.rays, selected, refinement, stage.context, &refined);
  if (summary.IsUsable()) *placed = std::move(refined);
  return summary;
}

std::string DescribeUnobservable(int num_directions) {
  return std::to_string(num_directions) +
         " of 3 directions of the translation of sensor_from_rig are not "
         "determined by the rotations of the frames and the matches of this "
         "sensor with others; they are set to zero.";
}

// A moving rig sees no parallax on vehicles that move along. Such pairs would
// hold their frames together. Expected lengths and scales differ by a unit, the
// median of their ratios.
void IgnoreMovingPairsWithoutParallax(
    const std::vector<std::optional<double>>& expected_length,
    double min_parallax_deg, PairMeasurements* pairs) {
  std::vector<double> units;
  for (size_t i = 0; i < expected_length.size(); ++i) {
    const auto& scale = pairs->scales.pairs[i];
    if (!expected_length[i] || !scale || scale->group != 0) continue;
    units.push_back(scale->scale / *expected_length[i]);
  }
  if (units.empty()) return;
  const double unit = Median(std::move(units));
  // Longer baselines are unlikely without parallax: normal errors exceed this
  // many standard deviations with probability 3e-2 in three dimensions.
  const double max_length =
      3.0 * ZeroBaselineSigma(pairs->scales, min_parallax_deg);
  for (size_t i = 0; i < expected_length.size(); ++i) {
    BaselineDirection& baseline = pairs->baselines[i];
    if (baseline.kind == BaselineKind::kNoParallax && expected_length[i] &&
        unit * *expected_length[i] > max_length) {
      baseline.kind = BaselineKind::kUnused;
    }
  }
}

}  // namespace

PairMeasurements MeasurePairs(const BaselineInput& input,
                              double min_parallax_deg, const Context& context,
                              const LengthHints& hints) {
  PairMeasurements pairs;
  pairs.baselines =
      EstimateBaselineDirections(input, min_parallax_deg, context);
  pairs.scales = AverageScales(pairs.baselines,
                               static_cast<int>(input.scene.images.size()),
                               context, hints);
  IgnoreMovingPairsWithoutParallax(hints.expected, min_parallax_deg, &pairs);
  for (BaselineDirection& baseline : pairs.baselines) {
    for (auto& depths : baseline.depths) {
      std::vector<DepthSample>().swap(depths);
    }
  }
  return pairs;
}

void SummarizePairs(const PairMeasurements& pairs, const Mask& pair_is_used,
                    TranslationSummary* summary) {
  for (size_t i = 0; i < pairs.baselines.size(); ++i) {
    switch (pairs.baselines[i].kind) {
      case BaselineKind::kDirection:
        ++summary->num_pairs_used;
        break;
      case BaselineKind::kNoParallax:
        ++summary->num_pairs_without_parallax;
        break;
      case BaselineKind::kUnused:
        summary->num_pairs_inconsistent += pair_is_used[i] ? 1 : 0;
    }
  }
  summary->num_scale_groups = static_cast<int>(pairs.scales.group_sizes.size());
}

RefinedPositions RefineWithPairs(const RefinementInput& input,
                                 const TranslationAveragingOptions& options,
                                 const Context& context,
                                 const PositionObjective& objective) {
  if (!objective.refine_cameras) {
    return {input.initial.positions, NothingToDo("Not asked for.")};
  }
  context.CheckInterrupted();
  RefinementOptions refinement = CommonOptions(options);
  refinement.loss_scale_rad = DegToRad(options.max_angle_error_deg);
  RefinedPositions refined{input.initial.positions, {}};
  refined.solve =
      objective.refine_cameras(input, refinement, context, &refined.positions);
  if (!refined.solve.IsUsable()) refined.positions = input.initial.positions;
  return refined;
}

void TriangulateAgain(const RefinementInput& input, const TrackRays& rays,
                      double max_error_rad,
                      const TranslationAveragingOptions& options,
                      int num_threads, PositionsAndPoints* placed) {
  TrackPointOptions point_options;
  point_options.max_error_rad = max_error_rad;
  point_options.min_angle_rad = DegToRad(options.min_parallax_deg);
  if (!input.initial.group_factor.empty()) {
    point_options.min_depth = kMinRelativeDepth * input.scales.typical_depth *
                              input.initial.group_factor[0];
  }
  placed->points =
      TriangulateTracks(input.problem, rays, placed->positions, point_options,
                        num_threads, std::move(placed->points));
}

TrackRefinement RefineWithTracks(const RefinementInput& input,
                                 const Positions& start, const TrackRays& rays,
                                 const TranslationAveragingOptions& options,
                                 const Context& context,
                                 const PositionObjective& objective) {
  const TrackStage stage{input, rays, options, context, objective};
  const double max_angle_rad = DegToRad(options.max_angle_error_deg);
  TrackRefinement state;
  PositionsAndPoints& placed = state.placed;
  placed.positions = start;
  const auto triangulate = [&](double max_error_rad) {
    context.CheckInterrupted();
    TriangulateAgain(input, rays, max_error_rad, options, context.num_threads,
                     &placed);
  };
  const auto triangulate_and_place = [&] {
    triangulate(2.0 * max_angle_rad);
    FramePlacement placement = PlaceFramesByPoints(
        input.problem, rays, placed.points, 2.0 * max_angle_rad,
        context.num_threads, std::move(placed.positions));
    placed.positions = std::move(placement.positions);
    state.num_frames_placed_by_points += placement.num_placed;
    if (placement.num_placed > 0) triangulate(2.0 * max_angle_rad);
  };

  triangulate(kCoarseErrorRad);
  if (!objective.refine_cameras_and_points) {
    state.solve = NothingToDo("Not asked for.");
    return state;
  }
  RefinementOptions refinement = CommonOptions(options);
  refinement.loss_scale_rad = kCoarseLossRad;
  refinement.function_tolerance = 1e-3;
  refinement.max_num_iterations = kNumCoarseIterations;
  (void)RefineJointly(stage, refinement, &placed);
  triangulate_and_place();

  const double sigma =
      AngularSigma(input.problem, rays, placed.points, placed.positions);
  refinement = CommonOptions(options);
  // At 2.4 standard deviations, the Cauchy loss is 95 % efficient for normal
  // noise. The lower bound corresponds to 0.14 pixels at a focal length of 800
  // pixels.
  refinement.loss_scale_rad = std::clamp(
      2.4 * sigma, std::min(DegToRad(0.01), max_angle_rad), max_angle_rad);
  refinement.function_tolerance = 1e-5;
  state.solve = RefineJointly(stage, refinement, &placed);
  triangulate_and_place();
  return state;
}

double FactorToMeasuredLengths(const RefinementInput& input,
                               const Positions& positions) {
  const PositionProblem& problem = input.problem;
  double sum_expected = 0.0, sum_estimated = 0.0;
  for (size_t i = 0; i < input.baselines.size(); ++i) {
    const BaselineDirection& baseline = input.baselines[i];
    if (!input.pair_is_used[i] || baseline.kind != BaselineKind::kDirection ||
        !positions.IsPlaced(problem, baseline.image_idx1) ||
        !positions.IsPlaced(problem, baseline.image_idx2)) {
      continue;
    }
    sum_expected += input.Length(i);
    sum_estimated += (positions.CamCenter(problem, baseline.image_idx2) -
                      positions.CamCenter(problem, baseline.image_idx1))
                         .norm();
  }
  return sum_estimated > 0.0 ? sum_expected / sum_estimated : 1.0;
}

void ScaleBy(double factor, PositionsAndPoints* placed) {
  Positions& positions = placed->positions;
  for (Eigen::Vector3d& center : positions.frame_center) center *= factor;
  for (Eigen::Vector3d& t : positions.sensor_translation) t *= factor;
  for (auto& point : placed->points.point_in_world) {
    if (point) *point *= factor;
  }
}

PositionEstimate MakePositionEstimate(const Scene& scene,
                                      const PositionProblem& problem,
                                      const PositionsAndPoints& placed) {
  const Positions& positions = placed.positions;
  PositionEstimate estimate;
  estimate.frame_center_in_world.resize(scene.frames.size());
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    if (positions.frame_is_placed[f]) {
      estimate.frame_center_in_world[f] = positions.frame_center[f];
    }
  }
  estimate.sensor_from_rig_translation.resize(scene.sensors.size());
  for (size_t s = 0; s < scene.sensors.size(); ++s) {
    if (problem.sensor_kind[s] != SensorKind::kAbsent) {
      estimate.sensor_from_rig_translation[s] = positions.sensor_translation[s];
    }
  }
  estimate.point_in_world = placed.points.point_in_world;
  return estimate;
}

void SummarizeEstimate(const PositionProblem& problem,
                       const InitialPositions& initial,
                       const PositionEstimate& estimate,
                       TranslationSummary* summary) {
  const Mask has_rotation = problem.FramesWithRotation();
  for (size_t f = 0; f < has_rotation.size(); ++f) {
    if (has_rotation[f] && !estimate.frame_center_in_world[f]) {
      ++summary->num_frames_not_placed;
    }
  }
  for (const auto& point : estimate.point_in_world) {
    summary->num_points += point.has_value() ? 1 : 0;
  }
  summary->is_metric = initial.is_metric;
  summary->sensors.resize(problem.sensor_kind.size());
  for (size_t s = 0; s < summary->sensors.size(); ++s) {
    if (problem.sensor_kind[s] == SensorKind::kAbsent) {
      summary->sensors[s] = {false, 3,
                             "No image of the sensor has a known rotation."};
    } else if (problem.HasKnownOffset(static_cast<int>(s)) &&
               !initial.is_metric) {
      summary->sensors[s].message =
          "The matches do not determine the known translation of "
          "sensor_from_rig, so the unit of length is arbitrary.";
    }
  }
  for (size_t k = 0; k < initial.free_sensors.size(); ++k) {
    // The part of the undetermined subspace that moves this sensor.
    const Eigen::MatrixXd part =
        initial.unobservable.middleCols(static_cast<Eigen::Index>(3 * k), 3);
    const SymmetricEigen<Eigen::Matrix3d> eigen(part.transpose() * part);
    // A sensor is reported unless less than this fraction of its squared motion
    // lies in the undetermined subspace. N sensors that move together have 1 /
    // N each; a smaller fraction is less than a tenth of the motion.
    const auto num_weak =
        static_cast<int>((eigen.values.array() > 0.01).count());
    if (num_weak == 0) continue;
    summary->sensors[initial.free_sensors[k]] = {
        false, num_weak, DescribeUnobservable(num_weak)};
  }
}

}  // namespace mgsfm
