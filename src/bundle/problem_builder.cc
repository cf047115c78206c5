// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/problem_builder.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "bundle/dense_numbering.h"
#include "bundle/image_views.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Standard deviations from which on gravity counts less.
constexpr double kGravityLossScale = 2.8;

bool Refines(RefineMode mode, bool is_known) {
  return mode == RefineMode::kYes || (mode == RefineMode::kAuto && !is_known);
}

double LargestGivenTranslation(const Scene& scene, int rig_idx) {
  double largest = 0.0;
  for (const int sensor_idx : scene.rigs[rig_idx].sensor_idxs) {
    const auto& given = scene.sensors[sensor_idx].sensor_from_rig;
    if (given) largest = std::max(largest, given->translation.norm());
  }
  return largest;
}

class ProblemBuilder {
 public:
  ProblemBuilder(const Scene& scene, const Reconstruction& reconstruction,
                 const BundleAdjustmentOptions& options, RefinedParts parts,
                 const BundlePriors& priors, const FixedPoses& held)
      : scene_(scene),
        reconstruction_(reconstruction),
        options_(options),
        parts_(parts),
        priors_(priors),
        held_(held) {}

  BuiltProblem Build() {
    built_.problem.points_are_free = options_.refine_points;
    built_.problem.loss = {RobustLossType::kHuber, options_.loss_scale_px};
    AddPoints();
    for (const int frame_idx : built_.frame_idxs) AddFrame(frame_idx);
    for (const int sensor_idx : built_.sensor_idxs) AddSensor(sensor_idx);
    for (const int camera_idx : built_.camera_idxs) AddCamera(camera_idx);
    AddPositionPriors();
    AddGravityPriors();
    if (options_.refine_rig_from_world && options_.refine_points &&
        built_.problem.position_priors.empty() && !HoldsAFrame()) {
      FixGauge(built_.state, &built_.problem);
    }
    return std::move(built_);
  }

 private:
  void AddPoints();
  void AddFrame(int frame_idx);
  void AddSensor(int sensor_idx);
  void AddCamera(int camera_idx);
  void AddPositionPriors();
  void AddGravityPriors();
  std::vector<int> FreeParams(const Camera& camera) const;

  static bool IsSet(const Mask& flags, int idx) {
    return !flags.empty() && flags[idx];
  }
  bool HoldsAFrame() const {
    return std::any_of(
        built_.frame_idxs.begin(), built_.frame_idxs.end(),
        [this](int frame_idx) { return IsSet(held_.frames, frame_idx); });
  }
  PoseMask Mask(bool is_refined) const {
    PoseMask mask = PoseMask::Zero();
    if (!is_refined) return mask;
    mask.tail<3>().setOnes();
    if (parts_ == RefinedParts::kAll) mask.head<3>().setOnes();
    return mask;
  }

  const Scene& scene_;
  const Reconstruction& reconstruction_;
  const BundleAdjustmentOptions& options_;
  const RefinedParts parts_;
  const BundlePriors& priors_;
  const FixedPoses& held_;
  BuiltProblem built_;
  std::vector<int> image_idxs_;  // of the images of the problem
};

void ProblemBuilder::AddPoints() {
  const std::vector<ImageView> views = MakeImageViews(scene_, reconstruction_);
  BundleProblem& problem = built_.problem;
  DenseNumbering frames(scene_.frames.size()), sensors(scene_.sensors.size());
  DenseNumbering cameras(scene_.cameras.size()), images(scene_.images.size());
  std::vector<const Observation*> visible;
  for (size_t i = 0; i < reconstruction_.points.size(); ++i) {
    const Point3D& point = reconstruction_.points[i];
    visible.clear();
    for (const Observation& o : point.track) {
      const ImageView& view = views[o.image_idx];
      if (!view.is_registered) continue;
      if (view.Project(point.point_in_world)) {
        visible.push_back(&o);
      } else {
        ++built_.num_invisible_observations;
      }
    }
    if (visible.size() < 2) continue;
    for (const Observation* o : visible) {
      const Image& image = scene_.images[o->image_idx];
      const int number = images.NumberOf(o->image_idx, &image_idxs_);
      if (number == static_cast<int>(problem.images.size())) {
        problem.images.push_back(
            {frames.NumberOf(image.frame_idx, &built_.frame_idxs),
             sensors.NumberOf(image.sensor_idx, &built_.sensor_idxs),
             cameras.NumberOf(image.camera_idx, &built_.camera_idxs)});
      }
      problem.observations.push_back(
          {number, image.keypoints_px[o->keypoint_idx].cast<double>()});
    }
    problem.point_begin.push_back(problem.observations.size());
    built_.state.points.push_back(point.point_in_world);
    built_.point_idxs.push_back(static_cast<int>(i));
  }
}

void ProblemBuilder::AddPositionPriors() {
  if (priors_.positions.IsEmpty()) return;
  BundleProblem& problem = built_.problem;
  problem.position_loss = {RobustLossType::kCauchy,
                           options_.prior_position_loss_scale};
  for (size_t i = 0; i < image_idxs_.size(); ++i) {
    const auto& prior = priors_.positions.images[image_idxs_[i]];
    if (!prior) continue;
    problem.position_priors.push_back(
        {static_cast<int>(i), prior->position,
         prior->covariance.llt().matrixL().solve(Eigen::Matrix3d::Identity())});
  }
}

void ProblemBuilder::AddGravityPriors() {
  if (!priors_.gravity) return;
  const GravityTerms& gravity = *priors_.gravity;
  BundleProblem& problem = built_.problem;
  problem.gravity_loss = {RobustLossType::kCauchy, kGravityLossScale};
  for (size_t i = 0; i < image_idxs_.size(); ++i) {
    const auto& direction = gravity.priors.images[image_idxs_[i]];
    if (!direction) continue;
    problem.gravity_priors.push_back({static_cast<int>(i), *direction,
                                      gravity.down_in_world,
                                      gravity.sigma_rad});
  }
}

