// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/residuals.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>

#include "base/random.h"

namespace mgsfm {
namespace {

// The inlined pinhole camera against the function of the camera model.
TEST(PixelResidualTest, PinholeIsThatOfTheCameraModel) {
  const std::array<double, 4> params = {510.0, 495.0, 318.0, 244.0};
  ImagePose by_model;
  by_model.params = params.data();
  by_model.projection = FindPixelProjection(CameraModelId::kPinhole);
  by_model.num_params = 4;
  ImagePose inlined = by_model;
  inlined.is_pinhole = true;
  const float measured[] = {12.5f, 301.25f};
  Random random(1);
  int num_visible = 0;
  for (int i = 0; i < 100; ++i) {
    const double x[] = {random.Normal(), random.Normal(), random.Normal()};
    Eigen::Vector2d r, r_inlined, evaluated;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> P, P_inlined;
    const bool is_visible = PixelResidual::Linearize(
        by_model, x, measured, r.data(), P.data(), nullptr);
    EXPECT_EQ(PixelResidual::Linearize(inlined, x, measured, r_inlined.data(),
                                       P_inlined.data(), nullptr),
              is_visible);
    EXPECT_EQ(PixelResidual::Evaluate(inlined, x, measured, evaluated.data()),
              is_visible);
    if (!is_visible) continue;
    ++num_visible;
    EXPECT_LT((r_inlined - r).norm(), 1e-13 * (r.norm() + 1e3));
    EXPECT_LT((P_inlined - P).norm(), 1e-13 * P.norm());
    EXPECT_EQ(evaluated, r_inlined);
  }
  EXPECT_GT(num_visible, 30);
  EXPECT_LT(num_visible, 70);
}

}  // namespace
}  // namespace mgsfm
