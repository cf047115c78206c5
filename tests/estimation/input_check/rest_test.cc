// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <vector>

#include "estimation/input_check/sound_drive.h"
#include "input_check/kept_matches.h"

namespace mgsfm {
namespace {

constexpr double kMaxErrorPx = 2.0;

bool StandsStill(const Simulation& drive) {
  return IsAtRest(ShareAtRest(drive.scene, drive.ground_truth, kMaxErrorPx));
}

// From frame `first_frame_idx` on, each image shows the points of its track
// where the first image of its camera shows them.
void Rest(int first_frame_idx, Simulation* drive) {
  for (const Point3D& point : drive->ground_truth.points) {
    std::map<int, Eigen::Vector2f> first_of_sensor;
    for (const Observation& observation : point.track) {
      Image& image = drive->scene.images[observation.image_idx];
      if (image.frame_idx < first_frame_idx) continue;
      Eigen::Vector2f& keypoint = image.keypoints_px[observation.keypoint_idx];
      keypoint =
          first_of_sensor.emplace(image.sensor_idx, keypoint).first->second;
    }
  }
}

TEST(RestTest, AMovingRigIsNoFinding) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kCube6}) {
    EXPECT_FALSE(StandsStill(SoundDrive(rig)));
  }
}

TEST(RestTest, ARigThatStandsIsNamed) {
  Simulation drive = SoundDrive();
  Rest(0, &drive);
  EXPECT_TRUE(StandsStill(drive));
}

// Each image is compared with the first one of its camera.
TEST(RestTest, TheBoundIsTwiceThatOfOutliers) {
  Simulation drive = SoundDrive();
  Rest(0, &drive);
  const auto shift = [&](float distance_px) {
    for (Image& image : drive.scene.images) {
      if (image.frame_idx % 2 == 0) continue;
      for (Eigen::Vector2f& keypoint : image.keypoints_px) {
        keypoint.x() += distance_px;
      }
    }
  };
  shift(1.9F * static_cast<float>(kMaxErrorPx));
  EXPECT_TRUE(StandsStill(drive));
  shift(0.2F * static_cast<float>(kMaxErrorPx));
  EXPECT_FALSE(StandsStill(drive));
}

// Dirt on a lens, in a model whose other points are seen by each camera once.
TEST(RestTest, AFewPointsDoNotDecide) {
  Simulation drive = SoundDrive();
  Rest(0, &drive);
  auto& points = drive.ground_truth.points;
  for (size_t i = 3; i < points.size(); ++i) {
    std::vector<Observation> once;
    std::set<int> sensors;
    for (const Observation& observation : points[i].track) {
      if (sensors.insert(drive.scene.images[observation.image_idx].sensor_idx)
              .second) {
        once.push_back(observation);
      }
    }
    points[i].track = once;
  }
  EXPECT_FALSE(StandsStill(drive));
}

// As at a traffic light.
TEST(RestTest, ARigThatDrivesBeforeItStandsIsNoFinding) {
  Simulation drive = SoundDrive();
  Rest(20, &drive);
  EXPECT_FALSE(StandsStill(drive));
}

TEST(RestTest, AnEmptyModelIsNoFinding) {
  Simulation drive = SoundDrive();
  drive.ground_truth.points.clear();
  EXPECT_FALSE(StandsStill(drive));
}

}  // namespace
}  // namespace mgsfm
