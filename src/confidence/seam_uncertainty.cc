// SPDX-License-Identifier: BSD-3-Clause
#include "confidence/seam_uncertainty.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

Matrix3d CrossProductMatrix(const Vector3d& v) {
  Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

// Information of one observation on its point, for noise of one pixel.
Matrix3d InformationOf(const Vector3d& point_in_world, const Vector3d& center,
                       double pixels_per_radian) {
  const Vector3d offset = point_in_world - center;
  const Vector3d ray = offset.normalized();
  const double scale = pixels_per_radian / offset.norm();
  return scale * scale * (Matrix3d::Identity() - ray * ray.transpose());
}

// The two sides of a seam and the points between them.
class SeamPoints {
 public:
  SeamPoints(const Scene& scene, const Reconstruction& reconstruction,
             const std::vector<int>& frame_idxs_of_side)
      : scene_(scene),
        reconstruction_(reconstruction),
        frame_is_on_side_(scene.frames.size(), false) {
    for (const int i : frame_idxs_of_side) frame_is_on_side_[i] = true;
    for (const Camera& camera : reconstruction.cameras) {
      pixels_per_radian_.push_back(
          PixelsPerRadian(camera.model, camera.params.data()));
    }
  }

  bool IsOnSide(const Observation& observation) const {
    return frame_is_on_side_[scene_.images[observation.image_idx].frame_idx];
  }

  bool Crosses(const Point3D& point) const {
    bool has_side = false, has_other = false;
    for (const Observation& observation : point.track) {
      (IsOnSide(observation) ? has_side : has_other) = true;
    }
    return has_side && has_other;
  }

  // The parallel sum P of a point, for noise of one pixel.
  Matrix3d RelativeInformation(const Point3D& point) const {
    Matrix3d of_side = Matrix3d::Zero(), of_all = Matrix3d::Zero();
    for (const Observation& observation : point.track) {
      const Image& image = scene_.images[observation.image_idx];
      const auto pose =
          reconstruction_.CamFromWorld(scene_, observation.image_idx);
      if (!pose) continue;
      const Matrix3d information =
          InformationOf(point.point_in_world, pose->Center(),
                        pixels_per_radian_[image.camera_idx]);
      of_all += information;
      if (IsOnSide(observation)) of_side += information;
    }
    return of_side - of_side * of_all.ldlt().solve(of_side);
  }

 private:
  const Scene& scene_;
  const Reconstruction& reconstruction_;
  Mask frame_is_on_side_;
  std::vector<double> pixels_per_radian_;  // per camera
};

// The noise of each coordinate of a keypoint.
double NoiseOf(const Reconstruction& reconstruction) {
  std::vector<double> errors_px;
  for (const Point3D& point : reconstruction.points) {
    if (point.error_px) errors_px.push_back(*point.error_px);
  }
  return errors_px.empty() ? 1.0 : RobustSigma<2>(std::move(errors_px));
}

}  // namespace

std::optional<SeamUncertainty> EstimateSeamUncertainty(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<int>& frame_idxs_of_side, int frame_idx) {
  const SeamPoints points(scene, reconstruction, frame_idxs_of_side);
  const Vector3d center = reconstruction.rig_from_world[frame_idx]->Center();
  Matrix6d information = Matrix6d::Zero();
  for (const Point3D& point : reconstruction.points) {
    if (!points.Crosses(point)) continue;
    Matrix36d jacobian;
    jacobian << -CrossProductMatrix(point.point_in_world - center),
        Matrix3d::Identity();
    information +=
        jacobian.transpose() * points.RelativeInformation(point) * jacobian;
  }
  const Eigen::FullPivLU<Matrix6d> lu(information);
  if (!lu.isInvertible()) return std::nullopt;
  const double noise_px = NoiseOf(reconstruction);
  const Matrix6d covariance = noise_px * noise_px * lu.inverse();
  return SeamUncertainty{
      std::sqrt(covariance.bottomRightCorner<3, 3>().trace()),
      RadToDeg(std::sqrt(covariance.topLeftCorner<3, 3>().trace()))};
}

}  // namespace mgsfm
