// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/absolute_pose.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/pose_refinement.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kSampleSize = 3;
// Loss scales relative to max_error. Errors of inliers are at most 1, so a
// scale of 0.5 keeps them in the quadratic range and downweights those near the
// bound. The lower bound avoids a degenerate loss for exact data.
constexpr double kLossScale = 0.5;
constexpr double kMinLossScale = 0.02;

// A camera at its pose in the world.
struct PlacedCamera {
  Matrix3d cam_from_unit;
  Matrix3d unit_from_world;
  Vector3d unit_translation;
  Vector3d cam_translation;

  PlacedCamera(const CameraPoints& camera, const Rigid3& pose)
      : cam_from_unit(camera.cam_from_unit.rotation.toRotationMatrix()),
        unit_from_world(pose.rotation.toRotationMatrix()),
        unit_translation(pose.translation),
        cam_translation(camera.cam_from_unit.translation) {}

  Vector3d InCamera(const Vector3d& turned_point) const {
    return cam_from_unit * (turned_point + unit_translation) + cam_translation;
  }
};

double ReprojectionError(const PlacedCamera& placed, const CameraPoints& camera,
                         size_t i) {
  const Vector3d y = placed.InCamera(placed.unit_from_world * camera.points[i]);
  return (y.stableNormalized() - camera.rays[i]).norm() / camera.max_error_rad;
}

PoseEquations Linearize(const std::vector<CameraPoints>& cameras,
                        double loss_scale, const Rigid3& unit_from_world) {
  PoseEquations equations;
  const double squared_scale = loss_scale * loss_scale;
  for (const CameraPoints& camera : cameras) {
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      const Vector3d turned = placed.unit_from_world * camera.points[i];
      const Vector3d y = placed.InCamera(turned);
      const double length = y.norm();
      if (!(length > 0.0)) continue;
      const Vector3d n = y / length;
      const Vector3d r = (n - camera.rays[i]) / camera.max_error_rad;
      const Matrix3d by_t =
          (placed.cam_from_unit - n * (n.transpose() * placed.cam_from_unit)) /
          (length * camera.max_error_rad);
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << -by_t * CrossMatrix(turned), by_t;
      const double x = 1.0 + r.squaredNorm() / squared_scale;
      equations.hessian.noalias() += jacobian.transpose() / x * jacobian;
      equations.gradient.noalias() += jacobian.transpose() * (r / x);
      equations.cost += 0.5 * squared_scale * std::log(x);
    }
  }
  return equations;
}

size_t NumRays(const std::vector<CameraPoints>& cameras) {
  size_t num_rays = 0;
  for (const CameraPoints& camera : cameras) num_rays += camera.size();
  return num_rays;
}

std::vector<CameraPoints> InliersOf(const std::vector<CameraPoints>& cameras,
                                    const Rigid3& unit_from_world) {
  std::vector<CameraPoints> inliers;
  for (const CameraPoints& camera : cameras) {
    CameraPoints kept{camera.cam_from_unit, {}, {}, camera.max_error_rad};
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      if (!(ReprojectionError(placed, camera, i) <= 1.0)) continue;
      kept.rays.push_back(camera.rays[i]);
      kept.points.push_back(camera.points[i]);
    }
    inliers.push_back(std::move(kept));
  }
  return inliers;
}

class AbsolutePoseRansac {
 public:
  AbsolutePoseRansac(const std::vector<CameraPoints>& cameras, Random* random)
      : cameras_(cameras), random_(random) {
    for (const CameraPoints& camera : cameras) {
      num_rays_ += camera.size();
      if (camera.size() >= kSampleSize) num_to_draw_ += camera.size();
    }
  }

  std::optional<Rigid3> Run(const RansacOptions& options) {
    if (num_to_draw_ == 0) return std::nullopt;
    int num_trials = options.max_num_trials;
    for (int trial = 0; trial < num_trials; ++trial) {
      if (!Sample()) continue;
      const double inlier_ratio =
          static_cast<double>(score_.num_inliers) / num_rays_;
      num_trials = RequiredNumTrials(options, inlier_ratio, kSampleSize);
    }
    if (best_) OptimizeAtLast();
    return best_;
  }

