// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/absolute_pose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/ranges.h"
#include "geometry/pose_refinement.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A minimal sample: each ray constrains two of six unknowns.
using MinimalSample = std::array<Vector3d, 3>;
constexpr int kSampleSize = std::tuple_size_v<MinimalSample>;

// A camera at its pose in the world.
struct PlacedCamera {
  Matrix3d cam_from_world;
  Vector3d translation;

  PlacedCamera(const CameraPoints& camera, const Rigid3& pose)
      : cam_from_world(
            (camera.cam_from_unit.rotation * pose.rotation).toRotationMatrix()),
        translation((camera.cam_from_unit * pose).translation) {}

  Vector3d InCamera(const Vector3d& point) const {
    return cam_from_world * point + translation;
  }
};

// The error of one ray, and how the depth of its point changes it.
struct RayError {
  Vector3d r;
  Vector3d g = Vector3d::Zero();  // in units of kKeypointSigma
  Vector3d direction;             // of the point, in the camera
  double distance = 0.0;          // of the point from the camera

  double SquaredNorm() const {
    const double along = r.dot(g);
    const double squared =
        r.squaredNorm() - along * along / (1.0 + g.squaredNorm());
    return std::max(0.0, squared);  // rounding
  }
};

// The point and its depth_sigma are in the camera frame.
RayError ErrorOf(const Vector3d& point, const Vector3d& depth_sigma,
                 const Vector3d& ray, double max_error_rad) {
  RayError error;
  error.distance = point.norm();
  error.direction = error.distance > 0.0 ? Vector3d(point / error.distance)
                                         : Vector3d::Zero();
  error.r = (error.direction - ray) / max_error_rad;
  if (!(error.distance > 0.0)) return error;
  error.g = (depth_sigma - error.direction * error.direction.dot(depth_sigma)) /
            (error.distance * max_error_rad * kKeypointSigma);
  return error;
}

RayError ErrorOf(const PlacedCamera& placed, const CameraPoints& camera,
                 size_t i) {
  return ErrorOf(placed.InCamera(camera.points[i]),
                 camera.depth_sigmas.empty()
                     ? Vector3d::Zero()
                     : Vector3d(placed.cam_from_world * camera.depth_sigmas[i]),
                 camera.rays[i], camera.max_error_rad);
}

// The equations for a rotation w and a translation t in the camera frame, which
// move the point q + translation by w x q + t. With s = 1 / (distance
// max_error), the derivative of r is s (I - n n^T) per movement, and whitening
// by the covariance I + g g^T leaves s^2 (I - n n^T - h h^T) of the Hessian,
// h = g / sqrt(1 + |g|^2). g is orthogonal to n.
class CameraEquations {
 public:
  explicit CameraEquations(double loss_scale)
      : squared_scale_(loss_scale * loss_scale) {}

  void Add(const RayError& error, const Vector3d& q, double max_error_rad) {
    const Vector3d& n = error.direction;
    const Vector3d h = error.g / std::sqrt(1.0 + error.g.squaredNorm());
    const double along = error.r.dot(h);
    const double x =
        1.0 +
        std::max(0.0, error.r.squaredNorm() - along * along) / squared_scale_;
    const double s = 1.0 / (error.distance * max_error_rad);
    Matrix3d by_tt = -n * n.transpose();
    by_tt.noalias() -= h * h.transpose();
    by_tt.diagonal().array() += 1.0;
    by_tt *= s * s / x;
    const Vector3d by_t = (error.r - n * n.dot(error.r) - h * along) * (s / x);
    const Matrix3d cross = CrossMatrix(q);
    const Matrix3d by_wt = cross * by_tt;
    tt_ += by_tt;
    wt_ += by_wt;
    ww_.noalias() -= by_wt * cross;
    t_ += by_t;
    w_ += q.cross(by_t);
    sum_of_logs_.Add(x);
  }

  // Adds the equations for a rotation and translation in the frame of the unit.
  void AddTo(const Matrix3d& cam_from_unit, PoseEquations* equations) const {
    const Matrix3d& C = cam_from_unit;
    auto& hessian = equations->hessian;
    const Matrix3d by_wt = C.transpose() * wt_ * C;
    hessian.topLeftCorner<3, 3>() += C.transpose() * ww_ * C;
    hessian.topRightCorner<3, 3>() += by_wt;
    hessian.bottomLeftCorner<3, 3>() += by_wt.transpose();
    hessian.bottomRightCorner<3, 3>() += C.transpose() * tt_ * C;
    equations->gradient.head<3>() += C.transpose() * w_;
    equations->gradient.tail<3>() += C.transpose() * t_;
    equations->cost += 0.5 * squared_scale_ * sum_of_logs_.Total();
  }

 private:
  double squared_scale_;
  Matrix3d ww_ = Matrix3d::Zero();
  Matrix3d wt_ = Matrix3d::Zero();
  Matrix3d tt_ = Matrix3d::Zero();
  Vector3d w_ = Vector3d::Zero();
  Vector3d t_ = Vector3d::Zero();
  LogSum sum_of_logs_;
};