void ProblemBuilder::AddFrame(int frame_idx) {
  const Rigid3& pose = *reconstruction_.rig_from_world[frame_idx];
  built_.state.frames.push_back({pose.rotation, pose.Center()});
  built_.problem.frame_masks.push_back(
      Mask(options_.refine_rig_from_world && !IsSet(held_.frames, frame_idx)));
}

void ProblemBuilder::AddSensor(int sensor_idx) {
  built_.state.sensors.push_back(*reconstruction_.sensor_from_rig[sensor_idx]);
  const bool is_held = IsSet(held_.sensors, sensor_idx);
  RefinedSensor refined =
      is_held ? RefinedSensor() : RefineSensor(scene_, sensor_idx, options_);
  BundleProblem& problem = built_.problem;
  problem.sensor_masks.emplace_back(refined.mask.cwiseProduct(Mask(true)));
  if (!refined.prior) return;
  refined.prior->sensor = static_cast<int>(problem.sensor_masks.size()) - 1;
  problem.sensor_priors.push_back(*refined.prior);
}

void ProblemBuilder::AddCamera(int camera_idx) {
  const Camera& camera = reconstruction_.cameras[camera_idx];
  const Camera& given = scene_.cameras[camera_idx];
  CameraParams params{};
  std::copy(camera.params.begin(), camera.params.end(), params.begin());
  const int number = static_cast<int>(built_.problem.cameras.size());
  built_.state.cameras.push_back(params);
  built_.problem.cameras.push_back({camera.model, FreeParams(given)});
  const double relative_sigma = given.has_prior_focal_length
                                    ? options_.focal_length_prior_sigma
                                    : options_.focal_length_start_sigma;
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int32_t>(camera.model));
  const std::vector<int>& free = built_.problem.cameras.back().free_params;
  for (const int param : info.focal_length_idxs) {
    if (!std::binary_search(free.begin(), free.end(), param)) continue;
    const double value = given.params[param];
    built_.problem.priors.push_back(
        {number, param, value, relative_sigma * value});
  }
}

std::vector<int> ProblemBuilder::FreeParams(const Camera& camera) const {
  std::vector<int> free;
  if (parts_ != RefinedParts::kAll) return free;
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int32_t>(camera.model));
  const auto add = [&free](bool is_refined, const std::vector<int>& params) {
    if (is_refined) free.insert(free.end(), params.begin(), params.end());
  };
  const bool is_known = camera.has_prior_focal_length;
  add(RefinesFocalLength(camera, options_), info.focal_length_idxs);
  add(options_.refine_principal_point, info.principal_point_idxs);
  add(Refines(options_.refine_extra_params, is_known), info.extra_params_idxs);
  std::sort(free.begin(), free.end());
  return free;
}

}  // namespace

BuiltProblem BuildProblem(const Scene& scene,
                          const Reconstruction& reconstruction,
                          const BundleAdjustmentOptions& options,
                          RefinedParts parts, const BundlePriors& priors,
                          const FixedPoses& held) {
  return ProblemBuilder(scene, reconstruction, options, parts, priors, held)
      .Build();
}

RefinedSensor RefineSensor(const Scene& scene, int sensor_idx,
                           const BundleAdjustmentOptions& options) {
  RefinedSensor refined;
  const Sensor& sensor = scene.sensors[sensor_idx];
  if (scene.IsReference(sensor_idx) ||
      !Refines(options.refine_sensor_from_rig,
               sensor.sensor_from_rig.has_value())) {
    return refined;
  }
  refined.mask.setOnes();
  if (!sensor.sensor_from_rig) return refined;
  const double length = LargestGivenTranslation(scene, sensor.rig_idx);
  // Without a length, all given cameras share one centre.
  if (length == 0.0) refined.mask.tail<3>().setZero();
  refined.prior = SensorPrior{
      sensor_idx, *sensor.sensor_from_rig,
      DegToRad(options.sensor_from_rig_prior_sigma_deg),
      length > 0.0 ? options.sensor_from_rig_prior_sigma * length : 1.0};
  return refined;
}

bool RefinesFocalLength(const Camera& camera,
                        const BundleAdjustmentOptions& options) {
  return Refines(options.refine_focal_length, camera.has_prior_focal_length);
}

void WriteBack(const BuiltProblem& built, Reconstruction* reconstruction) {
  const BundleProblem& problem = built.problem;
  const BundleState& state = built.state;
  const auto is_free = [](const PoseMask& mask) {
    return (mask.array() != 0.0).any();
  };
  for (size_t i = 0; i < built.frame_idxs.size(); ++i) {
    if (!is_free(problem.frame_masks[i])) continue;
    const FramePose& pose = state.frames[i];
    reconstruction->rig_from_world[built.frame_idxs[i]] =
        Rigid3::FromRotationAndCenter(pose.rig_from_world, pose.center);
  }
  for (size_t i = 0; i < built.sensor_idxs.size(); ++i) {
    if (!is_free(problem.sensor_masks[i])) continue;
    reconstruction->sensor_from_rig[built.sensor_idxs[i]] = state.sensors[i];
  }
  for (size_t i = 0; i < built.camera_idxs.size(); ++i) {
    std::vector<double>& params =
        reconstruction->cameras[built.camera_idxs[i]].params;
    std::copy_n(state.cameras[i].begin(), params.size(), params.begin());
  }
  for (size_t i = 0; i < built.point_idxs.size(); ++i) {
    reconstruction->points[built.point_idxs[i]].point_in_world =
        state.points[i];
  }
}

}  // namespace mgsfm