 private:
  const CameraPoints& DrawCamera() {
    size_t ray = random_->Index(static_cast<uint32_t>(num_to_draw_));
    for (const CameraPoints& camera : cameras_) {
      if (camera.size() < kSampleSize) continue;
      if (ray < camera.size()) return camera;
      ray -= camera.size();
    }
    return cameras_.back();
  }

  // Returns whether the pose is the best so far.
  bool Try(const Rigid3& unit_from_world) {
    const PoseScore score = ScoreAbsolutePose(cameras_, unit_from_world);
    if (!(score.cost < score_.cost)) return false;
    best_ = unit_from_world;
    score_ = score;
    return true;
  }

  // Returns whether a better pose was found.
  bool Sample() {
    const CameraPoints& camera = DrawCamera();
    const auto sample = DrawSample<kSampleSize>(camera.size(), random_);
    std::array<Vector3d, 3> rays, points;
    for (int k = 0; k < kSampleSize; ++k) {
      rays[k] = camera.rays[sample[k]];
      points[k] = camera.points[sample[k]];
    }
    std::array<Rigid3, 4> poses;
    const int num_poses = SolveP3P(rays, points, &poses);
    const Rigid3 unit_from_cam = camera.cam_from_unit.Inverse();
    bool is_better = false;
    for (int i = 0; i < num_poses; ++i) {
      is_better = Try(unit_from_cam * poses[i]) || is_better;
    }
    if (is_better) Optimize(kLossScale);
    return is_better;
  }

  void Optimize(double loss_scale) {
    Rigid3 refined = *best_;
    const auto inliers = InliersOf(cameras_, *best_);
    if (RefineAbsolutePose(inliers, loss_scale, &refined).IsUsable()) {
      Try(refined);
    }
  }

  void OptimizeAtLast() {
    const auto inliers = InliersOf(cameras_, *best_);
    std::vector<double> errors = AbsolutePoseErrors(inliers, *best_);
    if (errors.empty()) return;
    const auto middle = errors.begin() + errors.size() / 2;
    std::nth_element(errors.begin(), middle, errors.end());
    Rigid3 refined = *best_;
    const double loss_scale =
        std::min(kLossScale, std::max(kMinLossScale, 2.0 * *middle));
    if (RefineAbsolutePose(inliers, loss_scale, &refined).IsUsable()) {
      best_ = refined;
    }
  }

  const std::vector<CameraPoints>& cameras_;
  Random* random_;
  size_t num_rays_ = 0;
  size_t num_to_draw_ = 0;  // rays of cameras with at least kSampleSize rays
  std::optional<Rigid3> best_;
  PoseScore score_{std::numeric_limits<double>::infinity(), 0};
};

}  // namespace

PoseScore ScoreAbsolutePose(const std::vector<CameraPoints>& cameras,
                            const Rigid3& unit_from_world) {
  PoseScore score;
  for (const CameraPoints& camera : cameras) {
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      const double error = ReprojectionError(placed, camera, i);
      const bool is_inlier = error <= 1.0;
      score.num_inliers += is_inlier;
      score.cost += is_inlier ? error * error : 1.0;
    }
  }
  return score;
}

std::vector<double> AbsolutePoseErrors(const std::vector<CameraPoints>& cameras,
                                       const Rigid3& unit_from_world) {
  std::vector<double> errors;
  errors.reserve(NumRays(cameras));
  for (const CameraPoints& camera : cameras) {
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      errors.push_back(ReprojectionError(placed, camera, i));
    }
  }
  return errors;
}

SolveSummary RefineAbsolutePose(const std::vector<CameraPoints>& cameras,
                                double loss_scale, Rigid3* unit_from_world) {
  SolveSummary summary;
  if (NumRays(cameras) < kSampleSize) {
    summary.message = "too few points";
    return summary;
  }
  constexpr PoseStepOptions kOptions{20, 1e-8, 1e-12};
  return MinimizeOverPose(
      kOptions,
      [&](const Rigid3& pose) { return Linearize(cameras, loss_scale, pose); },
      unit_from_world);
}

std::optional<Rigid3> EstimateAbsolutePose(
    const std::vector<CameraPoints>& cameras, const RansacOptions& options,
    Random* random) {
  return AbsolutePoseRansac(cameras, random).Run(options);
}

}  // namespace mgsfm
