// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/model_world.h"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "bundle_adjustment/residual_field.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "georegistration/pose_graph_deformation.h"
#include "georegistration/position_offsets.h"
#include "georegistration/position_registration.h"
#include "georegistration/world_frame.h"

namespace mgsfm {
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

void UseGravity(const AdjustmentInput& input, const MapperOptions& options,
                const Reconstruction& model, BundlePriors* used) {
  const auto gravity =
      EstimateGravity(input.scene, input.gravity,
                      options.rotation_averaging.gravity_sigma_deg, model);
  if (!gravity) return;
  used->gravity =
      GravityTerms{input.gravity, gravity->down_in_world, gravity->sigma_rad};
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

}  // namespace

PositionPriors MapperModel::PositionsOf(PositionPriors positions) const {
  if (!position_priors || !position_priors->antenna) return positions;
  return position_priors->antenna->Move(std::move(positions));
}

void UsePriors(const AdjustmentInput& input, const MapperOptions& options,
               const Context& context, Reconstruction* initial,
               BundlePriors* used, MapperModel* model) {
  if (!input.positions.IsEmpty()) {
    used->positions = MoveToPriors(input, options, context, initial, model);
  }
  UseGravity(input, options, *initial, used);
}

void UsePriorsInPlace(const AdjustmentInput& input,
                      const MapperOptions& options, const Context& context,
                      BundlePriors* used, MapperModel* model) {
  if (!input.positions.IsEmpty()) {
    Reconstruction moved = model->reconstruction;
    PositionRegistration registration =
        RegisterModel(input, input.positions, context, &moved);
    model->position_priors = std::move(registration.summary);
    used->positions = std::move(registration.used);
  }
  UseGravity(input, options, model->reconstruction, used);
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
