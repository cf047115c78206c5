// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/long_tracks.h"
#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/retriangulation.h"
#include "bundle_adjustment/solve.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "scene/observations.h"
#include "scene/track_coverage.h"

namespace mgsfm {
namespace {

// All solves but the last prepare a triangulation, which needs less accuracy:
// by default, they stop at a relative cost change of 1e-4.
constexpr double kRoughToleranceFactor = 100.0;
// The bound of gross outliers in multiples of max_max_error_px: the largest
// bound of the first of three rounds, which the errors of initial poses can
// exceed.
constexpr double kGrossErrorFactor = 4.0;
// The tracks that the first solves have across each cut between images, and of
// each image, if there are as many (docs/results/constants.md).
constexpr LongTrackOptions kLongTracks = {10, 20};

struct RefinementInput {
  const Scene& scene;
  const CandidateSource& candidates;
  const Reconstruction& initial;  // without points
  const BundleAdjustmentOptions& options;
  const Context& context;
  const RefinementConditions& conditions;
};

// Counts the iterations of all solves, assuming that later solves take as many
// as this one. The summary must outlive the context.
Context ContextOfSolve(const RefinementInput& input,
                       const BundleSummary& summary) {
  Context context = input.context;
  context.progress = [&](const Progress& solve) {
    if (solve.done == solve.total) return;  // another solve may follow
    size_t num_before = 0;
    for (const SolveSummary& earlier : summary.solves) {
      num_before += static_cast<size_t>(earlier.num_iterations);
    }
    const size_t num_solves = static_cast<size_t>(input.options.num_rounds) + 2;
    const size_t num_to_come = num_solves - summary.solves.size();
    input.context.ReportProgress("bundle adjustment", num_before + solve.done,
                                 num_before + num_to_come * solve.total);
  };
  return context;
}

bool Solve(const RefinementInput& input, SolveMode mode,
           double function_tolerance, BundleResult* result) {
  BundleSummary& summary = result->summary;
  BundleAdjustmentOptions options = input.options;
  options.function_tolerance = function_tolerance;
  if (!summary.rounds.empty()) {
    options.loss_scale_px =
        LossScalePx(input.options, summary.rounds.back().sigma_px);
  }
  const bool is_usable = SolveOnce(input.scene, input.conditions, options, mode,
                                   ContextOfSolve(input, summary), result);
  const SolveSummary& solve = summary.solves.back();
  input.context.Debug(Formatted(
      "solve %zu: %d iterations, cost %.6g to %.6g, %s", summary.solves.size(),
      solve.num_iterations, solve.initial_cost, solve.final_cost,
      std::string(EnumName(solve.termination)).c_str()));
  return is_usable;
}

BundleRound StartRound(const RefinementInput& input,
                       const Reconstruction& estimate, int num_rounds_left) {
  BundleRound round;
  round.num_points_before = estimate.points.size();
  round.num_observations_before = NumObservations(estimate);
  round.sigma_px =
      NoiseSigmaPx(input.scene, estimate, input.context.num_threads);
  round.max_error_px =
      MaxErrorPx(input.options, round.sigma_px, num_rounds_left);
  return round;
}

void FinishRound(BundleRound round, const Context& context,
                 BundleResult* result) {
  round.num_points_after = result->estimate.points.size();
  round.num_observations_after = NumObservations(result->estimate);
  context.Debug(
      Formatted("points %zu to %zu, observations %zu to %zu, up to %.2f px",
                round.num_points_before, round.num_points_after,
                round.num_observations_before, round.num_observations_after,
                round.max_error_px));
  result->summary.rounds.push_back(round);
}

PointFilterOptions FilterOf(const RefinementInput& input,
                            const BundleRound& round, int num_rounds_left,
                            const Reconstruction& estimate) {
  PointFilterOptions filter = MakeFilterOptions(
      input.scene, estimate, input.options, round.max_error_px, input.context);
  // Inaccurate poses cause the point errors of earlier rounds.
  if (num_rounds_left == 0) {
    filter.max_rms_error_px = MaxRmsErrorPx(input.options, round.sigma_px);
  }
  return filter;
}

void RemoveGrossErrors(const RefinementInput& input, BundleResult* result) {
  BundleRound round =
      StartRound(input, result->estimate, input.options.num_rounds);
  round.max_error_px =
      std::max(kGrossErrorFactor * input.options.max_max_error_px,
               input.options.error_sigma_factor * round.sigma_px);
  PointFilterOptions filter;
  filter.max_error_px = round.max_error_px;
  FilterPoints(input.scene, filter, input.context.num_threads,
               &result->estimate);
  FinishRound(round, input.context, result);
}

// `not_adjusted` joins after the noise is estimated: the errors of points that
// the solve did not adjust do not measure it.
void RetriangulatePoints(const RefinementInput& input, int num_rounds_left,
                         std::vector<Point3D> not_adjusted,
                         BundleResult* result) {
  input.context.CheckInterrupted();
  BundleRound round = StartRound(input, result->estimate, num_rounds_left);
  round.num_points_before += not_adjusted.size();
  round.num_observations_before += NumObservations(not_adjusted);
  std::move(not_adjusted.begin(), not_adjusted.end(),
            std::back_inserter(result->estimate.points));
  Retriangulate(input.scene,
                *input.candidates.groups(result->estimate, round.max_error_px),
                FilterOf(input, round, num_rounds_left, result->estimate),
                input.context.num_threads, &result->estimate);
  // The poses of earlier rounds are too inaccurate to contradict points.
  if (num_rounds_left == 0 && input.candidates.matches != nullptr) {
    RemoveContradictedPoints(input.scene, *input.candidates.matches,
                             round.max_error_px, input.options.min_match_share,
                             input.context.num_threads, &result->estimate);
  }
  SeparateUntiedSensors(input.scene, &result->estimate);
  FinishRound(round, input.context, result);
}

void FilterFinalPoints(const RefinementInput& input, BundleResult* result) {
  const BundleRound round = StartRound(input, result->estimate, 0);
  FilterPoints(input.scene, FilterOf(input, round, 0, result->estimate),
               input.context.num_threads, &result->estimate);
  FinishRound(round, input.context, result);
}

// Which frames observe points, and which frames share points.
struct FrameSupport {
  Mask is_observed;
  Mask is_connected;  // shares a point with another frame
};

FrameSupport FindSupport(const Scene& scene, const Reconstruction& estimate) {
  FrameSupport support{Mask(scene.frames.size(), false),
                       Mask(scene.frames.size(), false)};
  for (const Point3D& point : estimate.points) {
    const auto frame_of = [&](const Observation& o) {
      return scene.images[o.image_idx].frame_idx;
    };
    const int first = frame_of(point.track.front());
    const bool connects = AnyOf(point.track, [&](const Observation& o) {
      return frame_of(o) != first;
    });
    for (const Observation& o : point.track) {
      support.is_observed[frame_of(o)] = true;
      if (connects) support.is_connected[frame_of(o)] = true;
    }
  }
  return support;
}

// Drops frames that share no point with another frame: points seen by several
// cameras of one frame do not constrain its pose. If no frame shares a point,
// drops only frames without points.
void DropFramesWithoutSupport(const RefinementInput& input,
                              BundleResult* result) {
  if (!input.options.refine_rig_from_world) return;
  const Mask& is_fixed = input.conditions.fixed.frames;
  Reconstruction& estimate = result->estimate;
  const FrameSupport support = FindSupport(input.scene, estimate);
  const bool are_connected = support.is_connected.Count() > 0;
  for (size_t i = 0; i < support.is_observed.size(); ++i) {
    const bool is_supported =
        are_connected ? support.is_connected[i] : support.is_observed[i];
    if (is_supported || !estimate.rig_from_world[i]) continue;
    if (!is_fixed.empty() && is_fixed[i]) continue;
    estimate.rig_from_world[i].reset();
    result->summary.dropped_frames.push_back(
        {static_cast<int>(i),
         support.is_observed[i] ? "no point connects its images to other frames"
                                : "no point agrees with its images"});
  }
  auto& points = estimate.points;
  EraseIf(&points, [&](const Point3D& point) {
    return !estimate.IsRegistered(input.scene, point.track.front().image_idx);
  });
}

// Solves; all steps but the first and the last then triangulate again, the
// first time with the short tracks. Returns false if the solve fails.
bool RunStep(const RefinementInput& input, int step,
             std::vector<Point3D>* short_tracks, BundleResult* result) {
  const BundleAdjustmentOptions& options = input.options;
  const double rough_tolerance =
      std::min(1.0, kRoughToleranceFactor * options.function_tolerance);
  if (step == 0) {
    return Solve(input, {RefinedParts::kTranslations}, rough_tolerance, result);
  }
  if (step > options.num_rounds) {
    return Solve(input, {RefinedParts::kAll, /*minimizes_points=*/true},
                 options.function_tolerance, result);
  }
  if (!Solve(input, {}, rough_tolerance, result)) return false;
  RetriangulatePoints(input, options.num_rounds - step,
                      std::exchange(*short_tracks, {}), result);
  return true;
}

// Returns false if a solve fails.
bool SolveAndTriangulate(const RefinementInput& input, BundleResult* result) {
  RemoveGrossErrors(input, result);
  std::vector<Point3D>& points = result->estimate.points;
  std::vector<Point3D> short_tracks;
  // Lenses that few points bend take two rounds of all points to recover: on
  // recorded key frames, focal lengths after one are 2 % off.
  if (input.options.num_rounds > 2) {
    short_tracks = TakeShortTracks(input.scene, kLongTracks, &points);
  }
  const int num_steps = input.options.num_rounds + 2;
  for (int step = 0; step < num_steps; ++step) {
    if (!RunStep(input, step, &short_tracks, result)) {
      std::move(short_tracks.begin(), short_tracks.end(),
                std::back_inserter(points));
      return false;
    }
  }
  return true;
}

// As many tracks of each image as the limit allows.
Mask SelectTracks(const ObservationGroups& tracks, size_t num_images,
                  size_t max_num_observations) {
  Mask selected(tracks.size(), false);
  int fits = 0, exceeds = 4096;  // tracks per image
  while (exceeds - fits > 1) {
    const int num_per_image = (fits + exceeds) / 2;
    TrackCoverage coverage(tracks, num_images);
    coverage.Select(0, num_per_image);
    if (coverage.num_observations() <= max_num_observations) {
      fits = num_per_image;
      selected = coverage.is_selected();
    } else {
      exceeds = num_per_image;
    }
  }
  return selected;
}

}  // namespace

BundleResult RefineReconstruction(const Scene& scene,
                                  const CandidateSource& candidates,
                                  Reconstruction initial,
                                  const BundleAdjustmentOptions& options,
                                  const Context& context,
                                  const RefinementConditions& conditions) {
  BundleResult result;
  std::swap(result.estimate.points, initial.points);
  const Reconstruction initial_poses = initial;
  std::swap(result.estimate.points, initial.points);
  result.estimate = std::move(initial);
  const RefinementInput input{scene,   candidates, initial_poses,
                              options, context,    conditions};
  if (SolveAndTriangulate(input, &result)) {
    FilterFinalPoints(input, &result);
    DropFramesWithoutSupport(input, &result);
  }
  ComputePointErrors(scene, context.num_threads, &result.estimate);
  FinishSummary(scene, initial_poses, options, &result);
  return result;
}

Reconstruction TriangulateCandidates(const Scene& scene,
                                     const CandidateSource& candidates,
                                     Reconstruction initial,
                                     const BundleAdjustmentOptions& options,
                                     const Context& context) {
  const double max_error_px = options.max_max_error_px;
  Retriangulate(
      scene, *candidates.groups(initial, max_error_px),
      MakeFilterOptions(scene, initial, options, max_error_px, context),
      context.num_threads, &initial);
  return initial;
}

std::vector<Point3D> SelectPoints(const Scene& scene,
                                  const std::vector<Point3D>& points,
                                  size_t max_num_observations) {
  const Mask is_selected = SelectTracks(
      GroupTracks(points), scene.images.size(), max_num_observations);
  std::vector<Point3D> selected;
  for (size_t p = 0; p < points.size(); ++p) {
    if (is_selected[p]) selected.push_back(points[p]);
  }
  return selected;
}

BundleResult RefineBySelectedTracks(const Scene& scene, Reconstruction initial,
                                    const BundleAdjustmentOptions& options,
                                    size_t max_num_observations,
                                    const Context& context,
                                    const RefinementConditions& conditions) {
  std::vector<Point3D> points = std::exchange(initial.points, {});
  const Reconstruction poses = initial;
  initial.points = SelectPoints(scene, points, max_num_observations);
  const CandidateSource selected = FixedCandidates(GroupTracks(initial.points));
  BundleAdjustmentOptions solve = options;
  solve.saves_memory = true;
  BundleResult result = RefineReconstruction(
      scene, selected, std::move(initial), solve, context, conditions);
  const CandidateSource all = FixedCandidates(GroupTracks(points));
  result.estimate.points = std::move(points);
  BundleAdjustmentOptions last = options;
  last.max_max_error_px = result.summary.rounds.back().max_error_px;
  result.estimate = TriangulateCandidates(
      scene, all, std::move(result.estimate), last, context);
  ComputePointErrors(scene, context.num_threads, &result.estimate);
  FinishSummary(scene, poses, options, &result);
  return result;
}

}  // namespace mgsfm
