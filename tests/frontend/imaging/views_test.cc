// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/imaging/views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "frontend/imaging/test_cameras.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using testing::ElementsAre;

std::vector<std::string> NamesOf(const std::vector<View>& views) {
  std::vector<std::string> names;
  for (const View& view : views) names.push_back(view.name);
  return names;
}

Vector3d RayOf(const Camera& camera, const Vector2d& pixel) {
  return *RayFromPixel(camera.model, camera.params.data(), pixel);
}

// All pixel centers of the original up to an angle to its axis are in a view,
// at the place that the definition of a pinhole camera gives for their rays.
void ExpectNothingLost(const Camera& camera, const std::vector<View>& views,
                       double max_angle_deg) {
  for (int y = 0; y < camera.height_px; y += 3) {
    for (int x = 0; x < camera.width_px; x += 3) {
      const Vector2d pixel(x + 0.5, y + 0.5);
      const Vector3d ray = RayOf(camera, pixel);
      if (std::acos(ray.z()) > DegToRad(max_angle_deg)) continue;
      const auto found = FindInViews(camera, views, pixel);
      ASSERT_TRUE(found) << pixel.transpose();
      const View& view = views[found->view_idx];
      EXPECT_GE(found->pixel.minCoeff(), 0.0);
      EXPECT_LE(found->pixel.x(), view.camera.width_px);
      EXPECT_LE(found->pixel.y(), view.camera.height_px);
      const Vector3d ray_in_view = view.view_from_cam * ray;
      const Vector3d expected =
          PinholeRay(view.camera, found->pixel.x(), found->pixel.y());
      EXPECT_LT(AngleBetween(ray_in_view, expected), 1e-9);
      const auto back = OriginalPixel(camera, view, found->pixel);
      ASSERT_TRUE(back);
      EXPECT_LT((*back - pixel).norm(), 1e-6);
    }
  }
}

TEST(Views, FisheyeBecomesTheFacesThatItSees) {
  ViewOptions options;
  options.max_view_angle_deg = 90.0;
  const std::vector<View> views = PlanViews(Fisheye180(), options);
  EXPECT_THAT(NamesOf(views),
              ElementsAre("front", "right", "left", "up", "down"));
  ExpectNothingLost(Fisheye180(), views, 90.0);
  for (const View& view : views) {
    EXPECT_EQ(view.camera.width_px, 252);  // 2 x 126 px: resolution is kept
    EXPECT_EQ(view.camera.height_px, 252);
  }
  // Nothing behind the camera is shown.
  const View& right = views[1];
  EXPECT_TRUE(OriginalPixel(Fisheye180(), right, {125.0, 126.0}));
  EXPECT_FALSE(OriginalPixel(Fisheye180(), right, {130.0, 126.0}));
  EXPECT_FALSE(HasBlankPixels(Fisheye180(), views[0]));
  EXPECT_TRUE(HasBlankPixels(Fisheye180(), right));
}

TEST(Views, FacesPointToWhereTheirNamesSay) {
  const std::vector<View> views = PlanViews(Panorama(), {});
  ASSERT_THAT(NamesOf(views),
              ElementsAre("front", "right", "left", "up", "down", "back"));
  const Vector3d axes[] = {{0, 0, 1},  {1, 0, 0}, {-1, 0, 0},
                           {0, -1, 0}, {0, 1, 0}, {0, 0, -1}};
  for (size_t i = 0; i < views.size(); ++i) {
    const Vector3d axis =
        views[i].view_from_cam.conjugate() * Vector3d::UnitZ();
    EXPECT_LT((axis - axes[i]).norm(), 1e-12) << views[i].name;
    EXPECT_FALSE(HasBlankPixels(Panorama(), views[i]));
  }
  ExpectNothingLost(Panorama(), views, 180.0);
}

TEST(Views, OverlappingFacesShowPixelsOnce) {
  ViewOptions options;
  options.field_of_view_deg = 110.0;
  const std::vector<View> views = PlanViews(Panorama(), options);
  ExpectNothingLost(Panorama(), views, 180.0);
  // 30 degrees to the right, which only `front` has near its axis.
  const auto found = FindInViews(Panorama(), views, {400.0 + 800.0 / 12, 200});
  ASSERT_TRUE(found);
  EXPECT_EQ(views[found->view_idx].name, "front");
}

TEST(Views, OrdinaryLensIsCroppedOrKeptAsAWhole) {
  ViewOptions options;
  const std::vector<View> cropped = PlanViews(Barrel(), options);
  ASSERT_THAT(NamesOf(cropped), ElementsAre(""));
  EXPECT_FALSE(HasBlankPixels(Barrel(), cropped[0]));
  options.blank_pixels = 1.0;
  const std::vector<View> whole = PlanViews(Barrel(), options);
  ExpectNothingLost(Barrel(), whole, 90.0);
  EXPECT_TRUE(HasBlankPixels(Barrel(), whole[0]));
  EXPECT_GT(whole[0].camera.width_px, cropped[0].camera.width_px);
  EXPECT_EQ(cropped[0].camera.params[0], 420.0);
}

TEST(Views, PinholeImageOfAFisheyeHasTheChosenFieldOfView) {
  ViewOptions options;
  options.projection = ViewProjection::kPinhole;
  for (const double field_of_view_deg : {0.0, 100.0}) {
    options.field_of_view_deg = field_of_view_deg;
    const double half_deg =
        field_of_view_deg > 0.0 ? 0.5 * field_of_view_deg : 60.0;
    const std::vector<View> views = PlanViews(Fisheye180(), options);
    ASSERT_EQ(views.size(), 1u);
    const Camera& camera = views[0].camera;
    const double width = 2.0 * 125.0 * std::tan(DegToRad(half_deg));
    EXPECT_GE(camera.width_px, width);
    EXPECT_LT(camera.width_px, width + 1.0);
    ExpectNothingLost(Fisheye180(), views, half_deg - 0.1);
  }
}

TEST(Views, RectilinearWideAngleLensStaysOneImage) {
  const Camera camera =
      MakeCamera(CameraModelId::kPinhole, 1000, 800, {250, 250, 500, 400});
  const std::vector<View> views = PlanViews(camera, {});
  EXPECT_TRUE(IsUnchanged(camera, views));
}

TEST(Views, SizeIsLimitedAndPrincipalPointCentered) {
  ViewOptions options;
  options.max_image_size = 300;
  options.center_principal_point = true;
  const Camera view = PlanViews(Barrel(), options).at(0).camera;
  EXPECT_EQ(view.width_px, 300);
  EXPECT_DOUBLE_EQ(view.params[2], 0.5 * view.width_px);
  EXPECT_DOUBLE_EQ(view.params[3], 0.5 * view.height_px);
  EXPECT_FALSE(HasBlankPixels(Barrel(), PlanViews(Barrel(), options)[0]));
  // Pixels stay square.
  EXPECT_NEAR(view.params[0] / view.params[1], 1.0, 1.0 / view.height_px);
}

TEST(Views, AbsurdSizesAreErrors) {
  const Camera camera = MakeCamera(CameraModelId::kOpenCVFisheye, 400, 400,
                                   {1e9, 1e9, 200, 200, 0, 0, 0, 0});
  ViewOptions options;
  options.field_of_view_deg = 100.0;
  EXPECT_THROW(PlanViews(camera, options), Error);
  EXPECT_THROW(PlanViews(MakeCamera(CameraModelId::kSimplePinhole, 1 << 30, 10,
                                    {500, 500, 5}),
                         {}),
               Error);
}

}  // namespace
}  // namespace mgsfm
