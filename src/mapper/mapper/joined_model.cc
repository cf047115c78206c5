// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/joined_model.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/solve.h"
#include "georegistration/world_frame.h"
#include "mapper/components.h"
#include "mapper/input_check.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/model_world.h"
#include "mapper/stage.h"
#include "mapper/weak_seams.h"
#include "math/robust_scale.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/known_lengths.h"
#include "scene/observations.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

using Color = decltype(Point3D::color);

// Matches along each track, from frame to frame: as many as observations.
ViewGraph LinkObservations(const Scene& scene,
                           const std::vector<Point3D>& points) {
  std::map<std::pair<int, int>, std::vector<Match>> matches;
  for (const Point3D& point : points) {
    std::vector<Observation> track = point.track;
    StableSortBy(&track, [&](const Observation& a) {
      return scene.images[a.image_idx].frame_idx;
    });
    for (size_t i = 1; i < track.size(); ++i) {
      const auto& [a, b] = std::minmax(track[i - 1], track[i]);
      matches[{a.image_idx, b.image_idx}].push_back(
          {static_cast<uint32_t>(a.keypoint_idx),
           static_cast<uint32_t>(b.keypoint_idx)});
    }
  }
  ViewGraph view_graph;
  for (auto& [images, of_images] : matches) {
    ImagePair pair;
    pair.image_idx1 = images.first;
    pair.image_idx2 = images.second;
    pair.matches = std::move(of_images);
    view_graph.pairs.push_back(std::move(pair));
  }
  return view_graph;
}

// Points that bundle adjustment makes have the colors of their keypoints in the
// points of before.
class KeypointColors {
 public:
  KeypointColors(const Scene& scene, const Reconstruction& model) {
    const auto is_colored = [](const Point3D& point) {
      return point.color != Color::Zero();
    };
    if (NoneOf(model.points, is_colored)) {
      return;
    }
    lookup_.emplace(scene, model);
    for (const Point3D& point : model.points) colors_.push_back(point.color);
  }
  void Apply(std::vector<Point3D>* points) const {
    if (!lookup_) return;
    for (Point3D& point : *points) {
      for (const Observation& o : point.track) {
        const auto found = lookup_->Find(o.image_idx, o.keypoint_idx);
        if (!found) continue;
        point.color = colors_[*found];
        break;
      }
    }
  }

 private:
  std::optional<PointLookup> lookup_;
  std::vector<Color> colors_;
};

bool FitsLimit(const JoinedModel& input, const Reconstruction& model) {
  return !input.max_num_observations ||
         NumObservations(model) <= *input.max_num_observations;
}

BundleResult Refine(const JoinedModel& input, Reconstruction joined,
                    const BundleAdjustmentOptions& options,
                    const RefinementConditions& conditions,
                    const Context& context) {
  if (!FitsLimit(input, joined)) {
    context.Info("bundle adjustment selects tracks that fit the memory");
    return RefineBySelectedTracks(input.scene, std::move(joined), options,
                                  *input.max_num_observations, context,
                                  conditions);
  }
  const CandidateSource tracks = FixedCandidates(GroupTracks(joined.points));
  return RefineReconstruction(input.scene, tracks, std::move(joined), options,
                              context, conditions);
}

// ----------------------------------------------- beside a finished map

bool IsObservedBy(const Scene& scene, const Mask& frames, bool value,
                  const Point3D& point) {
  return AnyOf(point.track, [&](const Observation& o) {
    return frames[scene.images[o.image_idx].frame_idx] == value;
  });
}

// Keeps the poses of the frames, their sensors and cameras constant.
void Hold(const Scene& scene, const Mask& frames, const Reconstruction& model,
          RefinementConditions* conditions) {
  conditions->fixed = {frames, Mask(scene.sensors.size(), false)};
  CalibrationPrior& calibration = conditions->priors.calibration;
  calibration.intrinsics.resize(scene.cameras.size());
  calibration.intrinsic_sigmas.resize(scene.cameras.size());
  for (const Image& image : scene.images) {
    if (!frames[image.frame_idx]) continue;
    conditions->fixed.sensors[image.sensor_idx] = true;
    const std::vector<double>& params = model.cameras[image.camera_idx].params;
    calibration.intrinsics[image.camera_idx] = params;
    calibration.intrinsic_sigmas[image.camera_idx].assign(params.size(), 0.0);
  }
}

// The cost of a model at its optimum with these conditions; nullopt if the
// solve fails.
std::optional<double> OptimalCost(const Scene& scene,
                                  const Reconstruction& model,
                                  const BundleAdjustmentOptions& options,
                                  const RefinementConditions& conditions,
                                  const Context& context) {
  const BundleResult result = AdjustBundle(scene, model, options, context,
                                           conditions.priors, conditions.fixed);
  const SolveSummary& solve = result.summary.solves.back();
  if (!solve.IsUsable()) return std::nullopt;
  return solve.final_cost;
}

