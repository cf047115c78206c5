// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/geometry/camera_models.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>

#include "base/random.h"
#include "foundation/geometry/test_cameras.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// The parameter names of the file format in their order.
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
    std::vector<int> focal, center, extra;
    std::istringstream names(row.params);
    int num_params = 0;
    for (std::string name; names >> name; ++num_params) {
      if (name[0] == 'f') focal.push_back(num_params);
      if (name[0] == 'c') center.push_back(num_params);
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
    EXPECT_EQ(info->principal_point_idxs, center);
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

class CameraModelTest : public testing::TestWithParam<TestCamera> {
 protected:
  // A ray in the domain of the camera.
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
                         testing::ValuesIn(AllTestCameras()),
                         [](const auto& info) { return info.param.label; });

TEST_P(CameraModelTest, PixelToRayToPixelOverTheWholeImage) {
  const TestCamera& camera = GetParam();
  constexpr int kSteps = 40;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      // Slightly inside, because the border of an equirectangular image is a
      // seam.
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
    // Includes angles for which series replace the closed forms.
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

// The image radius increases with the angle to the axis up to the boundary of
// the domain, and the domain is connected.
TEST_P(CameraModelTest, DoesNotFold) {
  const TestCamera& camera = GetParam();
  if (IsEquirectangular()) return;  // has no axis
  const CameraModelInfo& info = InfoOf(camera.model);
  const Vector2d focal(camera.params[info.focal_length_idxs.front()],
                       camera.params[info.focal_length_idxs.back()]);
  const Vector2d center(camera.params[info.principal_point_idxs[0]],
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
      const double outward = e.dot((*pixel - center).cwiseQuotient(focal));
      ASSERT_GT(outward, last) << "folds at " << deg;
      last = outward;
    }
  }
}

TEST_P(CameraModelTest, SeesNothingAtItsCenter) {
  EXPECT_FALSE(GetParam().Project(Vector3d::Zero()));
}

TEST_P(CameraModelTest, PixelsPerRadianAtTheCenter) {
  const TestCamera& camera = GetParam();
  // The unit of length of the FOV model is not the focal length.
  if (camera.label == "Fov") return;
  Eigen::Matrix<double, 2, 3> jacobian;
  ASSERT_TRUE(ProjectToPixel(camera.model, camera.params.data(),
                             Vector3d::UnitZ(), &jacobian));
  EXPECT_NEAR(PixelsPerRadian(camera.model, camera.params.data()),
              0.5 * (jacobian(0, 0) + jacobian(1, 1)), 0.01);
}

}  // namespace
}  // namespace mgsfm
