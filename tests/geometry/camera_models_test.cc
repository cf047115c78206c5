// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/geometry/camera_models.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>

#include "mgsfm/base/error.h"
#include "mgsfm/base/random.h"
#include "mgsfm/geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// The table of the file format: names of the parameters in order.
struct ModelRow {
  int id;
  const char* name;
  const char* params;
};
constexpr ModelRow kTable[] = {
    {0, "SIMPLE_PINHOLE", "f cx cy"},
    {1, "PINHOLE", "fx fy cx cy"},
    {2, "SIMPLE_RADIAL", "f cx cy k"},
    {3, "RADIAL", "f cx cy k1 k2"},
    {4, "OPENCV", "fx fy cx cy k1 k2 p1 p2"},
    {5, "OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"},
    {6, "FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {7, "FOV", "fx fy cx cy omega"},
    {8, "SIMPLE_RADIAL_FISHEYE", "f cx cy k"},
    {9, "RADIAL_FISHEYE", "f cx cy k1 k2"},
    {10, "THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE",
     "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"},
    {12, "SIMPLE_DIVISION", "f cx cy k"},
    {13, "DIVISION", "fx fy cx cy k"},
    {14, "SIMPLE_FISHEYE", "f cx cy"},
    {15, "FISHEYE", "fx fy cx cy"},
    {16, "EUCM", "fx fy cx cy alpha beta"},
    {17, "EQUIRECTANGULAR", "w h"},
};

TEST(CameraModelTable, IsTheOneOfTheFileFormat) {
  ASSERT_EQ(AllCameraModels().size(), std::size(kTable));
  for (const ModelRow& row : kTable) {
    SCOPED_TRACE(row.name);
    std::vector<int> focal, centre, extra;
    std::istringstream names(row.params);
    int num_params = 0;
    for (std::string name; names >> name; ++num_params) {
      if (name[0] == 'f') focal.push_back(num_params);
      if (name[0] == 'c') centre.push_back(num_params);
      if (std::string("kposab").find(name[0]) != std::string::npos) {
        extra.push_back(num_params);
      }
    }
    const CameraModelInfo* info = FindCameraModel(row.id);
    ASSERT_NE(info, nullptr);
    EXPECT_EQ(info, FindCameraModel(std::string_view(row.name)));
    EXPECT_EQ(static_cast<int>(info->id), row.id);
    EXPECT_EQ(info->name, row.name);
    EXPECT_EQ(info->num_params, num_params);
    EXPECT_LE(info->num_params, kMaxNumCameraParams);
    EXPECT_EQ(info->focal_length_idxs, focal);
    EXPECT_EQ(info->principal_point_idxs, centre);
    EXPECT_EQ(info->extra_params_idxs, extra);
  }
}

TEST(CameraModelTable, UnknownModels) {
  EXPECT_EQ(FindCameraModel(-1), nullptr);
  EXPECT_EQ(FindCameraModel(18), nullptr);
  EXPECT_EQ(FindCameraModel("PINHOLE "), nullptr);
  EXPECT_THROW(PixelsPerRadian(static_cast<CameraModelId>(99), nullptr),
               ContractError);
}

// A camera all of whose image is seen, up to `max_angle_deg` from the axis.
struct TestCamera {
  std::string label;
  CameraModelId model;
  std::vector<double> params;
  Vector2d size;
  double max_angle_deg;

  std::optional<Vector2d> Project(const Vector3d& point) const {
    return ProjectToPixel(model, params.data(), point);
  }
  std::optional<Vector3d> Ray(const Vector2d& pixel) const {
    return RayFromPixel(model, params.data(), pixel);
  }
};

void PrintTo(const TestCamera& camera, std::ostream* os) {
  *os << camera.label;
}

// Calibrations of real lenses where the model has well-known ones (EuRoC,
// TUM VI, Project Aria), and strong ones near the end of what is injective.
std::vector<TestCamera> TestCameras() {
  using Id = CameraModelId;
  const Vector2d vga(640, 480), euroc(752, 480), square(512, 512);
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
      {"SimpleDivision", Id::kSimpleDivision, {400, 320, 240, -0.3}, vga, 150},
      {"SimpleDivisionPincushion",
       Id::kSimpleDivision,
       {500, 320, 240, 0.2},
       vga,
       40},
      {"DivisionNone", Id::kDivision, {500, 510, 320, 240, 0.0}, vga, 80},
      {"DivisionStrong", Id::kDivision, {300, 310, 320, 240, -1.2}, vga, 160},
      {"SimpleFisheye", Id::kSimpleFisheye, {200, 320, 240}, vga, 175},
      {"Fisheye", Id::kFisheye, {220, 230, 310, 250}, vga, 175},
      {"Eucm", Id::kEucm, {300, 305, 320, 240, 0.6, 1.1}, vga, 110},
      {"EucmWeak", Id::kEucm, {500, 505, 320, 240, 0.3, 0.8}, vga, 100},
      {"EucmPinhole", Id::kEucm, {500, 505, 320, 240, 0.0, 1.0}, vga, 80},
      {"Equirectangular",
       Id::kEquirectangular,
       {1024, 512},
       Vector2d(1024, 512),
       179},
  };
}

