// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/problem_builder.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

bool Refines(RefineMode mode, bool is_known) {
  return mode == RefineMode::kYes || (mode == RefineMode::kAuto && !is_known);
}

double LargestPriorTranslation(const Scene& scene, int rig_idx) {
  double largest = 0.0;
  for (const int sensor_idx : scene.rigs[rig_idx].sensor_idxs) {
    const auto& prior = scene.sensors[sensor_idx].sensor_from_rig;
    if (prior) largest = std::max(largest, prior->translation.norm());
  }
  return largest;
}

struct ProblemInput {
  const Scene& scene;
  const Reconstruction& reconstruction;
  const BundleAdjustmentOptions& options;
  const RefinedParts parts;
  const BundlePriors& priors;
  const FixedPoses& fixed;
};

bool IsSet(const Mask& mask, int idx) { return !mask.empty() && mask[idx]; }

PoseMask MakePoseMask(bool is_refined, RefinedParts parts) {
  PoseMask mask = PoseMask::Zero();
  if (!is_refined) return mask;
  mask.tail<3>().setOnes();
  if (parts == RefinedParts::kAll) mask.head<3>().setOnes();
  return mask;
}

// Adds all points with at least two visible observations.
void AddPoints(const ProblemInput& input, BuiltProblem* built) {
  const Scene& scene = input.scene;
  const std::vector<ImageView> views =
      MakeImageViews(scene, input.reconstruction);
  BundleProblem& problem = built->problem;
  DenseNumbering frames(scene.frames.size()), sensors(scene.sensors.size());
  DenseNumbering cameras(scene.cameras.size()), images(scene.images.size());
  std::vector<const Observation*> visible;
  problem.observations.reserve(NumObservations(input.reconstruction));
  const size_t num_points = input.reconstruction.points.size();
  problem.point_begin.reserve(num_points + 1);
  built->state.points.reserve(num_points);
  built->point_idxs.reserve(num_points);
  for (size_t i = 0; i < input.reconstruction.points.size(); ++i) {
    const Point3D& point = input.reconstruction.points[i];
    visible.clear();
    for (const Observation& o : point.track) {
      const ImageView& view = views[o.image_idx];
      if (!view.is_registered) continue;
      if (view.Project(point.point_in_world)) {
        visible.push_back(&o);
      } else {
        ++built->num_invisible_observations;
      }
    }
    if (visible.size() < 2) continue;
    for (const Observation* o : visible) {
      const Image& image = scene.images[o->image_idx];
      const int number = images.NumberOf(o->image_idx, &built->image_idxs);
      if (number == static_cast<int>(problem.images.size())) {
        problem.images.push_back(
            {frames.NumberOf(image.frame_idx, &built->frame_idxs),
             sensors.NumberOf(image.sensor_idx, &built->sensor_idxs),
             cameras.NumberOf(image.camera_idx, &built->camera_idxs)});
      }
      problem.observations.push_back(
          {number, image.keypoints_px[o->keypoint_idx]});
    }
    problem.point_begin.push_back(problem.observations.size());
    built->state.points.push_back(point.point_in_world);
    built->point_idxs.push_back(static_cast<int>(i));
  }
}

void AddFrame(const ProblemInput& input, int frame_idx, BuiltProblem* built) {
  const Rigid3& pose = *input.reconstruction.rig_from_world[frame_idx];
  built->state.frames.push_back({pose.rotation, pose.Center()});
  const bool is_refined = input.options.refine_rig_from_world &&
                          !IsSet(input.fixed.frames, frame_idx);
  built->problem.frame_masks.push_back(MakePoseMask(is_refined, input.parts));
}

void AddSensor(const ProblemInput& input, int sensor_idx, BuiltProblem* built) {
  built->state.sensors.push_back(
      *input.reconstruction.sensor_from_rig[sensor_idx]);
  RefinedSensor refined =
      IsSet(input.fixed.sensors, sensor_idx)
          ? RefinedSensor()
          : RefineSensor(input.scene, sensor_idx, input.options);
  const auto& found = input.priors.calibration.sensors;
  if (!found.empty() && found[sensor_idx] && !refined.mask.isZero(0.0)) {
    refined.prior = SensorPrior{0, found[sensor_idx]->sensor_from_rig, 1.0, 1.0,
                                found[sensor_idx]->sqrt_information};
  }
  BundleProblem& problem = built->problem;
  problem.sensor_masks.emplace_back(
      refined.mask.cwiseProduct(MakePoseMask(true, input.parts)));
  if (!refined.prior) return;
  refined.prior->sensor = static_cast<int>(problem.sensor_masks.size()) - 1;
  problem.sensor_priors.push_back(*refined.prior);
}

// The standard deviations of the parameters of a camera in the calibration;
// empty if it has none.
std::vector<double> KnownSigmas(const CalibrationPrior& calibration,
                                int camera_idx) {
  return calibration.intrinsic_sigmas.empty()
             ? std::vector<double>()
             : calibration.intrinsic_sigmas[camera_idx];
}

