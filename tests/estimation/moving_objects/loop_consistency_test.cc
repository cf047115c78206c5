// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/loop_consistency.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace mgsfm {
namespace {

constexpr int kPathLength = 100;
constexpr double kDriftShare = 0.2;

// A drive in steps of unit length with a few pairs.
class PathWithPairs {
 public:
  explicit PathWithPairs(std::vector<std::pair<int, int>> frames) {
    scene_.rigs.push_back({RigId(1), 0, {0}});
    for (int i = 0; i < kPathLength; ++i) {
      const auto id = static_cast<uint32_t>(i + 1);
      scene_.images.push_back({ImageId(id), "", 0, 0, i, {}});
      scene_.frames.push_back({FrameId(id), std::to_string(i), 0, {i}});
    }
    for (const auto& [frame1, frame2] : frames) {
      ImagePair pair;
      pair.image_idx1 = frame1;
      pair.image_idx2 = frame2;
      view_graph_.pairs.push_back(pair);
    }
    path_.of_frame.resize(kPathLength);
    path_.noise.median_step = 1.0;
  }

  void Place(int frame, const Eigen::Vector3d& center, int stretch = 0) {
    path_.of_frame[frame] = RigPath::Place{
        stretch, 0,
        Rigid3::FromRotationAndCenter(Eigen::Quaterniond::Identity(), center)};
  }

  Mask FindLoops() const {
    return FindLoopsAgainstPath(
        FramePairIndex(scene_, view_graph_, SequenceMode::kYes), path_,
        kDriftShare);
  }

 private:
  Scene scene_;
  ViewGraph view_graph_;
  RigPath path_;
};

TEST(LoopConsistency, DistantPlacesOfAStraightRoadAreNotTheSame) {
  PathWithPairs drive({{0, 1}, {10, 90}});
  for (int i = 0; i < kPathLength; ++i) drive.Place(i, {0, 0, 1.0 * i});
  const Mask is_against = drive.FindLoops();
  EXPECT_FALSE(is_against[0]);  // neighbors
  EXPECT_TRUE(is_against[1]);
}

TEST(LoopConsistency, ACircleReturns) {
  PathWithPairs drive({{0, 99}, {0, 50}});
  const double radius = kPathLength / (2.0 * M_PI);
  for (int i = 0; i < kPathLength; ++i) {
    const double angle = 2.0 * M_PI * i / kPathLength;
    drive.Place(i, {radius * std::cos(angle), 0, radius * std::sin(angle)});
  }
  const Mask is_against = drive.FindLoops();
  EXPECT_FALSE(is_against[0]);
  EXPECT_TRUE(is_against[1]);
}

TEST(LoopConsistency, NothingIsKnownAcrossAnUnknownStep) {
  PathWithPairs drive({{10, 90}});
  for (int i = 0; i < kPathLength; ++i) {
    drive.Place(i, {0, 0, 1.0 * i}, i < 50 ? 0 : 1);
  }
  EXPECT_FALSE(drive.FindLoops().Any());
}

}  // namespace
}  // namespace mgsfm