// The cost of the existing frames for the others, relative to the most that
// chance explains (joined_model.h); nullopt if a solve fails.
std::optional<double> MeasureBend(const JoinedModel& input,
                                  const Reconstruction& adjusted,
                                  const RefinementConditions& held,
                                  BundleAdjustmentOptions options,
                                  const Context& context) {
  const Scene& scene = input.scene;
  const Mask& existing = input.existing_frames;
  Reconstruction own = adjusted;
  Mask is_tied(scene.frames.size(), false);
  for (Point3D& point : own.points) {
    const bool ties = IsObservedBy(scene, existing, true, point);
    EraseIf(&point.track, [&](const Observation& o) {
      return existing[scene.images[o.image_idx].frame_idx];
    });
    if (!ties) continue;
    for (const Observation& o : point.track) {
      is_tied[scene.images[o.image_idx].frame_idx] = true;
    }
  }
  const size_t num_tied = is_tied.Count();
  if (num_tied < 2) return 0.0;  // one tied frame moves the others as they are
  if (!FitsLimit(input, own)) {
    own.points = SelectPoints(scene, own.points, *input.max_num_observations);
  }
  const double sigma_px = KeypointSigmaPx(scene, own, context.num_threads);
  options.loss_scale_px = LossScalePx(options, sigma_px);
  RefinementConditions bent = held;
  bent.fixed.frames.assign(scene.frames.size(), true);
  const auto bent_cost = OptimalCost(scene, own, options, bent, context);
  const auto free_cost = OptimalCost(scene, own, options, held, context);
  if (!bent_cost || !free_cost) return std::nullopt;
  const double num_freedoms = 6.0 * static_cast<double>(num_tied - 1);
  return 2.0 * (*bent_cost - *free_cost) / (sigma_px * sigma_px) /
         (num_freedoms + kRareErrorInSigmas * std::sqrt(2.0 * num_freedoms));
}

// Appends the second points to the first.
std::vector<Point3D> Joined(std::vector<Point3D> first,
                            std::vector<Point3D> second) {
  std::move(second.begin(), second.end(), std::back_inserter(first));
  return first;
}

// Removes the points that only existing frames observe, and returns them.
std::vector<Point3D> TakeFinishedPoints(const JoinedModel& input,
                                        std::vector<Point3D>* points) {
  const auto others = std::stable_partition(
      points->begin(), points->end(), [&](const Point3D& point) {
        return !IsObservedBy(input.scene, input.existing_frames, false, point);
      });
  std::vector<Point3D> finished(std::make_move_iterator(points->begin()),
                                std::make_move_iterator(others));
  points->erase(points->begin(), others);
  return finished;
}

void LogWhyNothingIsHeld(const std::optional<double>& bend,
                         const Context& context) {
  if (bend) {
    context.Info(Formatted(
        "the finished map costs the new frames %.3g times what chance "
        "explains; everything is adjusted",
        *bend));
  } else {
    context.Warning(
        "bundle adjustment beside the finished map fails; everything is "
        "adjusted");
  }
}

// Adjusts what does not exist. Returns the measurements that it used, or
// nullopt, with the model as it was, if the existing frames contradict it or a
// solve fails.
std::optional<BundlePriors> AdjustBeside(const JoinedModel& input,
                                         const AdjustmentInput& adjustment,
                                         const MapperOptions& options,
                                         const Context& context,
                                         MapperModel* model) {
  const Scene& scene = input.scene;
  const Mask& existing = input.existing_frames;
  FinishedMapSummary& summary = model->finished_map.emplace();
  summary.num_existing_frames = static_cast<int>(existing.Count());
  if (!input.positions.IsEmpty() && input.parts == nullptr) {
    context.Info(
        "the finished map is not in the world of the positions; everything is "
        "adjusted");
    return std::nullopt;
  }
  BundlePriors priors;
  UsePriorsInPlace(adjustment, options, context, &priors, model);
  summary.frames_are_fixed =
      !input.is_refined || existing.Count() == existing.size();
  if (summary.frames_are_fixed) return priors;  // there is nothing to adjust
  const RunningStage stage("bundle adjustment", context);
  // Several rounds correct lenses and long bends. A finished map has none:
  // three rounds change positions by less than 1e-5 of their errors.
  BundleAdjustmentOptions bundle = options.bundle_adjustment;
  bundle.num_rounds = 1;
  Reconstruction& joined = model->reconstruction;
  RefinementConditions of_map;
  Hold(scene, existing, joined, &of_map);
  RefinementConditions conditions{priors, of_map.fixed};
  conditions.priors.calibration = of_map.priors.calibration;
  std::vector<Point3D> finished = TakeFinishedPoints(input, &joined.points);
  BundleResult result =
      Refine(input, joined, bundle, conditions, stage.context());
  const bool is_usable =
      AllOf(result.summary.solves,
            [](const SolveSummary& solve) { return solve.IsUsable(); });
  if (is_usable) {
    summary.bend =
        MeasureBend(input, result.estimate, of_map, bundle, stage.context());
  }
  summary.frames_are_fixed = summary.bend && *summary.bend <= 1.0;
  if (summary.frames_are_fixed) {
    result.estimate.points =
        Joined(std::move(finished), std::move(result.estimate.points));
    // Existing frames are not weak for having few of the new points.
    FinishSummary(scene, joined, bundle, &result);
    model->bundle = std::move(result.summary);
    joined = std::move(result.estimate);
  } else {
    joined.points = Joined(std::move(finished), std::move(joined.points));
    LogWhyNothingIsHeld(summary.bend, context);
  }
  stage.Finish(&model->times);
  if (!summary.frames_are_fixed) return std::nullopt;
  return priors;
}

