// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/model_adjustment.h"

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/covariance_report.h"
#include "bundle_adjustment/residual_field.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "georegistration/pose_graph_deformation.h"
#include "georegistration/position_offsets.h"
#include "georegistration/position_registration.h"
#include "georegistration/world_frame.h"
#include "input_check/rig_samples.h"
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

void LogPriors(const PositionPriorSummary& summary, const Context& context) {
  if (!summary.is_registered) return;
  if (!summary.message.empty()) context.Info(summary.message);
  context.Info("positions: " + std::to_string(summary.num_used) + " used, " +
               std::to_string(summary.outliers.size()) + " outliers, rms " +
               std::to_string(summary.rms.value_or(0.0)));
}

// The diagonal of the box that encloses the frames.
double ExtentOf(const Reconstruction& model) {
  Eigen::AlignedBox3d box;
  for (const auto& pose : model.rig_from_world) {
    if (pose) box.extend(pose->Center());
  }
  return box.isEmpty() ? 0.0 : box.diagonal().norm();
}

// Drift moves frames by less than the extent of their path. Positions that
// require more belong to other images.
bool IsPlausible(const ModelDeformation& deformation, double extent) {
  // Focal lengths that are 10 or 20 % wrong need up to 0.14; positions in a
  // wrong order need 0.53 or more, unless the path is nearly straight
  // (docs/results/constants.md).
  constexpr double kMaxShareOfExtent = 0.5;
  return deformation.max_shift <= kMaxShareOfExtent * extent;
}

// nullopt, with a warning, if the motion does not determine it.
std::optional<AntennaEstimate> EstimateAntenna(const PositionOffsets& offsets,
                                               const Context& context) {
  if (!offsets.lever || offsets.are_alternatives) {
    context.Warning("estimate_antenna is not possible: the motion does not " +
                    std::string(offsets.lever
                                    ? "tell the antenna from the clock of the "
                                      "positions"
                                    : "determine where the antenna is") +
                    "; it stays where it is given; measure it, and set "
                    "antenna_in_imu of body_calibration");
    return std::nullopt;
  }
  const LeverOffset& lever = *offsets.lever;
  context.Info(Formatted(
      "antenna: %.3f +- %.3f from its given place, at [%.3f, %.3f, %.3f] from "
      "it in its axes",
      lever.offset.norm(), lever.sigma, lever.offset.x(), lever.offset.y(),
      lever.offset.z()));
  return AntennaEstimate{lever.offset, lever.sigma};
}

PositionRegistration RegisterModel(const AdjustmentInput& input,
                                   const PositionPriors& positions,
                                   const Context& context,
                                   Reconstruction* initial) {
  std::optional<Eigen::Vector3d> up =
      GravityInWorld(input.scene, input.gravity, *initial);
  if (up) up = -*up;
  return RegisterToPriors(input.scene, positions,
                          {up, input.is_metric, context.random_seed}, initial);
}

// Registers the initial model to the position priors, those of the estimated
// antenna if the options request it, and deforms it toward them. Returns the
// priors for bundle adjustment: none if the deformation is implausible.
PositionPriors MoveToPriors(const AdjustmentInput& input,
                            const MapperOptions& options,
                            const Context& context, Reconstruction* initial,
                            MapperModel* model) {
  const Reconstruction unregistered = *initial;
  PositionRegistration registration =
      RegisterModel(input, input.positions, context, initial);
  if (options.estimate_antenna && registration.summary.is_registered) {
    const auto offsets = EstimatePositionOffsets(input.scene, input.positions,
                                                 *initial, input.is_metric);
    if (const auto antenna = EstimateAntenna(offsets, context)) {
      registration = RegisterModel(input, antenna->Move(input.positions),
                                   context, initial);
      registration.summary.antenna = antenna;
    }
  }
  model->position_priors = std::move(registration.summary);
  PositionPriorSummary& summary = *model->position_priors;
  const auto ignore = [&] {
    summary.is_registered = false;
    summary.antenna.reset();
    *initial = unregistered;
    return PositionPriors();
  };
  if (!summary.is_registered) return ignore();
  const PositionPriors positions = model->PositionsOf(input.positions);
  // Deformation and adjustment would hide offsets.
  const std::string text = DescribeOffsets(EstimatePositionOffsets(
      input.scene, positions, *initial, input.is_metric));
  if (!text.empty()) context.Warning(text);
  const double extent = ExtentOf(*initial);
  summary.deformation =
      DeformToPriors({input.scene, input.view_graph, input.pair_is_used,
                      positions, input.is_metric},
                     context, &registration.used, initial);
  if (!summary.deformation || IsPlausible(*summary.deformation, extent)) {
    return std::move(registration.used);
  }
  summary.message = Formatted(
      "the positions would deform the model by %.4g, but its extent "
      "is only %.4g; they are ignored",
      summary.deformation->max_shift, extent);
  return ignore();
}

void JudgeFocalLengths(const AdjustmentInput& input,
                       const BundlePriors& used_priors,
                       const MapperOptions& options, const Context& context,
                       MapperModel* model) {
  model->focal_lengths =
      CheckFocalLengths(input.scene, model->reconstruction,
                        options.bundle_adjustment, context, used_priors);
  AddLensErrors(input.scene, model->reconstruction, options.bundle_adjustment,
                context, used_priors, &model->focal_lengths);
}

