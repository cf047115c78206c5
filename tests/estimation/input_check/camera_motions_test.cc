// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/camera_motions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"
#include "estimation/input_check/sound_drive.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using testing::ElementsAre;
using testing::IsEmpty;

std::vector<Finding> Check(const Simulation& drive) {
  return CheckMotions(drive.scene, drive.view_graph,
                      CollectRigSamples(drive.scene, drive.view_graph),
                      nullptr);
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

// Makes the images of camera 1 mirror images: M R M and M t are their motions.
// `by_pair` sets what the pairs with the other camera measure.
template <typename ByPair>
void Mirror(const ByPair& by_pair, Simulation* drive) {
  for (ImagePair& pair : drive->view_graph.pairs) {
    const Image& image1 = drive->scene.images[pair.image_idx1];
    const Image& image2 = drive->scene.images[pair.image_idx2];
    RelativePose& pose = *pair.relative_pose;
    if (image1.sensor_idx != image2.sensor_idx) {
      by_pair(image1, image2, &pair);
    } else if (image1.sensor_idx == 1) {
      Quaterniond& q = pose.cam2_from_cam1;
      q = Quaterniond(q.w(), q.x(), -q.y(), -q.z());
      if (pose.translation_direction) pose.translation_direction->x() *= -1.0;
    }
  }
}

TEST(CameraMotionsTest, MirroredImagesAreFound) {
  Simulation drive = SoundDrive();
  Random random(1);
  Mirror(
      [&](const Image&, const Image&, ImagePair* pair) {
        pair->relative_pose->cam2_from_cam1 = ExpSO3(
            2.0 * Vector3d(random.Normal(), random.Normal(), random.Normal()));
      },
      &drive);
  EXPECT_THAT(CausesOf(Check(drive)), ElementsAre(Cause::kMirroredCamera));
  // No rigid rig explains mirrored images that move.
  const auto samples = CollectRigSamples(drive.scene, drive.view_graph);
  KeptMatches kept{{{100, 90}, {100, 40}}, {}, {200, 130}};
  EXPECT_THAT(
      CausesOf(CheckMotions(drive.scene, drive.view_graph, samples, &kept)),
      ElementsAre(Cause::kMirroredCamera));
  // Nor does a model without that camera.
  kept.sensors[1] = {0, 0};
  EXPECT_THAT(
      CausesOf(CheckMotions(drive.scene, drive.view_graph, samples, &kept)),
      ElementsAre(Cause::kMirroredCamera));
  kept.sensors[1] = {100, 90};
  EXPECT_THAT(CheckMotions(drive.scene, drive.view_graph, samples, &kept),
              IsEmpty());
}

// A rig turns on the spot. Pairs with the mirrored camera see one scene from
// one place, and measure one wrong rotation: about that of a view from behind.
class TurningRig {
 public:
  // The rotation of camera 1 relative to camera 0, by pairs within frames.
  void SetRotationByPairs(const Quaterniond& cam1_from_cam0) {
    Mirror(
        [&](const Image& image1, const Image& image2, ImagePair* pair) {
          if (image1.frame_idx != image2.frame_idx) {
            pair->relative_pose.reset();
          } else {
            pair->relative_pose->cam2_from_cam1 =
                image1.sensor_idx == 0 ? cam1_from_cam0
                                       : cam1_from_cam0.conjugate();
          }
        },
        &drive_);
    for (ImagePair& pair : drive_.view_graph.pairs) {
      if (pair.relative_pose) pair.relative_pose->translation_direction.reset();
    }
  }
  // Turns camera 1 in its rig; its pairs with the other camera stay.
  void Turn(const Quaterniond& new_from_cam1) {
    for (ImagePair& pair : drive_.view_graph.pairs) {
      const Image& image1 = drive_.scene.images[pair.image_idx1];
      const Image& image2 = drive_.scene.images[pair.image_idx2];
      if (image1.sensor_idx != 1 || image2.sensor_idx != 1 ||
          !pair.relative_pose) {
        continue;
      }
      Quaterniond& q = pair.relative_pose->cam2_from_cam1;
      q = new_from_cam1 * q * new_from_cam1.conjugate();
    }
  }
  // The camera with most motions is the reference.
  void RemoveMotions(int sensor_idx, int number) {
    for (ImagePair& pair : drive_.view_graph.pairs) {
      const Image& image1 = drive_.scene.images[pair.image_idx1];
      const Image& image2 = drive_.scene.images[pair.image_idx2];
      if (image1.sensor_idx != sensor_idx || image2.sensor_idx != sensor_idx) {
        continue;
      }
      if (number-- > 0) pair.relative_pose.reset();
    }
  }
  std::vector<Finding> Findings() const { return Check(drive_); }

 private:
  Simulation drive_ = SoundDrive();
};

TEST(CameraMotionsTest, MirroredImagesAreFoundWhereARigTurnsOnTheSpot) {
  for (const double angle_deg : {130.0, 160.0, 180.0}) {
    TurningRig rig;
    rig.SetRotationByPairs(ExpSO3({0.0, DegToRad(angle_deg), 0.0}));
    EXPECT_THAT(CausesOf(rig.Findings()), ElementsAre(Cause::kMirroredCamera));
  }
}

// A camera may be mounted with such a turn, whichever is the reference.
TEST(CameraMotionsTest, PairsThatConfirmATurnShowThatItIsNoMirror) {
  const Quaterniond turn = ExpSO3({DegToRad(120.0), 0.0, 0.0});
  const Quaterniond unmirrored(0.0, 1.0, 0.0, 0.0);
  for (const int fewer_motions : {0, 1}) {
    TurningRig rig;
    rig.SetRotationByPairs(turn);
    rig.RemoveMotions(fewer_motions, 5);
    rig.Turn(unmirrored);
    rig.Turn(turn);
    EXPECT_THAT(rig.Findings(), IsEmpty());
    rig.SetRotationByPairs(turn.conjugate());
    rig.Turn(unmirrored);
    EXPECT_THAT(CausesOf(rig.Findings()), ElementsAre(Cause::kMirroredCamera));
  }
}

// Mirror images that are turned by 180 degrees about the horizontal axis move
// as those of a sound rig.
TEST(CameraMotionsTest, OtherContradictionsOfPairsAreNoMirror) {
  const Quaterniond unmirrored(0.0, 1.0, 0.0, 0.0);
  const Quaterniond about_y(0.0, 0.0, 1.0, 0.0);
  for (const double angle_deg : {0.0, 45.0, 130.0, 160.0}) {
    TurningRig rig;
    rig.SetRotationByPairs(ExpSO3({0.0, DegToRad(angle_deg), 0.0}));
    rig.Turn(unmirrored);
    EXPECT_THAT(rig.Findings(), IsEmpty());
    rig.Turn(about_y);  // looks back
    EXPECT_THAT(rig.Findings(), IsEmpty());
  }
}

// A lag beyond those that are tried.
TEST(CameraMotionsTest, ForeignCameraIsFound) {
  Simulation drive = SoundDrive();
  Delay(1, 13, &drive);
  EXPECT_THAT(CausesOf(Check(drive)), ElementsAre(Cause::kForeignCamera));
}

}  // namespace
}  // namespace mgsfm
