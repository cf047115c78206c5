// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

// A camera whose whole image is in its domain, up to `max_angle_deg` off the
// axis.
struct TestCamera {
  std::string label;
  CameraModelId model;
  std::vector<double> params;
  Eigen::Vector2d size;
  double max_angle_deg;

  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point) const {
    return ProjectToPixel(model, params.data(), point);
  }
  std::optional<Eigen::Vector3d> Ray(const Eigen::Vector2d& pixel) const {
    return RayFromPixel(model, params.data(), pixel);
  }
};

inline void PrintTo(const TestCamera& camera, std::ostream* os) {
  *os << camera.label;
}

// Calibrations of well-known real cameras where available (EuRoC, TUM VI,
// Project Aria), and strong distortions near the limit of injectivity.
inline std::vector<TestCamera> PerspectiveTestCameras() {
  using Id = CameraModelId;
  const Eigen::Vector2d vga(640, 480);
  const Eigen::Vector2d euroc(752, 480);
  return {
      {"SimplePinhole", Id::kSimplePinhole, {500, 321, 239}, vga, 40},
      {"Pinhole", Id::kPinhole, {510, 495, 318, 244}, vga, 80},
      {"SimpleRadial", Id::kSimpleRadial, {600, 320, 240, -0.15}, vga, 40},
      {"SimpleRadialStrong", Id::kSimpleRadial, {620, 320, 240, -0.3}, vga, 45},
      {"SimpleRadialPincushion",
       Id::kSimpleRadial,
       {500, 320, 240, 0.4},
       vga,
       80},
      {"Radial", Id::kRadial, {560, 320, 240, -0.25, 0.08}, vga, 45},
      {"RadialMixed", Id::kRadial, {560, 320, 240, 0.3, -0.05}, vga, 45},
      {"OpenCVEuroc",
       Id::kOpenCV,
       {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 0.00019359,
        1.76187114e-05},
       euroc,
       55},
      {"OpenCVStrong",
       Id::kOpenCV,
       {600, 590, 330, 230, -0.2, 0.05, 0.02, -0.03},
       vga,
       35},
      {"FullOpenCV",
       Id::kFullOpenCV,
       {480, 482, 322, 238, 0.9, 0.3, 0.0005, -0.0003, 0.01, 1.2, 0.5, 0.05},
       vga,
       60},
      {"FullOpenCVStrong",
       Id::kFullOpenCV,
       {560, 560, 322, 238, -0.3, 0.1, 0.01, -0.02, 0.01, 0.1, 0.05, -0.01},
       vga,
       35},
      {"Fov", Id::kFov, {400, 405, 320, 240, 0.93}, vga, 85},
      {"FovWeak", Id::kFov, {500, 505, 320, 240, 0.01}, vga, 60},
      {"FovNone", Id::kFov, {500, 505, 320, 240, 0.0}, vga, 60},
  };
}

inline std::vector<TestCamera> FisheyeTestCameras() {
  using Id = CameraModelId;
  const Eigen::Vector2d vga(640, 480);
  const Eigen::Vector2d square(512, 512);
  return {
      {"OpenCVFisheyeTumVi",
       Id::kOpenCVFisheye,
       {190.978477, 190.973307, 254.931706, 256.897442, 0.00348238940,
        0.000715034845, -0.00205323614, 0.000202936735},
       square,
       100},
      {"OpenCVFisheyeStrong",
       Id::kOpenCVFisheye,
       {300, 305, 320, 240, -0.06, 0.01, -0.002, 0.0001},
       vga,
       95},
      {"SimpleRadialFisheye",
       Id::kSimpleRadialFisheye,
       {300, 320, 240, -0.02},
       vga,
       120},
      {"RadialFisheye",
       Id::kRadialFisheye,
       {260, 320, 240, 0.05, -0.01},
       vga,
       110},
      {"ThinPrismFisheye",
       Id::kThinPrismFisheye,
       {350, 352, 320, 240, -0.03, 0.01, 0.0004, -0.0002, -0.003, 0.0002, 0.001,
        -0.0007},
       vga,
       95},
      {"ThinPrismFisheyeStrong",
       Id::kThinPrismFisheye,
       {380, 385, 320, 240, -0.05, 0.005, 0.012, -0.01, 0.001, -0.0002, 0.02,
        -0.01},
       vga,
       80},
      {"RadTanThinPrismAria",
       Id::kRadTanThinPrismFisheye,
       {241.6, 241.6, 318.1, 238.7, -0.0252, 0.0988, -0.0706, 0.0163, 0.00031,
        -0.00036, 0.0007, -0.0006, 0.0003, 0.00002, -0.0005, -0.00001},
       vga,
       95},
      {"RadTanThinPrismStrong",
       Id::kRadTanThinPrismFisheye,
       {330, 335, 318, 238, -0.06, 0.02, -0.006, 0.0012, -0.0001, 0.000005,
        0.01, -0.012, 0.01, -0.002, 0.008, 0.001},
       vga,
       85},
      {"SimpleFisheye", Id::kSimpleFisheye, {200, 320, 240}, vga, 175},
      {"Fisheye", Id::kFisheye, {220, 230, 310, 250}, vga, 175},
  };
}

inline std::vector<TestCamera> OtherTestCameras() {
  using Id = CameraModelId;
  const Eigen::Vector2d vga(640, 480);
  return {
      {"SimpleDivision", Id::kSimpleDivision, {400, 320, 240, -0.3}, vga, 150},
      {"SimpleDivisionPincushion",
       Id::kSimpleDivision,
       {500, 320, 240, 0.2},
       vga,
       40},
      {"DivisionNone", Id::kDivision, {500, 510, 320, 240, 0.0}, vga, 80},
      {"DivisionStrong", Id::kDivision, {300, 310, 320, 240, -1.2}, vga, 160},
      {"Eucm", Id::kEucm, {300, 305, 320, 240, 0.6, 1.1}, vga, 110},
      {"EucmWeak", Id::kEucm, {500, 505, 320, 240, 0.3, 0.8}, vga, 100},
      {"EucmPinhole", Id::kEucm, {500, 505, 320, 240, 0.0, 1.0}, vga, 80},
      {"Equirectangular",
       Id::kEquirectangular,
       {1024, 512},
       Eigen::Vector2d(1024, 512),
       179},
  };
}

inline std::vector<TestCamera> AllTestCameras() {
  std::vector<TestCamera> cameras = PerspectiveTestCameras();
  for (const auto& more : {FisheyeTestCameras(), OtherTestCameras()}) {
    cameras.insert(cameras.end(), more.begin(), more.end());
  }
  return cameras;
}

}  // namespace mgsfm
