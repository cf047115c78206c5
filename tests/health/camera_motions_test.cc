// SPDX-License-Identifier: BSD-3-Clause
#include "health/camera_motions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "health/sound_drive.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

std::vector<Finding> Check(const Simulation& drive) {
  return CheckMotions(drive.scene, drive.view_graph,
                      CollectRigSamples(drive.scene, drive.view_graph));
}

TEST(CameraMotionsTest, SoundRigsMoveAlike) {
  for (const RigPreset rig :
       {RigPreset::kStereo, RigPreset::kKitti360, RigPreset::kCube6}) {
    for (const PathPreset path :
         {PathPreset::kCurve, PathPreset::kLoop, PathPreset::kStraight,
          PathPreset::kStanding}) {
      EXPECT_THAT(Check(SoundDrive(rig, path)), IsEmpty());
    }
  }
}

TEST(CameraMotionsTest, LagIsMeasured) {
  for (const int lag : {1, 2, 4}) {
    Simulation drive = SoundDrive();
    Delay(1, lag, &drive);
    const std::vector<Finding> findings = Check(drive);
    ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kCameraLag));
    EXPECT_THAT(findings[0].cameras, ElementsAre("cam1", "cam0"));
    const auto agreements = CompareMotions(drive.scene, drive.view_graph);
    ASSERT_EQ(agreements.size(), 1u);
    EXPECT_EQ(agreements[0].best_lag, agreements[0].sensor_b == 1 ? lag : -lag);
  }
}

// The lag of one of several cameras is not that of the others.
TEST(CameraMotionsTest, OnlyTheLateCameraIsNamed) {
  Simulation drive = SoundDrive(RigPreset::kKitti360);
  Delay(2, 1, &drive);
  const std::vector<Finding> findings = Check(drive);
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kCameraLag));
  EXPECT_EQ(findings[0].cameras[0], "cam2");
}

// M R M and M t are the motion of mirrored images.
TEST(CameraMotionsTest, MirroredImagesAreFound) {
  Simulation drive = SoundDrive();
  const auto is_right = [&](int image_idx) {
    return drive.scene.images[image_idx].sensor_idx == 1;
  };
  Random random(1);
  for (ImagePair& pair : drive.view_graph.pairs) {
    RelativePose& pose = *pair.relative_pose;
    if (is_right(pair.image_idx1) != is_right(pair.image_idx2)) {
      pose.cam2_from_cam1 =
          ExpSO3(2.0 * Eigen::Vector3d(random.Normal(), random.Normal(),
                                       random.Normal()));
    } else if (is_right(pair.image_idx1)) {
      Eigen::Quaterniond& q = pose.cam2_from_cam1;
      q = Eigen::Quaterniond(q.w(), q.x(), -q.y(), -q.z());
      if (pose.translation_direction) pose.translation_direction->x() *= -1.0;
    }
  }
  EXPECT_THAT(CausesOf(Check(drive)), ElementsAre(Cause::kMirroredCamera));
}

// A lag beyond those that are tried.
TEST(CameraMotionsTest, ForeignCameraIsFound) {
  Simulation drive = SoundDrive();
  Delay(1, 13, &drive);
  EXPECT_THAT(CausesOf(Check(drive)), ElementsAre(Cause::kForeignCamera));
}

}  // namespace
}  // namespace mgsfm