PoseEquations Linearize(const std::vector<CameraPoints>& cameras,
                        double loss_scale, const Rigid3& unit_from_world) {
  PoseEquations equations;
  for (const CameraPoints& camera : cameras) {
    const PlacedCamera placed(camera, unit_from_world);
    CameraEquations of_camera(loss_scale);
    for (size_t i = 0; i < camera.size(); ++i) {
      const RayError error = ErrorOf(placed, camera, i);
      if (!(error.distance > 0.0)) continue;
      of_camera.Add(error, placed.cam_from_world * camera.points[i],
                    camera.max_error_rad);
    }
    of_camera.AddTo(camera.cam_from_unit.rotation.toRotationMatrix(),
                    &equations);
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
    CameraPoints kept{camera.cam_from_unit, {}, {}, camera.max_error_rad, {}};
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      if (!(ErrorOf(placed, camera, i).SquaredNorm() <= 1.0)) continue;
      kept.rays.push_back(camera.rays[i]);
      kept.points.push_back(camera.points[i]);
      if (!camera.depth_sigmas.empty()) {
        kept.depth_sigmas.push_back(camera.depth_sigmas[i]);
      }
    }
    inliers.push_back(std::move(kept));
  }
  return inliers;
}

// The returned pose is refined until the relative change of its cost is 1e-8.
constexpr PoseStepOptions kConverged{20, 1e-8, 1e-12};
// The result is only the start of another refinement.
constexpr PoseStepOptions kLocal{5, 1e-3, 1e-12};

SolveSummary Refine(const std::vector<CameraPoints>& cameras, double loss_scale,
                    const PoseStepOptions& options, Rigid3* unit_from_world) {
  SolveSummary summary;
  if (NumRays(cameras) < kSampleSize) {
    summary.message = "too few points";
    return summary;
  }
  return MinimizeOverPose(
      options,
      [&](const Rigid3& pose) { return Linearize(cameras, loss_scale, pose); },
      unit_from_world);
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
    const PoseScore score =
        ScoreAbsolutePose(cameras_, unit_from_world, score_.cost);
    if (!(score.cost < score_.cost)) return false;
    best_ = unit_from_world;
    score_ = score;
    return true;
  }

  // Returns whether a better pose was found.
  bool Sample() {
    const CameraPoints& camera = DrawCamera();
    const auto sample = DrawSample<kSampleSize>(camera.size(), random_);
    MinimalSample rays, points;
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
    if (is_better) Optimize(kInlierLossScale);
    return is_better;
  }

  void Optimize(double loss_scale) {
    Rigid3 refined = *best_;
    const auto inliers = InliersOf(cameras_, *best_);
    if (Refine(inliers, loss_scale, kLocal, &refined).IsUsable()) {
      Try(refined);
    }
  }

  void OptimizeAtLast() {
    const auto inliers = InliersOf(cameras_, *best_);
    const std::vector<double> errors = AbsolutePoseErrors(inliers, *best_);
    if (errors.empty()) return;
    Rigid3 refined = *best_;
    // The lower bound avoids a degenerate loss for exact data.
    const double loss_scale =
        std::min(kInlierLossScale, std::max(0.02, 2.0 * UpperMedian(errors)));
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

bool IsRayInlier(const Vector3d& point, const Vector3d& depth_sigma,
                 const Vector3d& ray, double max_error_rad) {
  return ErrorOf(point, depth_sigma, ray, max_error_rad).SquaredNorm() <= 1.0;
}

PoseScore ScoreAbsolutePose(const std::vector<CameraPoints>& cameras,
                            const Rigid3& unit_from_world, double max_cost) {
  PoseScore score;
  for (const CameraPoints& camera : cameras) {
    const PlacedCamera placed(camera, unit_from_world);
    for (size_t i = 0; i < camera.size(); ++i) {
      const double squared = ErrorOf(placed, camera, i).SquaredNorm();
      const bool is_inlier = squared <= 1.0;
      score.num_inliers += is_inlier;
      score.cost += is_inlier ? squared : 1.0;
      if (score.cost >= max_cost) return score;
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
      errors.push_back(std::sqrt(ErrorOf(placed, camera, i).SquaredNorm()));
    }
  }
  return errors;
}

SolveSummary RefineAbsolutePose(const std::vector<CameraPoints>& cameras,
                                double loss_scale, Rigid3* unit_from_world) {
  return Refine(cameras, loss_scale, kConverged, unit_from_world);
}

PoseMatrix AbsolutePoseCovariance(const std::vector<CameraPoints>& cameras,
                                  double loss_scale,
                                  const Rigid3& unit_from_world) {
  PoseMatrix hessian = Linearize(cameras, loss_scale, unit_from_world).hessian;
  hessian.diagonal().array() +=
      std::numeric_limits<double>::epsilon() * hessian.diagonal().maxCoeff();
  return loss_scale * loss_scale * hessian.ldlt().solve(PoseMatrix::Identity());
}

SolveSummary ImproveAbsolutePose(const std::vector<CameraPoints>& cameras,
                                 double loss_scale, Rigid3* unit_from_world) {
  return Refine(cameras, loss_scale, kLocal, unit_from_world);
}

std::optional<Rigid3> EstimateAbsolutePose(
    const std::vector<CameraPoints>& cameras, const RansacOptions& options,
    Random* random) {
  return AbsolutePoseRansac(cameras, random).Run(options);
}

}  // namespace mgsfm
