// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/model_adjustment.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/covariance_report.h"
#include "georegistration/world_frame.h"
#include "input_check/rig_samples.h"
#include "mapper/model_world.h"
#include "mapper/stage.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "soft_rig/rig_delays.h"
#include "soft_rig/rig_timing.h"

namespace mgsfm {

CandidateSource MakeCandidateSource(const Scene& scene,
                                    const ViewGraph& view_graph,
                                    const ViewGraph& matches, Mask pair_is_used,
                                    const MapperOptions& options,
                                    const Context& context) {
  const auto groups = [&scene, &view_graph, &options, &context,
                       pair_is_used = std::move(pair_is_used)](
                          const Reconstruction& model, double max_error_px) {
    return std::make_shared<const ObservationGroups>(EstablishCandidates(
        scene, view_graph,
        SelectConsistentMatches({scene, view_graph, pair_is_used, model},
                                max_error_px, options.match_selection, context),
        options.tracks, context));
  };
  return {groups, &matches};
}

CandidateSource CandidatesOf(const AdjustmentInput& input, const Scene& scene,
                             const MapperOptions& options,
                             const Context& context) {
  CandidateSource source =
      MakeCandidateSource(scene, input.view_graph, input.matches,
                          input.pair_is_used, options, context);
  if (!input.keeps_points) return source;
  return {[&scene, groups = std::move(source.groups)](
              const Reconstruction& model, double max_error_px) {
            return std::make_shared<const ObservationGroups>(
                JoinPoints(scene, *groups(model, max_error_px), model.points,
                           /*with_others=*/false));
          },
          source.matches};
}

namespace {

// The candidates for bundle adjustment, which requests them once per round.
CandidateSource MakeObservedSource(const AdjustmentInput& input,
                                   const MapperOptions& options,
                                   const Context& context) {
  CandidateSource source = CandidatesOf(input, input.scene, options, context);
  if (!input.observer) return source;
  return {[groups = std::move(source.groups), observer = input.observer](
              const Reconstruction& model, double max_error_px) {
            observer(model);
            return groups(model, max_error_px);
          },
          source.matches};
}

// Timestamps if all images have one, otherwise the order of the frames. Without
// `of_images`, images are taken at the time of their frame.
CaptureTimes FindCaptureTimes(const Scene& scene, bool of_images) {
  const std::vector<int> rank = RankFrames(scene);
  CaptureTimes times{{rank.begin(), rank.end()}, {}, false};
  times.are_seconds = AllOf(
      scene.images, [](const Image& i) { return i.timestamp_s.has_value(); });
  for (size_t f = 0; f < rank.size() && times.are_seconds; ++f) {
    times.frames[f] = TimeOfFrame(scene, static_cast<int>(f));
  }
  for (const Image& image : scene.images) {
    times.images.push_back(times.are_seconds && of_images
                               ? *image.timestamp_s
                               : times.frames[image.frame_idx]);
  }
  return times;
}

// Adds the estimated delays of cameras to the times of their images.
void AddOffsets(const Scene& scene, const SoftRigSummary& timing,
                CaptureTimes* times) {
  std::vector<double> offsets_s(scene.sensors.size(), 0.0);
  for (const SoftRigSensor& sensor : timing.sensors) {
    offsets_s[sensor.sensor_idx] = sensor.time_offset_s.value_or(0.0);
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    times->images[i] += offsets_s[scene.images[i].sensor_idx];
  }
}

// Delays relative to the times that the model uses.
std::optional<RigDelays> EstimateDelays(const AdjustmentInput& input,
                                        const MapperOptions& options,
                                        const Context& context,
                                        const Reconstruction& model,
                                        const SoftRigSummary* timing) {
  RigMeasurements measured{
      FindCaptureTimes(input.scene, !model.motions.empty()), {}};
  if (timing) AddOffsets(input.scene, *timing, &measured.times);
  if (const auto baseline =
          ParseMetricScale(options.metric_scale, input.scene)) {
    measured.known_distances = baseline->sensor_idxs;
  }
  return EstimateRigDelays(input.scene, measured,
                           CandidatesOf(input, input.scene, options, context),
                           model, options.bundle_adjustment, context);
}

// Bundle adjustment. Drops the rig from `priors` if the observations of the
// model contradict it.
void AdjustToMatches(const AdjustmentInput& input, const MapperOptions& options,
                     const Context& context, Reconstruction initial,
                     BundlePriors* priors, MapperModel* model) {
  const auto refine = [&](const char* name, Reconstruction start) {
    const RunningStage stage(name, context);
    BundleResult refined = RefineReconstruction(
        input.scene, MakeObservedSource(input, options, stage.context()),
        std::move(start), options.bundle_adjustment, stage.context(),
        {*priors, input.held});
    stage.Finish(&model->times);
    return refined;
  };
  BundleResult bundle = refine("bundle adjustment", std::move(initial));
  model->rig_differences.clear();
  model->has_shared_unit =
      input.calibration && input.calibration->SharesUnit(priors->calibration);
  if (!priors->calibration.sensors.empty()) {
    const auto prior = std::exchange(priors->calibration.sensors, {});
    BundleResult released =
        refine("bundle adjustment without prior", bundle.estimate);
    model->rig_differences = input.calibration->FindDifferences(
        released.estimate, *priors, options.bundle_adjustment, context, [&] {
          return EstimateDelays(input, options, context, released.estimate,
                                nullptr);
        });
    if (model->rig_differences.empty()) {
      priors->calibration.sensors = prior;
    } else {
      bundle = std::move(released);
      model->has_shared_unit = false;
    }
  }
  model->bundle = std::move(bundle.summary);
  model->reconstruction = std::move(bundle.estimate);
}

void AddCovariances(const AdjustmentInput& input, const BundlePriors& priors,
                    const MapperOptions& options, const Context& context,
                    MapperModel* model) {
  const Scene& scene = input.scene;
  if (options.compute_covariances) {
    const RunningStage stage("covariances", context);
    model->covariances =
        ComputeCovariances(scene, model->reconstruction,
                           options.bundle_adjustment, stage.context(), priors);
    stage.Finish(&model->times);
  }
  if (!model->delays || !model->covariances || !model->covariances->is_usable) {
    return;
  }
  AddRigErrors(scene, model->reconstruction, *model->delays,
               &*model->covariances);
  ListUnobservable(scene, model->reconstruction, context, &*model->covariances);
  const std::string message =
      DescribeUnobservable(scene, model->reconstruction, *model->covariances);
  if (!message.empty()) context.Warning(message);
}

void LogSensor(const Scene& scene, const SoftRigSensor& sensor,
               const Context& context) {
  std::string line = "camera '" + scene.sensors[sensor.sensor_idx].name + "':";
  if (!sensor.is_rigid) {
    line += Formatted(
        " deviations of images: rms %.4g deg and %.4g, max %.4g deg and %.4g;",
        RadToDeg(sensor.rms_rotation_rad), sensor.rms_position,
        RadToDeg(sensor.max_rotation_rad), sensor.max_position);
  }
  line += Formatted(" reprojection errors %.3f px, before %.3f px",
                    sensor.mean_error_after_px, sensor.mean_error_before_px);
  if (sensor.time_offset_s) {
    line += Formatted("; time offset %.6f s +- %.6f s", *sensor.time_offset_s,
                      *sensor.time_offset_sigma_s);
  }
  if (sensor.readout_s) {
    line += Formatted("; readout time %.6f s +- %.6f s", *sensor.readout_s,
                      *sensor.readout_sigma_s);
  }
  context.Info(line);
  if (!sensor.message.empty()) {
    context.Warning("camera '" + scene.sensors[sensor.sensor_idx].name +
                    "': " + sensor.message);
  }
}

// Bundle adjustment at the times of images and rows.
SoftRigResult AdjustTimes(const AdjustmentInput& input, BundlePriors priors,
                          const CaptureTimes& times,
                          const MapperOptions& options, const Context& context,
                          const MapperModel& model) {
  const std::function<CandidateSource(const Scene&)> candidates =
      [&](const Scene& seen) {
        return CandidatesOf(input, seen, options, context);
      };
  return EstimateRigTiming({input.scene,
                            times,
                            candidates,
                            model.reconstruction,
                            {std::move(priors), input.held}},
                           options.soft_rig, options.bundle_adjustment,
                           context);
}

void KeepImagePoses(const Scene& scene, const MapperOptions& options,
                    SoftRigResult result, const Context& context,
                    MapperModel* model) {
  const SoftRigSummary& summary = result.images.summary;
  for (const SoftRigSensor& sensor : summary.sensors) {
    LogSensor(scene, sensor, context);
  }
  if (!summary.is_usable) {
    context.Warning("images keep the poses of their rig: " + summary.message);
  } else if (!summary.has_converged) {
    context.Warning(
        "the times or deviations of images have not converged after " +
        std::to_string(options.soft_rig.max_num_rounds) + " rounds");
  }
  model->reconstruction = std::move(result.estimate);
  model->soft_rig_images = std::move(result.images);
}

// Adjusts images at their own times if that explains more of their keypoints.
void UseImageTimes(const AdjustmentInput& input, const BundlePriors& priors,
                   const MapperOptions& options, const Context& context,
                   MapperModel* model) {
  const auto adjust = [&](bool of_images) {
    return AdjustTimes(input, priors, FindCaptureTimes(input.scene, of_images),
                       options, context, *model);
  };
  SoftRigResult timed = adjust(true);
  const bool explains_more =
      timed.images.summary.is_usable &&
      ExplainsMore(input.scene, timed.estimate, adjust(false).estimate,
                   options.bundle_adjustment, context);
  context.Info(explains_more
                   ? "images are adjusted at their own times, which explain "
                     "more keypoints than the times of their frames"
                   : "images are adjusted at the times of their frames, which "
                     "explain more keypoints than their own times");
  if (!explains_more) return;
  KeepImagePoses(input.scene, options, std::move(timed), context, model);
}

// Adjusts images at their times, or estimates these. Logs the times.
void AdjustModelTimes(const AdjustmentInput& input, const BundlePriors& priors,
                      const MapperOptions& options, const Context& context,
                      MapperModel* model) {
  const SoftRig method = options.soft_rig.method;
  if (method == SoftRig::kNone || method == SoftRig::kSoft) return;
  // Frames that are held keep the poses of their images.
  if (!input.held.frames.empty()) return;
  const CaptureTimes times = FindCaptureTimes(input.scene, true);
  if (method == SoftRig::kAuto &&
      !TimesMatter(input.scene, times, model->reconstruction, context)) {
    return;
  }
  const RunningStage stage("times of images", context);
  if (method == SoftRig::kAuto) {
    UseImageTimes(input, priors, options, stage.context(), model);
  } else {
    KeepImagePoses(
        input.scene, options,
        AdjustTimes(input, priors, times, options, stage.context(), *model),
        context, model);
  }
  stage.Finish(&model->times);
}

// Estimates individual poses of the images of an adjusted model, and logs how
// far the cameras deviate from a rigid rig.
void EstimateSoftRigOfModel(const AdjustmentInput& input, BundlePriors priors,
                            const MapperOptions& options,
                            const Context& context, MapperModel* model) {
  if (options.soft_rig.method != SoftRig::kSoft) return;
  const RunningStage stage("soft rig", context);
  const Scene separate = SeparateImages(input.scene);
  priors.calibration.sensors.clear();  // each image is a sensor
  KeepImagePoses(
      input.scene, options,
      EstimateSoftRig({input.scene, separate,
                       CandidatesOf(input, separate, options, context),
                       model->reconstruction, std::move(priors)},
                      options.soft_rig, options.bundle_adjustment,
                      stage.context()),
      context, model);
  stage.Finish(&model->times);
}

}  // namespace

void CheckTimes(const Scene& scene, SoftRig method) {
  if (method == SoftRig::kAuto || method == SoftRig::kNone ||
      method == SoftRig::kSoft) {
    return;
  }
  for (const Image& image : scene.images) {
    if (image.timestamp_s) continue;
    throw Error("SoftRig.method " + std::string(EnumName(method)) +
                " needs the times of images, but '" + image.name +
                "' has none");
  }
}

void AdjustModel(const AdjustmentInput& input, const MapperOptions& options,
                 const Context& context, Reconstruction initial,
                 MapperModel* model) {
  BundlePriors used_priors;
  if (input.calibration) {
    used_priors.calibration =
        input.calibration->PriorFor(FramesWith(initial.rig_from_world));
    StartAtPrior(used_priors.calibration, &initial);
  }
  UsePriors(input, options, context, &initial, &used_priors, model);
  AdjustToMatches(input, options, context, std::move(initial), &used_priors,
                  model);
  PlaceModelInWorld(input, used_priors, options, context, model);
  if (options.is_for_lenses) return;
  if (input.observer) input.observer(model->reconstruction);
  AdjustModelTimes(input, used_priors, options, context, model);
  const RunningStage stage("delays of cameras", context);
  model->delays = EstimateDelays(
      input, options, stage.context(), model->reconstruction,
      model->soft_rig_images ? &model->soft_rig_images->summary : nullptr);
  stage.Finish(&model->times);
  AddCovariances(input, used_priors, options, context, model);
  EstimateSoftRigOfModel(input, std::move(used_priors), options, context,
                         model);
}

void PassOn(const MapperModel& model, const PositionPriors& positions,
            const MapperOptions& options, const Context& context,
            SharedCalibration* calibration) {
  if (!model.rig_differences.empty()) return;
  calibration->Learn(
      model.reconstruction,
      model.IsAtPositions() ? model.PositionsOf(positions) : PositionPriors(),
      model.delays, options.bundle_adjustment, context);
}

}  // namespace mgsfm
