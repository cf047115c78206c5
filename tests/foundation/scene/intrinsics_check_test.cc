// SPDX-License-Identifier: BSD-3-Clause
#include "scene/intrinsics_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

Camera MakeCamera(const char* model, std::vector<double> params) {
  return {CameraId(1), FindCameraModel(std::string_view(model))->id, 640, 480,
          std::move(params)};
}

TEST(IntrinsicsCheck, UsualLensesHaveNoProblem) {
  for (const Camera& camera : {
           MakeCamera("SIMPLE_PINHOLE", {500, 320, 240}),
           // A crop: one coordinate of the principal point is off.
           MakeCamera("PINHOLE", {500, 502, 322, 90}),
           // An anamorphic lens, and one of 90 deg in stretched images.
           MakeCamera("PINHOLE", {500, 1000, 320, 240}),
           MakeCamera("PINHOLE", {320, 260, 320, 240}),
           // The cameras of the EuRoC and KITTI data sets, scaled.
           MakeCamera("OPENCV", {390, 389, 313, 248, -0.28, 0.074, 2e-4, 2e-5}),
           MakeCamera("OPENCV", {500, 500, 320, 230, -0.37, 0.2, 1e-3, 0.0}),
           // 190 deg in the width of the image.
           MakeCamera("OPENCV_FISHEYE",
                      {193, 193, 320, 240, 0.0, 0.0, 0.0, 0.0}),
           MakeCamera("EQUIRECTANGULAR", {640, 480}),
       }) {
    const auto problem = FindIntrinsicsProblem(camera);
    EXPECT_FALSE(problem.has_value()) << problem->text;
  }
}

TEST(IntrinsicsCheck, ImpossibleOnesAreNamed) {
  const auto expect = [](const Camera& camera, const char* text) {
    const auto problem = FindIntrinsicsProblem(camera);
    ASSERT_TRUE(problem.has_value()) << text;
    EXPECT_TRUE(problem->is_certain);
    EXPECT_THAT(problem->text, HasSubstr(text));
  };
  expect(MakeCamera("SIMPLE_PINHOLE", {32000, 320, 240}), "50 times");
  expect(MakeCamera("PINHOLE", {500, 3e-3, 320, 240}), "focal length of 0.003");
  expect(MakeCamera("PINHOLE", {500, 500, -9000, 240}), "(-9000, 240) outside");
  expect(MakeCamera("PINHOLE", {500, 500, 320, 481}), "(320, 481) outside");
  expect(MakeCamera("PINHOLE", {500, 5000, 320, 240}), "500 and 5000 px");
  expect(MakeCamera("PINHOLE", {500, 500, 0.5, 0.5}), "not in fractions");
  expect(MakeCamera("OPENCV", {500, 500, 320, 240, -44.9, 100, 0, 0}),
         "cannot be inverted");
  // Its inverse exists, but the scale changes by more than 100 in the image.
  expect(MakeCamera("OPENCV", {370, 370, 320, 240, -44.9, 1017, 0, 0}),
         "magnifies");
  expect(MakeCamera("SIMPLE_RADIAL", {500, 320, 240, -3.0}),
         "cannot be inverted");
}

TEST(IntrinsicsCheck, OtherOrdersAreNamed) {
  const auto problem =
      FindIntrinsicsProblem(MakeCamera("PINHOLE", {390, 310, 385, 250}));
  ASSERT_TRUE(problem.has_value());
  EXPECT_TRUE(problem->is_misread);
  EXPECT_THAT(problem->text, HasSubstr("fx, cx, fy, cy"));
}

// The principal point tells the size of the images that were calibrated.
TEST(IntrinsicsCheck, IntrinsicsOfAnotherSizeAreNamed) {
  for (const double scale : {0.25, 0.5, 2.0 / 3.0, 1.5, 1.9}) {
    const auto problem = FindIntrinsicsProblem(MakeCamera(
        "PINHOLE", {500 * scale, 500 * scale, 325 * scale, 236 * scale}));
    ASSERT_TRUE(problem.has_value()) << scale;
    EXPECT_TRUE(problem->is_misread);
    EXPECT_FALSE(problem->is_certain);
  }
  const auto problem =
      FindIntrinsicsProblem(MakeCamera("SIMPLE_PINHOLE", {250, 160, 120}));
  ASSERT_TRUE(problem.has_value());
  EXPECT_THAT(problem->text, HasSubstr("320 x 240"));
}

// r (1 - 0.5 r^2) has its maximum 0.54 at r = 0.82, so that no ray has pixels
// beyond 0.54 f = 327 px from the center; corners are at 400 px.
TEST(IntrinsicsCheck, CornersWithoutRayAreADoubt) {
  const auto problem =
      FindIntrinsicsProblem(MakeCamera("SIMPLE_RADIAL", {600, 320, 240, -0.5}));
  ASSERT_TRUE(problem.has_value());
  EXPECT_FALSE(problem->is_certain);
  EXPECT_FALSE(problem->is_misread);
  EXPECT_THAT(problem->text, HasSubstr("cannot be inverted"));
}

}  // namespace
}  // namespace mgsfm
