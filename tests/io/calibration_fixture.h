// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "geometry/so3.h"
#include "io/calibration/calibration.h"
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

}  // namespace mgsfm