class CameraModelTest : public testing::TestWithParam<TestCamera> {
 protected:
  // A ray within the camera's range.
  Vector3d RandomRay(Random* random) const {
    const double angle =
        DegToRad(GetParam().max_angle_deg) * std::sqrt(random->Uniform());
    const double azimuth = random->Uniform(-kPi, kPi);
    return {std::sin(angle) * std::cos(azimuth),
            std::sin(angle) * std::sin(azimuth), std::cos(angle)};
  }
  bool IsEquirectangular() const {
    return GetParam().model == CameraModelId::kEquirectangular;
  }
};

INSTANTIATE_TEST_SUITE_P(AllModels, CameraModelTest,
                         testing::ValuesIn(TestCameras()),
                         [](const auto& info) { return info.param.label; });

TEST_P(CameraModelTest, PixelToRayToPixelOverTheWholeImage) {
  const TestCamera& camera = GetParam();
  constexpr int kSteps = 40;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      // Just inside, as the border of an equirectangular image is the seam.
      const Vector2d pixel((1e-3 + (1 - 2e-3) * i / kSteps) * camera.size.x(),
                           (1e-3 + (1 - 2e-3) * j / kSteps) * camera.size.y());
      const auto ray = camera.Ray(pixel);
      ASSERT_TRUE(ray) << pixel.transpose();
      EXPECT_NEAR(ray->norm(), 1.0, 1e-14);
      const auto again = camera.Project(*ray);
      ASSERT_TRUE(again) << pixel.transpose();
      EXPECT_LT((*again - pixel).norm(), 1e-9) << pixel.transpose();
    }
  }
}

TEST_P(CameraModelTest, RayToPixelToRay) {
  const TestCamera& camera = GetParam();
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Vector3d ray = RandomRay(&random);
    const auto pixel = camera.Project(ray);
    ASSERT_TRUE(pixel) << ray.transpose();
    const auto again = camera.Ray(*pixel);
    ASSERT_TRUE(again) << ray.transpose();
    EXPECT_LT(AngleBetween(*again, ray), 1e-9) << ray.transpose();
  }
}

TEST_P(CameraModelTest, JacobiansAreThoseOfFiniteDifferences) {
  const TestCamera& camera = GetParam();
  Random random(2);
  for (int i = 0; i < 200; ++i) {
    Vector3d point = random.Uniform(0.5, 5.0) * RandomRay(&random);
    // Also where series replace the closed forms.
    if (i % 10 == 0) point = Vector3d(1e-4, 2e-4, 1.0) * random.Uniform();
    Eigen::Matrix<double, 2, 3> of_point;
    PixelJacobianParams of_params;
    ASSERT_TRUE(ProjectToPixel(camera.model, camera.params.data(), point,
                               &of_point, &of_params));
    ASSERT_EQ(of_params.cols(), static_cast<int>(camera.params.size()));
    for (int k = 0; k < 3; ++k) {
      const double h = 1e-5 * point.norm();
      const Vector3d step = h * Vector3d::Unit(k);
      const auto plus = camera.Project(point + step);
      const auto minus = camera.Project(point - step);
      ASSERT_TRUE(plus && minus);
      const Vector2d expected = (*plus - *minus) / (2 * h);
      EXPECT_LT((of_point.col(k) - expected).norm(), 1e-6 * of_point.norm())
          << "point " << k;
    }
    for (size_t k = 0; k < camera.params.size(); ++k) {
      TestCamera plus = camera, minus = camera;
      const double h = 1e-5 * std::max(1.0, std::abs(camera.params[k]));
      plus.params[k] += h;
      minus.params[k] -= h;
      const auto pixel_plus = plus.Project(point);
      const auto pixel_minus = minus.Project(point);
      if (!pixel_plus || !pixel_minus) continue;
      const Vector2d expected = (*pixel_plus - *pixel_minus) / (2 * h);
      EXPECT_LT((of_params.col(k) - expected).norm(),
                1e-6 * std::max(1.0, expected.norm()))
          << "param " << k << " at " << point.transpose();
    }
  }
}

TEST_P(CameraModelTest, DependsOnTheRayOnly) {
  const TestCamera& camera = GetParam();
  Random random(3);
  for (int i = 0; i < 200; ++i) {
    const Vector3d ray = RandomRay(&random);
    Eigen::Matrix<double, 2, 3> jacobian;
    const auto pixel =
        ProjectToPixel(camera.model, camera.params.data(), ray, &jacobian);
    ASSERT_TRUE(pixel);
    EXPECT_LT((jacobian * ray).norm(), 1e-12 * jacobian.norm());
    for (const double scale : {1e-6, 0.37, 1e6}) {
      const auto scaled = camera.Project(scale * ray);
      ASSERT_TRUE(scaled);
      EXPECT_LT((*scaled - *pixel).norm(), 1e-9);
    }
  }
}

