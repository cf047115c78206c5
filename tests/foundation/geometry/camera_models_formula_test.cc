// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"

// Independent implementations of the formulas of the models.
namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

TEST(CameraModelFormula, FullOpenCV) {
  const std::vector<double> p = {480,  490,    322,  238, 0.9, 0.3,
                                 0.05, -0.003, 0.01, 1.2, 0.5, 0.05};
  const Vector3d point(0.7, -0.4, 1.3);
  const double x = point.x() / point.z(), y = point.y() / point.z();
  const double r2 = x * x + y * y;
  const double radial =
      (1 + p[4] * r2 + p[5] * r2 * r2 + p[8] * r2 * r2 * r2) /
      (1 + p[9] * r2 + p[10] * r2 * r2 + p[11] * r2 * r2 * r2);
  const double p1 = p[6], p2 = p[7];
  const Vector2d expected(
      p[0] * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + p[2],
      p[1] * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + p[3]);
  const auto pixel =
      ProjectToPixel(CameraModelId::kFullOpenCV, p.data(), point);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - expected).norm(), 1e-10);
}

TEST(CameraModelFormula, OpenCV) {
  const std::vector<double> p = {458, 457, 367, 248, -0.28, 0.07, 0.02, -0.03};
  const Vector3d point(-0.3, 0.2, 1.1);
  const double x = point.x() / point.z(), y = point.y() / point.z();
  const double r2 = x * x + y * y;
  const double radial = 1 + p[4] * r2 + p[5] * r2 * r2;
  const Vector2d expected(
      p[0] * (x * radial + 2 * p[6] * x * y + p[7] * (r2 + 2 * x * x)) + p[2],
      p[1] * (y * radial + p[6] * (r2 + 2 * y * y) + 2 * p[7] * x * y) + p[3]);
  const auto pixel = ProjectToPixel(CameraModelId::kOpenCV, p.data(), point);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - expected).norm(), 1e-10);
}

TEST(CameraModelFormula, Fov) {
  const Vector3d point(0.9, -0.5, 1.2);
  const double x = point.x() / point.z(), y = point.y() / point.z();
  const double r = std::hypot(x, y);
  for (const double omega : {0.011, 0.049, 0.051, 0.3, 0.93, 1.5, -0.93}) {
    const std::vector<double> p = {400, 405, 320, 240, omega};
    const double scale = std::atan(2 * r * std::tan(omega / 2)) / (omega * r);
    const Vector2d expected(p[0] * x * scale + p[2], p[1] * y * scale + p[3]);
    const auto pixel = ProjectToPixel(CameraModelId::kFov, p.data(), point);
    ASSERT_TRUE(pixel);
    EXPECT_LT((*pixel - expected).norm(), 1e-9) << omega;
  }
}

// The equidistant projection: azimuth and angle in polar coordinates.
Vector2d Equidistant(const Vector3d& point) {
  const double angle = AngleBetween(point, Vector3d::UnitZ().eval());
  const double azimuth = std::atan2(point.y(), point.x());
  return {angle * std::cos(azimuth), angle * std::sin(azimuth)};
}

TEST(CameraModelFormula, ThinPrismFisheye) {
  const std::vector<double> p = {350,  352,   320,    240,    -0.03, 0.01,
                                 0.01, -0.02, -0.003, 0.0002, 0.03,  -0.02};
  for (const double z : {0.8, -0.1}) {
    const Vector3d point(0.5, -0.6, z);
    const Vector2d m = Equidistant(point);
    const double x = m.x(), y = m.y(), r2 = m.squaredNorm();
    const double radial = p[4] * r2 + p[5] * std::pow(r2, 2) +
                          p[8] * std::pow(r2, 3) + p[9] * std::pow(r2, 4);
    const double dx =
        x * radial + 2 * p[6] * x * y + p[7] * (r2 + 2 * x * x) + p[10] * r2;
    const double dy =
        y * radial + 2 * p[7] * x * y + p[6] * (r2 + 2 * y * y) + p[11] * r2;
    const Vector2d expected(p[0] * (x + dx) + p[2], p[1] * (y + dy) + p[3]);
    const auto pixel =
        ProjectToPixel(CameraModelId::kThinPrismFisheye, p.data(), point);
    ASSERT_TRUE(pixel);
    EXPECT_LT((*pixel - expected).norm(), 1e-10);
  }
}

