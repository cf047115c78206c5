// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "frontend/imaging/test_cameras.h"
#include "imaging/image_run.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

cv::Mat Paint(const Camera& camera) {
  cv::Mat image(camera.height_px, camera.width_px, CV_8U, cv::Scalar(0));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto ray =
          RayFromPixel(camera.model, camera.params.data(), {x + 0.5, y + 0.5});
      if (ray)
        image.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(Brightness(*ray));
    }
  }
  return image;
}

// The displacement that explains the difference from the painted directions
// best (Lucas and Kanade), and the mean difference.
struct Agreement {
  Vector2d shift_px;
  double mean_difference;
};

Agreement CompareWithDirections(const cv::Mat& rendered, const cv::Mat& mask,
                                const View& view) {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Vector2d right_side = Vector2d::Zero();
  double sum = 0.0;
  int num_pixels = 0;
  const auto expected = [&](double u, double v) {
    return Brightness(view.view_from_cam.conjugate() *
                      PinholeRay(view.camera, u, v));
  };
  for (int y = 0; y < rendered.rows; ++y) {
    for (int x = 0; x < rendered.cols; ++x) {
      if (mask.at<uint8_t>(y, x) == 0) continue;
      const double u = x + 0.5, v = y + 0.5;
      const Vector2d gradient(expected(u + 0.5, v) - expected(u - 0.5, v),
                              expected(u, v + 0.5) - expected(u, v - 0.5));
      const double difference = rendered.at<uint8_t>(y, x) - expected(u, v);
      normal += gradient * gradient.transpose();
      right_side += gradient * difference;
      sum += std::abs(difference);
      ++num_pixels;
    }
  }
  EXPECT_GT(num_pixels, rendered.rows * rendered.cols / 8);
  return {normal.ldlt().solve(right_side), sum / num_pixels};
}

void ExpectViewsShowDirections(const Camera& camera,
                               const ViewOptions& options) {
  const std::vector<View> views = PlanViews(camera, options);
  const ViewRenderer renderer(camera, views);
  const std::vector<cv::Mat> images = renderer.Render(Paint(camera));
  const std::vector<cv::Mat> masks = renderer.RenderMasks({});
  ASSERT_EQ(images.size(), views.size());
  for (size_t i = 0; i < views.size(); ++i) {
    const Agreement agreement =
        CompareWithDirections(images[i], masks[i], views[i]);
    EXPECT_LT(agreement.shift_px.norm(), 0.02) << views[i].name;
    EXPECT_LT(agreement.mean_difference, 2.0) << views[i].name;
  }
}

TEST(ViewRenderer, ViewsShowTheDirectionsOfTheirPixels) {
  ViewOptions options;
  ExpectViewsShowDirections(Barrel(), options);
  ExpectViewsShowDirections(Panorama(), options);
  ExpectViewsShowDirections(Fisheye180(), options);
  options.projection = ViewProjection::kPinhole;
  options.field_of_view_deg = 100.0;
  ExpectViewsShowDirections(Fisheye180(), options);
}

TEST(ViewRenderer, ReducedViewsShowTheSameDirections) {
  ViewOptions options;
  options.max_image_size = 140;
  ExpectViewsShowDirections(Panorama(), options);
  ExpectViewsShowDirections(Fisheye180(), options);
}

// A pattern that is too fine for the reduced view becomes gray, not coarse.
TEST(ViewRenderer, ReductionAverages) {
  const Camera camera =
      MakeCamera(CameraModelId::kPinhole, 400, 400, {300, 300, 200, 200});
  cv::Mat stripes(400, 400, CV_8U);
  for (int x = 0; x < 400; ++x) {
    stripes.col(x).setTo(cv::Scalar(x % 3 == 0 ? 255 : 0));
  }
  ViewOptions options;
  options.max_image_size = 67;
  const cv::Mat reduced =
      ViewRenderer(camera, PlanViews(camera, options)).Render(stripes).at(0);
  ASSERT_EQ(reduced.cols, 67);
  cv::Scalar mean, deviation;
  cv::meanStdDev(reduced, mean, deviation);
  EXPECT_NEAR(mean[0], 85.0, 2.0);
  EXPECT_LT(deviation[0], 12.0);
}

TEST(ViewRenderer, MasksFollowTheImage) {
  const Camera camera = Fisheye180();
  ViewOptions options;
  options.max_view_angle_deg = 90.0;
  const std::vector<View> views = PlanViews(camera, options);
  const ViewRenderer renderer(camera, views);
  cv::Mat mask(400, 400, CV_8U, cv::Scalar(255));
  mask.rowRange(0, 200).setTo(cv::Scalar(0));
  const std::vector<cv::Mat> masks = renderer.RenderMasks(mask);
  for (size_t i = 0; i < views.size(); ++i) {
    for (int y = 0; y < masks[i].rows; ++y) {
      for (int x = 0; x < masks[i].cols; ++x) {
        const auto original =
            OriginalPixel(camera, views[i], {x + 0.5, y + 0.5});
        // Interpolation spans two pixels.
        if (original && std::abs(original->y() - 200.0) < 1.0) continue;
        const bool is_used = original && original->y() > 200.0;
        ASSERT_EQ(masks[i].at<uint8_t>(y, x), is_used ? 255 : 0);
      }
    }
  }
}

}  // namespace
}  // namespace mgsfm