std::vector<int> FreeParams(const Camera& camera,
                            const std::vector<double>& known_sigmas,
                            const BundleAdjustmentOptions& options,
                            RefinedParts parts) {
  std::vector<int> free;
  if (parts != RefinedParts::kAll) return free;
  if (!known_sigmas.empty()) {
    for (size_t i = 0; i < known_sigmas.size(); ++i) {
      if (known_sigmas[i] > 0.0) free.push_back(static_cast<int>(i));
    }
    return free;
  }
  const CameraModelInfo& info = InfoOf(camera.model);
  const auto add = [&free](bool is_refined, const std::vector<int>& params) {
    if (is_refined) free.insert(free.end(), params.begin(), params.end());
  };
  add(RefinesFocalLength(camera, options), info.focal_length_idxs);
  add(options.refine_principal_point == RefineMode::kYes,
      info.principal_point_idxs);
  add(Refines(options.refine_extra_params, camera.has_prior_focal_length),
      info.extra_params_idxs);
  std::sort(free.begin(), free.end());
  return free;
}

void AddCamera(const ProblemInput& input, int camera_idx, BuiltProblem* built) {
  const Camera& camera = input.reconstruction.cameras[camera_idx];
  const Camera& prior = input.scene.cameras[camera_idx];
  CameraParams params{};
  std::copy(camera.params.begin(), camera.params.end(), params.begin());
  const int number = static_cast<int>(built->problem.cameras.size());
  const CalibrationPrior& found = input.priors.calibration;
  const std::vector<double> known_sigmas = KnownSigmas(found, camera_idx);
  built->state.cameras.push_back(params);
  built->problem.cameras.push_back(
      {camera.model,
       FreeParams(prior, known_sigmas, input.options, input.parts)});
  const double relative_sigma = prior.has_prior_focal_length
                                    ? input.options.focal_length_prior_sigma
                                    : input.options.focal_length_start_sigma;
  const CameraModelInfo& info = InfoOf(camera.model);
  const std::vector<int>& free = built->problem.cameras.back().free_params;
  if (!known_sigmas.empty()) {
    for (const int param : free) {
      built->problem.priors.push_back({number, param,
                                       found.intrinsics[camera_idx][param],
                                       known_sigmas[param]});
    }
    return;
  }
  for (const int param : info.focal_length_idxs) {
    if (!std::binary_search(free.begin(), free.end(), param)) continue;
    const double value = prior.params[param];
    built->problem.priors.push_back(
        {number, param, value, relative_sigma * value});
  }
}

void AddPositionPriors(const ProblemInput& input,
                       const std::vector<int>& image_idxs,
                       BundleProblem* problem) {
  const PositionPriors& priors = input.priors.positions;
  if (priors.IsEmpty()) return;
  problem->position_loss = {RobustLossType::kCauchy,
                            input.options.prior_loss_scale};
  for (size_t i = 0; i < image_idxs.size(); ++i) {
    const auto& prior = priors.images[image_idxs[i]];
    if (!prior) continue;
    problem->position_priors.push_back(
        {static_cast<int>(i), prior->position,
         prior->covariance.llt().matrixL().solve(Eigen::Matrix3d::Identity()),
         prior->cam_from_antenna.translation});
  }
}

void AddGravityPriors(const GravityTerms& gravity,
                      const std::vector<int>& image_idxs, double loss_scale,
                      BundleProblem* problem) {
  problem->gravity_loss = {RobustLossType::kCauchy, loss_scale};
  for (size_t i = 0; i < image_idxs.size(); ++i) {
    const auto& direction = gravity.priors.images[image_idxs[i]];
    if (!direction) continue;
    problem->gravity_priors.push_back({static_cast<int>(i), *direction,
                                       gravity.down_in_world,
                                       gravity.sigma_rad});
  }
}

}  // namespace

BuiltProblem BuildProblem(const Scene& scene,
                          const Reconstruction& reconstruction,
                          const BundleAdjustmentOptions& options,
                          RefinedParts parts, const BundlePriors& priors,
                          const FixedPoses& fixed) {
  const ProblemInput input{scene, reconstruction, options,
                           parts, priors,         fixed};
  BuiltProblem built;
  BundleProblem& problem = built.problem;
  problem.points_are_free = options.refine_points;
  problem.loss = {RobustLossType::kCauchy, options.loss_scale_px};
  problem.loss_follows_freedom = true;
  AddPoints(input, &built);
  const std::vector<int>& image_idxs = built.image_idxs;
  if (!reconstruction.motions.empty()) {
    for (const int image_idx : image_idxs) {
      problem.motions.push_back(reconstruction.motions[image_idx]);
    }
  }
  for (const int frame_idx : built.frame_idxs) {
    AddFrame(input, frame_idx, &built);
  }
  for (const int sensor_idx : built.sensor_idxs) {
    AddSensor(input, sensor_idx, &built);
  }
  for (const int camera_idx : built.camera_idxs) {
    AddCamera(input, camera_idx, &built);
  }
  AddPositionPriors(input, image_idxs, &problem);
  if (priors.gravity) {
    AddGravityPriors(*priors.gravity, image_idxs, options.prior_loss_scale,
                     &problem);
  }
  const bool some_frame_is_fixed = AnyOf(built.frame_idxs, [&](int frame_idx) {
    return IsSet(fixed.frames, frame_idx);
  });
  if (options.refine_rig_from_world && options.refine_points &&
      problem.position_priors.empty() && !some_frame_is_fixed) {
    FixGauge(built.state, &problem);
  }
  return built;
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
  const double length = LargestPriorTranslation(scene, sensor.rig_idx);
  // All prior sensors share one center. Keep it: it determines no length.
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
