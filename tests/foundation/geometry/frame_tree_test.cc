// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/frame_tree.h"

#include <gtest/gtest.h>

namespace mgsfm {
namespace {

Rigid3 Shift(double x) { return {Eigen::Quaterniond::Identity(), {x, 0, 0}}; }

TEST(FrameTreeTest, FramesAreConnectedByTheirTree) {
  FrameTree frames;
  frames.Add("base", "mount", Shift(1.0));
  frames.Add("mount", "left", Shift(0.5));
  frames.Add("base", "right", Shift(-2.0));
  const auto left_from_right = frames.Between("left", "right");
  ASSERT_TRUE(left_from_right.has_value());
  EXPECT_DOUBLE_EQ(left_from_right->translation.x(), -3.5);
  EXPECT_FALSE(frames.Between("left", "other").has_value());
  // A later transform replaces the earlier one.
  frames.Add("base", "right", Shift(4.0));
  EXPECT_DOUBLE_EQ(frames.Between("left", "right")->translation.x(), 2.5);
}

TEST(FrameTreeTest, CyclesEnd) {
  FrameTree frames;
  frames.Add("a", "b", Shift(1.0));
  frames.Add("b", "a", Shift(1.0));
  frames.Add("c", "c", Shift(1.0));
  EXPECT_FALSE(frames.Between("a", "other").has_value());
  (void)frames.Between("a", "b");
}

}  // namespace
}  // namespace mgsfm