TEST(CameraModelFormula, RadTanThinPrismFisheye) {
  const std::vector<double> p = {330,    335,    318,   238,  -0.06, 0.02,
                                 -0.006, 0.0012, -1e-4, 5e-6, 0.01,  -0.012,
                                 0.01,   -0.002, 0.008, 0.001};
  const Vector3d point(0.5, -0.6, 0.4);
  const Vector2d m = Equidistant(point);
  double radial = 1.0;
  for (int i = 0; i < 6; ++i) {
    radial += p[4 + i] * std::pow(m.squaredNorm(), i + 1);
  }
  const double x = radial * m.x(), y = radial * m.y(), r2 = x * x + y * y;
  const double dx = 2 * p[11] * x * y + p[10] * (r2 + 2 * x * x) + p[12] * r2 +
                    p[13] * r2 * r2;
  const double dy = 2 * p[10] * x * y + p[11] * (r2 + 2 * y * y) + p[14] * r2 +
                    p[15] * r2 * r2;
  const Vector2d expected(p[0] * (x + dx) + p[2], p[1] * (y + dy) + p[3]);
  const auto pixel =
      ProjectToPixel(CameraModelId::kRadTanThinPrismFisheye, p.data(), point);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - expected).norm(), 1e-10);
}

TEST(CameraModelFormula, DivisionUndistortsByDividing) {
  const std::vector<double> p = {400, 410, 320, 240, -0.25};
  const Vector2d pixel(500, 100);
  const double x = (pixel.x() - p[2]) / p[0], y = (pixel.y() - p[3]) / p[1];
  const double d = 1 + p[4] * (x * x + y * y);
  const auto ray = RayFromPixel(CameraModelId::kDivision, p.data(), pixel);
  ASSERT_TRUE(ray);
  EXPECT_LT((ray->hnormalized() - Vector2d(x / d, y / d)).norm(), 1e-13);
}

TEST(CameraModelFormula, Eucm) {
  const std::vector<double> p = {300, 305, 320, 240, 0.6, 1.1};
  for (const double z : {1.0, -0.2}) {
    const Vector3d point(0.7, -0.4, z);
    const double d = std::sqrt(
        p[5] * (point.x() * point.x() + point.y() * point.y()) + z * z);
    const double h = p[4] * d + (1 - p[4]) * z;
    const Vector2d expected(p[0] * point.x() / h + p[2],
                            p[1] * point.y() / h + p[3]);
    const auto pixel = ProjectToPixel(CameraModelId::kEucm, p.data(), point);
    ASSERT_TRUE(pixel);
    EXPECT_LT((*pixel - expected).norm(), 1e-10);
  }
}

TEST(CameraModelFormula, EquirectangularLandmarks) {
  const std::vector<double> p = {1000, 500};
  const auto project = [&](double x, double y, double z) {
    return *ProjectToPixel(CameraModelId::kEquirectangular, p.data(),
                           {x, y, z});
  };
  EXPECT_LT((project(0, 0, 2) - Vector2d(500, 250)).norm(), 1e-12);
  EXPECT_LT((project(3, 0, 0) - Vector2d(750, 250)).norm(), 1e-12);
  EXPECT_LT((project(-1, 0, 0) - Vector2d(250, 250)).norm(), 1e-12);
  EXPECT_LT((project(0, 1, 1) - Vector2d(500, 375)).norm(), 1e-12);
  EXPECT_LT((project(1e-9, 0, -1) - Vector2d(1000, 250)).norm(), 1e-6);
}