// Away from the axis the image moves outward, until it is no longer seen; then
// it does not come back.
TEST_P(CameraModelTest, DoesNotFold) {
  const TestCamera& camera = GetParam();
  if (IsEquirectangular()) return;  // has no axis
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int>(camera.model));
  const Vector2d focal(camera.params[info.focal_length_idxs.front()],
                       camera.params[info.focal_length_idxs.back()]);
  const Vector2d centre(camera.params[info.principal_point_idxs[0]],
                        camera.params[info.principal_point_idxs[1]]);
  for (int direction = 0; direction < 36; ++direction) {
    const double azimuth = DegToRad(10.0 * direction);
    const Vector2d e(std::cos(azimuth), std::sin(azimuth));
    double last = -1.0;
    bool seen = true;
    for (double deg = 0.0; deg < 180.0; deg += 0.25) {
      const double angle = DegToRad(deg);
      const auto pixel = camera.Project(
          {std::sin(angle) * e.x(), std::sin(angle) * e.y(), std::cos(angle)});
      if (!pixel) {
        EXPECT_GT(deg, camera.max_angle_deg);
        seen = false;
        continue;
      }
      ASSERT_TRUE(seen) << "came back at " << deg;
      const double outward = e.dot((*pixel - centre).cwiseQuotient(focal));
      ASSERT_GT(outward, last) << "folds at " << deg;
      last = outward;
    }
  }
}

TEST_P(CameraModelTest, SeesNothingAtItsCentre) {
  EXPECT_FALSE(GetParam().Project(Vector3d::Zero()));
}

TEST_P(CameraModelTest, PixelsPerRadianAtTheCentre) {
  const TestCamera& camera = GetParam();
  // The unit of length of FOV is not its focal length.
  if (camera.label == "Fov") return;
  Eigen::Matrix<double, 2, 3> jacobian;
  ASSERT_TRUE(ProjectToPixel(camera.model, camera.params.data(),
                             Vector3d::UnitZ(), &jacobian));
  EXPECT_NEAR(PixelsPerRadian(camera.model, camera.params.data()),
              0.5 * (jacobian(0, 0) + jacobian(1, 1)), 0.01);
}

// The formulas, written out again.

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

// The equidistant image of a point: its azimuth, and its angle as radius.
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

// A model with parameters at the value that does nothing is the smaller model.
TEST(CameraModelFormula, SpecialCases) {
  using Id = CameraModelId;
  struct Pair {
    Id large;
    std::vector<double> large_params;
    Id small;
    std::vector<double> small_params;
  };
  const std::vector<Pair> pairs = {
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
  Random random(4);
  for (const Pair& pair : pairs) {
    SCOPED_TRACE(FindCameraModel(static_cast<int>(pair.large))->name);
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

// Where models end.

bool Sees(CameraModelId model, const std::vector<double>& params,
          const Vector3d& point) {
  return ProjectToPixel(model, params.data(), point).has_value();
}

TEST(CameraModelDomain, PerspectiveModelsSeeTheFrontOnly) {
  using Id = CameraModelId;
  for (const TestCamera& camera : TestCameras()) {
    const int id = static_cast<int>(camera.model);
    if (id > static_cast<int>(Id::kFov) || camera.model == Id::kOpenCVFisheye) {
      continue;
    }
    EXPECT_FALSE(camera.Project({0.1, 0.2, 0.0})) << camera.label;
    EXPECT_FALSE(camera.Project({0.1, 0.2, -1.0})) << camera.label;
  }
}

TEST(CameraModelDomain, FisheyesSeeAllButTheBack) {
  const std::vector<double> params = {200, 320, 240};
  EXPECT_TRUE(Sees(CameraModelId::kSimpleFisheye, params, {1, 0, 0}));
  EXPECT_TRUE(Sees(CameraModelId::kSimpleFisheye, params, {1e-3, 0, -1}));
  EXPECT_FALSE(Sees(CameraModelId::kSimpleFisheye, params, {0, 0, -1}));
  // A circle of pixels is the back, and nothing is outside it.
  const double back = 200 * kPi;
  EXPECT_TRUE(RayFromPixel(CameraModelId::kSimpleFisheye, params.data(),
                           {320 + 0.999 * back, 240}));
  EXPECT_FALSE(RayFromPixel(CameraModelId::kSimpleFisheye, params.data(),
                            {320 + 1.001 * back, 240}));
}

TEST(CameraModelDomain, RadialDistortionEndsWhereItTurns) {
  // r (1 + k r^2) turns at r^2 = -1 / (3 k), at two thirds of that radius.
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
  // d(r scale)/dr = 1 - 1.8 s + 0.75 s^2 is negative for s in (0.87, 1.53)
  // only.
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
  // Decentring alone: x - 0.3 x^2 turns at x = 5 / 3.
  const std::vector<double> decentred = {500, 500, 320, 240, 0, 0, 0, -0.1};
  EXPECT_TRUE(Sees(CameraModelId::kOpenCV, decentred, {1.6, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kOpenCV, decentred, {1.7, 0, 1}));
  EXPECT_FALSE(Sees(CameraModelId::kOpenCV, decentred, {10, 0, 1}));
  EXPECT_FALSE(
      RayFromPixel(CameraModelId::kOpenCV, decentred.data(), {320 + 500, 240}));
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
  for (const TestCamera& camera : TestCameras()) {
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
