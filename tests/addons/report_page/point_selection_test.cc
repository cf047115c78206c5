// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"
#include "report_page/page_selection.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using testing::ElementsAreArray;
using testing::SizeIs;

// Points in the unit cube at x < 1 and, a tenth as many, at x > 9.
Reconstruction TwoClouds(size_t num_points) {
  Reconstruction model;
  Random random(1);
  for (size_t i = 0; i < num_points; ++i) {
    Point3D point;
    const double x = i % 11 == 0 ? 9.0 : 0.0;
    point.point_in_world = {x + random.Uniform(), random.Uniform(),
                            random.Uniform()};
    point.track.resize(2 + i % 5);
    point.error_px = random.Uniform();
    model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ShownBox, HoldsAllButOutliers) {
  Reconstruction model = TwoClouds(5000);
  model.points[3].point_in_world = {1e9, 0.0, 0.0};
  model.points[4].point_in_world = {0.0, -1e300, 0.0};
  model.rig_from_world = {
      Rigid3::FromRotationAndCenter(Eigen::Quaterniond::Identity(), {5, 5, 0}),
      std::nullopt};
  const Eigen::AlignedBox3d box = ShownBox(model);
  EXPECT_TRUE(box.contains(Vector3d(5.0, 5.0, 0.0)));
  EXPECT_LT(box.sizes().maxCoeff(), 40.0);
  for (size_t i = 5; i < model.points.size(); ++i) {
    ASSERT_TRUE(box.contains(model.points[i].point_in_world));
  }
  const auto all = SelectPoints(model, box, model.points.size());
  EXPECT_THAT(all, SizeIs(model.points.size() - 2));
}

TEST(ShownBox, IsFiniteWithoutPoints) {
  EXPECT_TRUE(ShownBox(Reconstruction()).min().allFinite());
}

TEST(SelectPoints, OrdersAllPointsOnceAndPrefixesAgree) {
  const Reconstruction model = TwoClouds(3000);
  const Eigen::AlignedBox3d box = ShownBox(model);
  std::vector<size_t> all = SelectPoints(model, box, 1'000'000);
  const std::vector<size_t> few = SelectPoints(model, box, 100);
  EXPECT_THAT(few, ElementsAreArray(all.begin(), all.begin() + 100));
  std::sort(all.begin(), all.end());
  for (size_t i = 0; i < all.size(); ++i) ASSERT_EQ(all[i], i);
  EXPECT_THAT(all, SizeIs(3000));
}

// More than a tenth of a cloud with a tenth of the points is selected, and more
// long tracks than short ones.
TEST(SelectPoints, PrefersSparsePlacesAndLongTracks) {
  const Reconstruction model = TwoClouds(300'000);
  const std::vector<size_t> selected =
      SelectPoints(model, ShownBox(model), 3000);
  size_t num_far = 0, num_long = 0, num_short = 0;
  for (const size_t i : selected) {
    num_far += model.points[i].point_in_world.x() > 5.0 ? 1 : 0;
    num_long += model.points[i].track.size() == 6 ? 1 : 0;
    num_short += model.points[i].track.size() == 2 ? 1 : 0;
  }
  EXPECT_GT(num_far, 3000 / 8);
  EXPECT_LT(num_far, 3000 / 2);
  EXPECT_GT(num_long, 2 * num_short);
}

}  // namespace
}  // namespace mgsfm