// Two models that are equivalent for these parameters.
struct ModelPair {
  CameraModelId large;
  std::vector<double> large_params;
  CameraModelId small;
  std::vector<double> small_params;
};

std::vector<ModelPair> SpecialCases() {
  using Id = CameraModelId;
  return {
      {Id::kPinhole, {500, 500, 320, 240}, Id::kSimplePinhole, {500, 320, 240}},
      {Id::kSimpleRadial,
       {500, 320, 240, 0},
       Id::kSimplePinhole,
       {500, 320, 240}},
      {Id::kRadial,
       {500, 320, 240, -0.1, 0},
       Id::kSimpleRadial,
       {500, 320, 240, -0.1}},
      {Id::kOpenCV,
       {500, 500, 320, 240, -0.1, 0.02, 0, 0},
       Id::kRadial,
       {500, 320, 240, -0.1, 0.02}},
      {Id::kFullOpenCV,
       {500, 490, 320, 240, -0.1, 0.02, 0.01, 0.02, 0, 0, 0, 0},
       Id::kOpenCV,
       {500, 490, 320, 240, -0.1, 0.02, 0.01, 0.02}},
      {Id::kFov,
       {500, 500, 320, 240, 1e-9},
       Id::kPinhole,
       {500, 500, 320, 240}},
      {Id::kDivision,
       {500, 500, 320, 240, -0.1},
       Id::kSimpleDivision,
       {500, 320, 240, -0.1}},
      {Id::kDivision,
       {500, 490, 320, 240, 0},
       Id::kPinhole,
       {500, 490, 320, 240}},
      {Id::kEucm,
       {500, 490, 320, 240, 0, 1},
       Id::kPinhole,
       {500, 490, 320, 240}},
      {Id::kSimpleRadialFisheye,
       {500, 320, 240, 0},
       Id::kSimpleFisheye,
       {500, 320, 240}},
      {Id::kFisheye, {500, 500, 320, 240}, Id::kSimpleFisheye, {500, 320, 240}},
      {Id::kRadialFisheye,
       {500, 320, 240, 0.1, 0},
       Id::kSimpleRadialFisheye,
       {500, 320, 240, 0.1}},
      {Id::kOpenCVFisheye,
       {500, 500, 320, 240, 0.1, -0.01, 0, 0},
       Id::kRadialFisheye,
       {500, 320, 240, 0.1, -0.01}},
      {Id::kThinPrismFisheye,
       {500, 490, 320, 240, 0.1, -0.01, 0, 0, 0.003, -0.001, 0, 0},
       Id::kOpenCVFisheye,
       {500, 490, 320, 240, 0.1, -0.01, 0.003, -0.001}},
      {Id::kRadTanThinPrismFisheye,
       {500, 490, 320, 240, 0.1, -0.01, 0.003, -0.001, 0, 0, 0, 0, 0, 0, 0, 0},
       Id::kOpenCVFisheye,
       {500, 490, 320, 240, 0.1, -0.01, 0.003, -0.001}},
  };
}

// A model whose additional parameters are neutral equals the simpler model.
TEST(CameraModelFormula, SpecialCases) {
  Random random(4);
  for (const ModelPair& pair : SpecialCases()) {
    SCOPED_TRACE(InfoOf(pair.large).name);
    for (int i = 0; i < 50; ++i) {
      const Vector3d point(random.Uniform(-0.5, 0.5), random.Uniform(-0.5, 0.5),
                           1.0);
      const auto a =
          ProjectToPixel(pair.large, pair.large_params.data(), point);
      const auto b =
          ProjectToPixel(pair.small, pair.small_params.data(), point);
      ASSERT_TRUE(a && b);
      EXPECT_LT((*a - *b).norm(), 1e-10);
    }
  }
}

}  // namespace
}  // namespace mgsfm
