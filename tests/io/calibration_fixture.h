// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "calibration/calibration.h"
#include "geometry/so3.h"
#include "io/test_database.h"
#include "support/temp_dir.h"

namespace mgsfm {

using Cameras = std::vector<CalibratedCamera>;
using Params = std::vector<double>;

// The output of `kalibr_calibrate_cameras` and `kalibr_calibrate_imu_camera`.
inline constexpr const char* kKalibr = R"(cam0:
  cam_overlaps: [1, 2]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /alphasense/left/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [400.0, 401.0, 370.0, 250.0]
  resolution: [752, 480]
  rostopic: /alphasense/right/image_raw
cam2:
  T_cn_cnm1:
  - [0.0, 0.0, -1.0, 0.5]
  - [0.0, 1.0, 0.0, 0.0]
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: eucm
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [0.6, 1.1, 300.0, 301.0, 375.0, 239.0]
  resolution: [752, 480]
  rostopic: /cam2/image_raw
)";

// KITTI-360's image_02.yaml.
inline constexpr const char* kMei = R"(%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 1400
image_height: 1400
mirror_parameters:
   xi: 2.2134047507854890e+00
distortion_parameters:
   k1: 1.6798235660113681e-02
   k2: 1.6548773243373522e+00
   p1: 4.2223943394772046e-04
   p2: 4.2462134260997584e-04
projection_parameters:
   gamma1: 1.3363220825849971e+03
   gamma2: 1.3357883350012958e+03
   u0: 7.1694323510126321e+02
   v0: 7.0576498308221585e+02
)";

class CalibrationTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(
        std::filesystem::path(Path(name)).parent_path());
    WriteTextFile(Path(name), text);
    return Path(name);
  }
  std::string ErrorOfFile(const std::string& name,
                          const std::string& text) const {
    const std::string path = Write(name, text);
    return ErrorOf([&] { (void)ReadCalibration(path); });
  }
  // The error of `text` with `before` replaced by `after`.
  std::string ErrorOfChange(const std::string& name, std::string text,
                            const std::string& before,
                            const std::string& after) const {
    const size_t begin = text.find(before);
    EXPECT_NE(begin, std::string::npos) << before;
    return ErrorOfFile(name, text.replace(begin, before.size(), after));
  }

  const TempDir dir_;
};

inline Rigid3 CamFromFirst(const Cameras& cameras, size_t k) {
  return cameras[k].cam_from_base.value() *
         cameras[0].cam_from_base.value().Inverse();
}

inline void ExpectPose(const Rigid3& pose, const Eigen::Matrix3d& rotation,
                       const Eigen::Vector3d& translation) {
  EXPECT_NEAR(AngleBetween(pose.rotation, Eigen::Quaterniond(rotation)), 0.0,
              1e-7);
  EXPECT_NEAR((pose.translation - translation).norm(), 0.0, 1e-9);
}

// The unified model (alpha = 0) and that of two spheres, by their definition: a
// unit ray is shifted along the axis once or twice, projected and distorted.
struct MirrorLens {
  Eigen::Vector2d focals_px;
  Eigen::Vector2d center_px;  // 0 at the center of the first pixel
  double xi;
  double alpha;
  Params distortion;  // k1 k2 p1 p2

  Eigen::Vector2d Project(const Eigen::Vector3d& ray) const {
    const Eigen::Vector3d first = ray + xi * Eigen::Vector3d::UnitZ();
    const double z = alpha * first.norm() + (1.0 - alpha) * first.z();
    const double x = ray.x() / z, y = ray.y() / z, r2 = x * x + y * y;
    const auto& d = distortion;
    const double radial = 1.0 + d[0] * r2 + d[1] * r2 * r2;
    return center_px +
           focals_px.cwiseProduct(Eigen::Vector2d(
               x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
               y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y));
  }
};

// The largest difference in pixels up to an angle to the optical axis.
inline double MaxDifference(const CalibratedCamera& camera,
                            const MirrorLens& lens, double max_angle_deg) {
  double difference_px = 0.0;
  for (double angle_deg = 0.7; angle_deg <= max_angle_deg; angle_deg += 1.3) {
    for (double azimuth_deg = 3.0; azimuth_deg < 360.0; azimuth_deg += 17.0) {
      const double angle = DegToRad(angle_deg), azimuth = DegToRad(azimuth_deg);
      const Eigen::Vector3d ray(std::sin(angle) * std::cos(azimuth),
                                std::sin(angle) * std::sin(azimuth),
                                std::cos(angle));
      const auto pixel =
          ProjectToPixel(camera.model.value(), camera.params.data(), ray);
      if (!pixel) return std::numeric_limits<double>::infinity();
      // COLMAP's pixels have their origin at the corner of the first one.
      difference_px = std::max(
          difference_px,
          (*pixel - lens.Project(ray) - Eigen::Vector2d(0.5, 0.5)).norm());
    }
  }
  return difference_px;
}

}  // namespace mgsfm