// Returns the measurements that it used.
BundlePriors AdjustAll(const JoinedModel& input,
                       const AdjustmentInput& adjustment,
                       const MapperOptions& options, const Context& context,
                       MapperModel* model) {
  BundlePriors priors;
  UsePriors(adjustment, options, context, &model->reconstruction, &priors,
            model);
  if (!input.is_refined) return priors;
  const RunningStage stage("bundle adjustment", context);
  BundleResult bundle =
      Refine(input, std::move(model->reconstruction), options.bundle_adjustment,
             {priors, {}}, stage.context());
  model->bundle = std::move(bundle.summary);
  model->reconstruction = std::move(bundle.estimate);
  stage.Finish(&model->times);
  return priors;
}

void AddConfidence(const Scene& scene, const MapperOptions& options,
                   const Context& context, MapperModel* model) {
  const RunningStage stage("seams", context);
  const ViewGraph tracks =
      LinkObservations(scene, model->reconstruction.points);
  const FramePairIndex index(scene, tracks);
  const Mask all(tracks.pairs.size(), true);
  model->confidence =
      EstimateModelConfidence({scene, index, tracks, all,
                               model->rejected_groups, model->reconstruction},
                              options, stage.context());
  stage.Finish(&model->times);
}

}  // namespace

MapperResult AdjustJoinedModel(const JoinedModel& input,
                               const MapperOptions& options,
                               const Context& context, Reconstruction joined) {
  const Scene& scene = input.scene;
  const Mask& existing = input.existing_frames;
  ViewGraph tracks;
  AdjustmentInput adjustment{scene, tracks, tracks, input.positions,
                             input.gravity};
  adjustment.is_metric = AnyOf(scene.sensors, HasKnownLength);
  Reconstruction start;
  start.sensor_from_rig = joined.sensor_from_rig;
  start.rig_from_world.resize(scene.frames.size());
  for (size_t i = 0; i < existing.size(); ++i) {
    if (existing[i]) start.rig_from_world[i] = joined.rig_from_world[i];
  }
  adjustment.start = input.parts || existing.empty() ? input.parts : &start;
  MapperResult result;
  MapperModel model;
  model.num_frames_in_component = static_cast<int>(scene.frames.size());
  const KeypointColors colors(scene, joined);
  BundlePriors priors;
  model.reconstruction = std::move(joined);
  std::optional<BundlePriors> beside;
  if (!existing.empty()) {
    beside = AdjustBeside(input, adjustment, options, context, &model);
  }
  if (beside) {
    priors = *std::move(beside);
    adjustment.held.frames = existing;
  } else {
    tracks = LinkObservations(scene, model.reconstruction.points);
    adjustment.pair_is_used.assign(tracks.pairs.size(), true);
    priors = AdjustAll(input, adjustment, options, context, &model);
  }
  colors.Apply(&model.reconstruction.points);
  PlaceModelInWorld(adjustment, priors, options, context, &model);
  if (options.compute_covariances) {
    const RunningStage stage("covariances", context);
    model.covariances =
        ComputeCovariances(scene, model.reconstruction,
                           options.bundle_adjustment, stage.context(), priors);
    stage.Finish(&model.times);
  }
  AddConfidence(scene, options, context, &model);
  if (auto seams = DescribeSeams(scene, model.confidence)) {
    result.findings.push_back(std::move(*seams));
  }
  DescribeSensors(scene, start, {}, &model, &result);
  result.models.push_back(std::move(model));
  ListFramesWithoutPose(
      result.models.front(),
      std::vector<std::string>(scene.frames.size(), "no sub-map has its pose"),
      &result);
  LogFindings(result, context);
  return result;
}

}  // namespace mgsfm
