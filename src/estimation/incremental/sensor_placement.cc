// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/format.h"
#include "geometry/so3.h"
#include "incremental/growth_steps.h"
#include "mgsfm/geometry/camera_models.h"
#include "registration/unit_resection.h"
#include "scene/typical_pose.h"

namespace mgsfm {
namespace {

// Two samples cannot show which of them is wrong.
constexpr size_t kMinNumSamples = 3;

// The rays of a camera that agree with a pose.
CameraPoints InliersOf(const CameraPoints& points, const Rigid3& pose) {
  const std::vector<double> errors = AbsolutePoseErrors({points}, pose);
  CameraPoints inliers{points.cam_from_unit, {}, {}, points.max_error_rad, {}};
  for (size_t i = 0; i < errors.size(); ++i) {
    if (errors[i] > 1.0) continue;
    inliers.rays.push_back(points.rays[i]);
    inliers.points.push_back(points.points[i]);
  }
  return inliers;
}

}  // namespace

SensorPlacement::SensorPlacement(const GrowthInput& input)
    : input_(input),
      samples_(input.scene.sensors.size()),
      num_tried_(input.scene.images.size(), 0) {}

void SensorPlacement::Restart() {
  samples_.assign(samples_.size(), {});
  num_tried_.assign(num_tried_.size(), 0);
}

void SensorPlacement::AddSamples(const GrowingModel& model) {
  const Scene& scene = input_.scene;
  const ResectionOptions& options = input_.options.resection;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const Image& image = scene.images[i];
    if (model.HasSensor(image.sensor_idx) || !model.HasFrame(image.frame_idx)) {
      continue;
    }
    const int num_visible = model.NumVisible(image_idx);
    if (num_visible < options.abs_pose_min_num_inliers ||
        2 * num_visible < 3 * num_tried_[i]) {
      continue;
    }
    num_tried_[i] = num_visible;
    const CameraPoints points = model.MatchesOf(image_idx, Rigid3()).points;
    const std::optional<Rigid3> cam_from_world =
        ResectUnit({points}, options, input_.context.random_seed, i)
            .unit_from_world;
    if (!cam_from_world) continue;
    const Rigid3 world_from_rig =
        model.poses().rig_from_world[image.frame_idx]->Inverse();
    // A step of the pose moves t_k = t + R c by d + [w]_x R c, with the center
    // c of the rig in the world.
    PoseMatrix jacobian = PoseMatrix::Identity();
    jacobian.bottomLeftCorner<3, 3>() =
        -CrossMatrix(cam_from_world->rotation * world_from_rig.translation);
    const PoseMatrix covariance =
        jacobian *
        AbsolutePoseCovariance({InliersOf(points, *cam_from_world)},
                               kKeypointSigma, *cam_from_world) *
        jacobian.transpose();
    samples_[image.sensor_idx].push_back(
        {*cam_from_world * world_from_rig,
         covariance.ldlt().solve(PoseMatrix::Identity())});
  }
}

namespace {

// The weighted mean of samples and its standard deviations.
struct MeanPose {
  Rigid3 pose;
  double rotation_sigma_rad = 0.0;
  double translation_sigma = 0.0;
};

template <class Samples>
MeanPose MeanOf(const Samples& samples) {
  std::vector<Rigid3> poses;
  for (const auto& sample : samples) poses.push_back(sample.sensor_from_rig);
  const Rigid3 typical = TypicalPose(poses);
  PoseMatrix information = PoseMatrix::Zero();
  PoseVector sum = PoseVector::Zero();
  for (const auto& sample : samples) {
    information += sample.information;
    sum += sample.information * UpdateBetween(typical, sample.sensor_from_rig);
  }
  const PoseMatrix covariance =
      information.ldlt().solve(PoseMatrix::Identity());
  const PoseVector mean = covariance * sum;
  double chi2 = 0.0;
  for (const auto& sample : samples) {
    const PoseVector difference =
        UpdateBetween(typical, sample.sensor_from_rig) - mean;
    chi2 += difference.dot(sample.information * difference);
  }
  double variance_factor = 1.0;
  if (samples.size() > 1) {
    variance_factor = std::max(
        1.0, chi2 / (6.0 * (static_cast<double>(samples.size()) - 1.0)));
  }
  const auto largest_sigma = [&](const Eigen::Matrix3d& block) {
    const double variance =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(block).eigenvalues()[2];
    return std::sqrt(std::max(0.0, variance_factor * variance));
  };
  return {Updated(typical, mean),
          largest_sigma(covariance.topLeftCorner<3, 3>()),
          largest_sigma(covariance.bottomRightCorner<3, 3>())};
}

}  // namespace

std::vector<PlacedSensor> SensorPlacement::Place(bool is_last_resort,
                                                 GrowingModel* model) {
  AddSamples(*model);
  const Scene& scene = input_.scene;
  std::vector<PlacedSensor> placed;
  const auto place = [&](size_t i, const MeanPose& mean) {
    model->SetSensor(static_cast<int>(i), mean.pose);
    placed.push_back(
        {static_cast<int>(i), static_cast<int>(samples_[i].size())});
    input_.context.Info(Formatted(
        "camera '%s' joins its rig after %zu frames: standard deviations %.3g "
        "deg and %.3g of the median depth",
        scene.sensors[i].name.c_str(), samples_[i].size(),
        RadToDeg(mean.rotation_sigma_rad),
        mean.translation_sigma / model->median_distance()));
  };
  size_t most = 0;
  for (size_t i = 0; i < samples_.size(); ++i) {
    if (model->HasSensor(static_cast<int>(i))) continue;
    if (samples_[i].size() > samples_[most].size() ||
        model->HasSensor(static_cast<int>(most))) {
      most = i;
    }
    if (samples_[i].size() < kMinNumSamples) continue;
    const MeanPose mean = MeanOf(samples_[i]);
    const Camera& camera = model->poses().cameras[scene.sensors[i].camera_idx];
    const double error_px =
        (mean.rotation_sigma_rad +
         mean.translation_sigma / model->median_distance()) *
        PixelsPerRadian(camera);
    if (error_px > 0.5 * input_.options.bundle_adjustment.max_max_error_px) {
      continue;
    }
    place(i, mean);
  }
  if (placed.empty() && is_last_resort &&
      !model->HasSensor(static_cast<int>(most)) && !samples_[most].empty()) {
    place(most, MeanOf(samples_[most]));
  }
  return placed;
}

}  // namespace mgsfm