// Scales the model by the known distance of two sensors, unless its unit of
// length is defined already.
void ScaleToBaseline(const AdjustmentInput& input, bool has_world,
                     const MapperOptions& options, const Context& context,
                     MapperModel* model) {
  const auto baseline = ParseMetricScale(options.metric_scale, input.scene);
  if (!baseline) return;
  if (has_world || input.is_metric) {
    context.Warning(
        "metric_scale is not used: positions, a known rig or the extended "
        "model define the unit of length");
    return;
  }
  model->meters_per_unit = MetersPerUnit(*baseline, model->reconstruction);
  if (!model->meters_per_unit) {
    context.Warning(
        "metric_scale is not used: the model lacks the pose of one of the "
        "cameras, or their positions coincide");
    return;
  }
  Sim3 metric_from_model;
  metric_from_model.scale = *model->meters_per_unit;
  TransformWorld(metric_from_model, &model->reconstruction);
}

// Accelerometers at rest measure the opposite of gravity.
void WarnIfUpsideDown(const GravityPriors& gravity, const Context& context) {
  size_t num_up = 0;
  for (const auto& direction : gravity.images) {
    if (!direction || std::abs(direction->y()) < 0.5) continue;
    if (direction->y() > 0.0) return;
    ++num_up;
  }
  if (num_up == 0) return;
  context.Warning(
      "all " + std::to_string(num_up) +
      " steep directions of gravity point to the top of their images; unless "
      "the cameras are upside down, give the opposite directions: "
      "accelerometers at rest measure the opposite of gravity");
}

// Moves the model to its final world frame.
void PlaceInWorld(const AdjustmentInput& input, const MapperOptions& options,
                  const Context& context, MapperModel* model) {
  const bool is_registered = model->IsAtPositions();
  const bool is_at_start = input.start != nullptr && !is_registered;
  if (is_at_start && input.held.frames.empty()) {
    TransformWorld(AlignToModel(input.scene, *input.start,
                                model->reconstruction, input.is_metric),
                   &model->reconstruction);
  }
  ScaleToBaseline(input, is_registered || is_at_start, options, context, model);
  model->gravity = LevelModel(
      input.scene, input.gravity, is_registered || is_at_start,
      options.rotation_averaging.gravity_sigma_deg, &model->reconstruction);
  if (model->gravity) {
    context.Info("gravity: " + std::to_string(model->gravity->num_priors) +
                 " priors, " + std::to_string(model->gravity->outliers.size()) +
                 " outliers");
    WarnIfUpsideDown(input.gravity, context);
  }
}

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

PositionPriors MapperModel::PositionsOf(PositionPriors positions) const {
  if (!position_priors || !position_priors->antenna) return positions;
  return position_priors->antenna->Move(std::move(positions));
}

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

void UsePriors(const AdjustmentInput& input, const MapperOptions& options,
               const Context& context, Reconstruction* initial,
               BundlePriors* used, MapperModel* model) {
  if (!input.positions.IsEmpty()) {
    used->positions = MoveToPriors(input, options, context, initial, model);
  }
  if (const auto gravity = EstimateGravity(
          input.scene, input.gravity,
          options.rotation_averaging.gravity_sigma_deg, *initial)) {
    used->gravity =
        GravityTerms{input.gravity, gravity->down_in_world, gravity->sigma_rad};
  }
}

void PlaceModelInWorld(const AdjustmentInput& input, const BundlePriors& used,
                       const MapperOptions& options, const Context& context,
                       MapperModel* model) {
  if (model->position_priors) {
    EvaluatePositions(input.scene, model->PositionsOf(input.positions),
                      used.positions, model->reconstruction,
                      &*model->position_priors);
    LogPriors(*model->position_priors, context);
  }
  JudgeFocalLengths(input, used, options, context, model);
  if (!options.is_for_lenses) PlaceInWorld(input, options, context, model);
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

Sim3 AlignToModel(const Scene& scene, const Reconstruction& old_model,
                  const Reconstruction& new_model, bool is_metric) {
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> centers;
  Eigen::Vector3d old_mean = Eigen::Vector3d::Zero(), new_mean = old_mean;
  Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto old_pose = old_model.CamFromWorld(scene, static_cast<int>(i));
    const auto new_pose = new_model.CamFromWorld(scene, static_cast<int>(i));
    if (!old_pose || !new_pose) continue;
    centers.emplace_back(old_pose->Center(), new_pose->Center());
    old_mean += centers.back().first;
    new_mean += centers.back().second;
    const Eigen::Vector4d q =
        (old_pose->rotation.conjugate() * new_pose->rotation).coeffs();
    moments += q * q.transpose();
  }
  Sim3 old_from_new;
  if (centers.empty()) return old_from_new;
  old_mean /= static_cast<double>(centers.size());
  new_mean /= static_cast<double>(centers.size());
  old_from_new.rotation.coeffs() =
      SymmetricEigen<Eigen::Matrix4d>(moments).V.col(3);
  double products = 0.0, squares = 0.0;
  for (const auto& [old_center, new_center] : centers) {
    const Eigen::Vector3d turned =
        old_from_new.rotation * (new_center - new_mean);
    products += turned.dot(old_center - old_mean);
    squares += turned.squaredNorm();
  }
  if (!is_metric && products > 0.0) old_from_new.scale = products / squares;
  old_from_new.translation =
      old_mean - old_from_new.scale * (old_from_new.rotation * new_mean);
  return old_from_new;
}

}  // namespace mgsfm
