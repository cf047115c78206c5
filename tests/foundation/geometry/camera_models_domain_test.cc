// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "foundation/geometry/test_cameras.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"

// The boundaries of the domains of the models.
namespace mgsfm {
namespace {

using Eigen::Vector3d;

bool Sees(CameraModelId model, const std::vector<double>& params,
          const Vector3d& point) {
  return ProjectToPixel(model, params.data(), point).has_value();
}

TEST(CameraModelDomain, PerspectiveModelsSeeTheFrontOnly) {
  for (const TestCamera& camera : PerspectiveTestCameras()) {
    EXPECT_FALSE(camera.Project({0.1, 0.2, 0.0})) << camera.label;
    EXPECT_FALSE(camera.Project({0.1, 0.2, -1.0})) << camera.label;
  }
}

TEST(CameraModelDomain, FisheyesSeeAllButTheBack) {
  const std::vector<double> params = {200, 320, 240};
  EXPECT_TRUE(Sees(CameraModelId::kSimpleFisheye, params, {1, 0, 0}));
  EXPECT_TRUE(Sees(CameraModelId::kSimpleFisheye, params, {1e-3, 0, -1}));
  EXPECT_FALSE(Sees(CameraModelId::kSimpleFisheye, params, {0, 0, -1}));
  // The backward direction maps to a circle of pixels; pixels beyond have no
  // ray.
  const double back = 200 * kPi;
  EXPECT_TRUE(RayFromPixel(CameraModelId::kSimpleFisheye, params.data(),
                           {320 + 0.999 * back, 240}));
  EXPECT_FALSE(RayFromPixel(CameraModelId::kSimpleFisheye, params.data(),
                            {320 + 1.001 * back, 240}));
}

TEST(CameraModelDomain, RadialDistortionEndsWhereItTurns) {
  // r (1 + k r^2) has its maximum, two thirds of r, at r^2 = -1 / (3 k).
  const std::vector<double> params = {500, 320, 240, -0.3};
  const double r = std::sqrt(1.0 / 0.9);
  const CameraModelId model = CameraModelId::kSimpleRadial;
  EXPECT_TRUE(Sees(model, params, {0.0, 0.999 * r, 1.0}));
  EXPECT_FALSE(Sees(model, params, {0.0, 1.001 * r, 1.0}));
  EXPECT_FALSE(Sees(model, params, {1.0 / std::sqrt(0.3), 0.0, 1.0}));
  EXPECT_FALSE(Sees(model, params, {1e6, 0.0, 1.0}));
  const double edge = 500 * r * 2 / 3;
  EXPECT_TRUE(RayFromPixel(model, params.data(), {320 - 0.999 * edge, 240}));
  EXPECT_FALSE(RayFromPixel(model, params.data(), {320 - 1.001 * edge, 240}));
}

TEST(CameraModelDomain, PointsBeyondAFoldAreNotSeenAgain) {
  // d(r scale)/dr = 1 - 1.8 s + 0.75 s^2 is negative only for s in
  // (0.87, 1.53).
  const std::vector<double> params = {500, 320, 240, -0.6, 0.15};
  EXPECT_TRUE(Sees(CameraModelId::kRadial, params, {std::sqrt(0.85), 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kRadial, params, {std::sqrt(1.2), 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kRadial, params, {2, 0, 1}));
  // A rational model beyond its pole.
  const std::vector<double> pole = {500, 500, 320, 240,  0, 0,
                                    0,   0,   0,   -0.5, 0, 0};
  EXPECT_TRUE(Sees(CameraModelId::kFullOpenCV, pole, {1.4, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kFullOpenCV, pole, {1.5, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kFullOpenCV, pole, {10, 0, 1}));
  // Decentering only: x - 0.3 x^2 has its maximum at x = 5 / 3.
  const std::vector<double> decentered = {500, 500, 320, 240, 0, 0, 0, -0.1};
  EXPECT_TRUE(Sees(CameraModelId::kOpenCV, decentered, {1.6, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kOpenCV, decentered, {1.7, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kOpenCV, decentered, {10, 0, 1}));
  EXPECT_FALSE(RayFromPixel(CameraModelId::kOpenCV, decentered.data(),
                            {320 + 500, 240}));
}

TEST(CameraModelDomain, DivisionAndEucm) {
  // k > 0: tan = r / (1 + k r^2) has its largest value 1 / (2 sqrt(k)).
  const std::vector<double> division = {500, 320, 240, 0.25};
  const CameraModelId simple = CameraModelId::kSimpleDivision;
  EXPECT_TRUE(Sees(simple, division, {0.999, 0, 1}));
  EXPECT_FALSE(Sees(simple, division, {1.001, 0, 1}));
  EXPECT_FALSE(Sees(simple, division, {0.1, 0, -1}));
  EXPECT_TRUE(RayFromPixel(simple, division.data(), {320 + 999, 240}));
  EXPECT_FALSE(RayFromPixel(simple, division.data(), {320 + 1001, 240}));
  EXPECT_FALSE(Sees(simple, {500, 320, 240, -0.25}, {0, 0, -1}));
  EXPECT_TRUE(Sees(simple, {500, 320, 240, -0.25}, {0.1, 0, -1}));

  // beta = 1, alpha > 1/2: cos of the angle > -(1 - alpha) / alpha.
  const CameraModelId eucm = CameraModelId::kEucm;
  const std::vector<double> params = {300, 300, 320, 240, 0.8, 1.0};
  const double last = std::acos(-0.25);
  EXPECT_TRUE(
      Sees(eucm, params, {std::sin(last - 1e-3), 0, std::cos(last - 1e-3)}));
  EXPECT_FALSE(
      Sees(eucm, params, {std::sin(last + 1e-3), 0, std::cos(last + 1e-3)}));
  EXPECT_FALSE(RayFromPixel(eucm, params.data(), {320 + 400, 240}));
  // alpha = 0 is a pinhole.
  EXPECT_FALSE(Sees(eucm, {300, 300, 320, 240, 0, 1}, {0.1, 0, -1e-3}));
}

TEST(CameraModelDomain, PixelsThatNothingReaches) {
  const std::vector<double> fov = {400, 400, 320, 240, 1.0};
  const double edge = 400 * kPi / 2;
  EXPECT_TRUE(
      RayFromPixel(CameraModelId::kFov, fov.data(), {320 + 0.99 * edge, 240}));
  EXPECT_FALSE(
      RayFromPixel(CameraModelId::kFov, fov.data(), {320 + 1.01 * edge, 240}));
  const std::vector<double> pano = {1000, 500};
  const CameraModelId equirectangular = CameraModelId::kEquirectangular;
  EXPECT_FALSE(RayFromPixel(equirectangular, pano.data(), {-1, 100}));
  EXPECT_FALSE(RayFromPixel(equirectangular, pano.data(), {100, 501}));
  EXPECT_FALSE(Sees(equirectangular, pano, {0, 1, 0}));
}

TEST(CameraModelDomain, NumbersThatAreNone) {
  const double nan = std::nan("");
  const double inf = std::numeric_limits<double>::infinity();
  for (const TestCamera& camera : AllTestCameras()) {
    SCOPED_TRACE(camera.label);
    EXPECT_FALSE(camera.Project({nan, 0, 1}));
    EXPECT_FALSE(camera.Project({0.1, 0, nan}));
    EXPECT_FALSE(camera.Ray({nan, 10}));
    EXPECT_FALSE(camera.Ray({inf, 10}));
    TestCamera broken = camera;
    broken.params[0] = 0.0;
    EXPECT_FALSE(broken.Ray({10, 10}));
  }
}

}  // namespace
}  // namespace mgsfm
