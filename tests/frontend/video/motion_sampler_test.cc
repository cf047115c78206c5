// SPDX-License-Identifier: BSD-3-Clause
#include "video/motion_sampler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <set>

namespace mgsfm {
namespace {

constexpr double kMinMotion = 0.04;
constexpr int kWidthPx = 320;

// Smooth random texture, wider than an image.
cv::Mat Wall() {
  cv::Mat wall(180, 2000, CV_8U);
  cv::theRNG().state = 7;
  cv::randu(wall, 0, 256);
  cv::GaussianBlur(wall, wall, cv::Size(), 2.0);
  cv::normalize(wall, wall, 0, 255, cv::NORM_MINMAX);
  return wall;
}

cv::Mat ViewAt(const cv::Mat& wall, double x_px) {
  cv::Mat view;
  const cv::Matx23d shift(1.0, 0.0, -x_px, 0.0, 1.0, 0.0);
  cv::warpAffine(wall, view, shift, cv::Size(kWidthPx, wall.rows));
  return view;
}

std::vector<int> Sample(const std::vector<cv::Mat>& views) {
  MotionSampler sampler(kMinMotion);
  for (size_t i = 0; i < views.size(); ++i) {
    sampler.Add(static_cast<int>(i), views[i]);
  }
  return sampler.Finish();
}

// Neighbors are min_motion to 1.5 min_motion apart, up to rounding to pixels.
TEST(MotionSamplerTest, NeighborsHaveTheRequestedMotion) {
  const cv::Mat wall = Wall();
  std::vector<cv::Mat> views;
  for (int i = 0; i < 80; ++i) views.push_back(ViewAt(wall, 3.0 * i));
  const std::vector<int> selected = Sample(views);
  ASSERT_GT(selected.size(), 10u);
  for (size_t k = 1; k < selected.size(); ++k) {
    const double motion = 3.0 * (selected[k] - selected[k - 1]) / kWidthPx;
    EXPECT_GE(motion, kMinMotion - 0.002) << k;
    EXPECT_LE(motion, 1.5 * kMinMotion + 0.002) << k;
  }
}

TEST(MotionSamplerTest, StandingStillAddsNothing) {
  const cv::Mat wall = Wall();
  std::vector<cv::Mat> views;
  std::set<int> standing;
  double x_px = 0.0;
  for (int i = 0; i < 60; ++i) {
    const bool stands = i >= 20 && i < 45;
    if (stands) standing.insert(i);
    if (!stands) x_px += 4.0;
    views.push_back(ViewAt(wall, x_px));
    // Something passes before a third of the image.
    if (stands) {
      wall(cv::Rect(1000 + 20 * (i - 20), 60, 100, 100))
          .copyTo(views.back()(cv::Rect(0, 60, 100, 100)));
    }
  }
  int num_standing = 0;
  for (const int idx : Sample(views)) num_standing += standing.count(idx) > 0;
  EXPECT_LE(num_standing, 1);  // where the camera stops
}

TEST(MotionSamplerTest, BlurredImagesAreAvoided) {
  const cv::Mat wall = Wall();
  std::vector<cv::Mat> views;
  // Three of four images are blurred; the window of motions has six.
  for (int i = 0; i <= 80; ++i) {
    cv::Mat view = ViewAt(wall, 1.0 * i);
    if (i % 4 != 0) cv::blur(view, view, cv::Size(7, 1));
    views.push_back(view);
  }
  const std::vector<int> selected = Sample(views);
  ASSERT_GT(selected.size(), 4u);
  for (const int idx : selected) EXPECT_EQ(idx % 4, 0) << idx;
}

// A jump leaves nothing in common; darkness has nothing to follow.
TEST(MotionSamplerTest, JumpsAndDarkness) {
  const cv::Mat wall = Wall();
  const cv::Mat dark(wall.rows, kWidthPx, CV_8U, cv::Scalar(0));
  EXPECT_THAT(Sample({ViewAt(wall, 0), ViewAt(wall, 900), ViewAt(wall, 1400)}),
              testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(Sample({dark, dark, dark, ViewAt(wall, 0), ViewAt(wall, 0)}),
              testing::ElementsAre(0, 3));
}

}  // namespace
}  // namespace mgsfm
