// SPDX-License-Identifier: BSD-3-Clause
#include "scene/value_check.h"

#include <cmath>

#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Beyond it, neighbouring numbers in double precision are more than 0.1 apart.
constexpr double kMaxCoordinate = 1e15;
// Tolerance of the norm of a quaternion that was normalised before it was
// rounded.
constexpr double kUnitTolerance = 1e-3;

}  // namespace

std::optional<std::string> WhyImplausible(
    const Eigen::Ref<const Eigen::VectorXd>& coordinates) {
  if (!coordinates.allFinite()) return "is not finite";
  if (!(coordinates.lpNorm<Eigen::Infinity>() <= kMaxCoordinate)) {
    return "has a coordinate beyond 1e15";
  }
  return std::nullopt;
}

std::optional<std::string> WhyImplausible(const Rigid3& pose) {
  if (!(std::abs(pose.rotation.norm() - 1.0) < kUnitTolerance)) {
    return "has no unit quaternion";
  }
  return WhyImplausible(pose.translation);
}

std::optional<std::string> WhyImplausible(const Camera& camera) {
  if (camera.width_px <= 0 || camera.height_px <= 0) {
    return "has the image size " + std::to_string(camera.width_px) + " x " +
           std::to_string(camera.height_px);
  }
  const Eigen::Map<const Eigen::VectorXd> params(
      camera.params.data(), static_cast<Eigen::Index>(camera.params.size()));
  if (WhyImplausible(params))
    return "has a parameter that is not finite or beyond 1e15";
  const CameraModelInfo* model =
      FindCameraModel(static_cast<int32_t>(camera.model));
  for (const int i : model->focal_length_idxs) {
    if (!(params[i] > 0.0)) return "has a focal length that is not positive";
  }
  return std::nullopt;
}

}  // namespace mgsfm
