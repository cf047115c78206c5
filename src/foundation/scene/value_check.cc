// SPDX-License-Identifier: BSD-3-Clause
#include "scene/value_check.h"

#include <algorithm>
#include <cmath>

#include "base/text.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

bool IsUnit(const Eigen::Quaterniond& rotation) {
  return std::abs(rotation.norm() - 1.0) < kFourDigitTolerance;
}

}  // namespace

std::optional<std::string> WhyImplausible(
    const Eigen::Ref<const Eigen::VectorXd>& coordinates) {
  if (!coordinates.allFinite()) return "is not finite";
  // Beyond this limit, adjacent double-precision numbers differ by more than
  // 0.1.
  if (!(coordinates.lpNorm<Eigen::Infinity>() <= 1e15)) {
    return "has a coordinate beyond 1e15";
  }
  return std::nullopt;
}

std::optional<std::string> WhyImplausible(const Rigid3& pose) {
  if (!IsUnit(pose.rotation)) {
    return "has a quaternion of length " +
           FormatDouble(pose.rotation.norm(), std::chars_format::general, 4) +
           " in place of 1";
  }
  return WhyImplausible(pose.translation);
}

Rigid3 PoseOfFile(const Eigen::Quaterniond& rotation,
                  const Eigen::Vector3d& translation) {
  return {IsUnit(rotation) ? ToUnitQuaternion(rotation) : rotation,
          translation};
}

std::optional<std::string> WhyDifferent(const Rigid3& pose,
                                        const Rigid3& expected) {
  // Ten times the rounding error of three digits.
  constexpr double kTolerance = 5e-3;
  const double angle_rad = AngleBetween(pose.rotation, expected.rotation);
  const double distance = (pose.translation - expected.translation).norm();
  const double max_distance =
      kTolerance * std::max(1.0, pose.translation.norm());
  if (angle_rad <= kTolerance && distance <= max_distance) return std::nullopt;
  const auto text = [](double value) {
    return FormatDouble(value, std::chars_format::general, 3);
  };
  const auto vector = [&](const Eigen::Vector3d& v) {
    return text(v.x()) + " " + text(v.y()) + " " + text(v.z());
  };
  return "by " + text(RadToDeg(angle_rad)) + " deg and " + text(distance) +
         " (translation " + vector(pose.translation) + ", not " +
         vector(expected.translation) + ")";
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
  for (const int i : InfoOf(camera.model).focal_length_idxs) {
    if (!(params[i] > 0.0)) return "has a focal length that is not positive";
  }
  return std::nullopt;
}

std::optional<std::string> WhyRigsAreNotMetric(const Scene& scene) {
  constexpr double kMaxLength_m = 30.0;
  for (const Rig& rig : scene.rigs) {
    double length = 0.0;
    for (const int i : rig.sensor_idxs) {
      const auto& pose = scene.sensors[i].sensor_from_rig;
      if (pose) length = std::max(length, pose->Center().norm());
    }
    if (length <= kMaxLength_m) continue;
    return "a camera of the rig of '" + scene.sensors[rig.ref_sensor_idx].name +
           "' is " + FormatDouble(length, std::chars_format::general, 4) +
           " from the reference, which counts as meters; divide the "
           "translations by 1000 if they are in millimeters";
  }
  return std::nullopt;
}

}  // namespace mgsfm
