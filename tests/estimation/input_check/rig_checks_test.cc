// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/rig_checks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimation/input_check/sound_drive.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using testing::ElementsAre;
using testing::IsEmpty;

std::vector<SensorPairSamples> SamplesOf(const Simulation& drive) {
  return CollectRigSamples(drive.scene, drive.view_graph);
}

// Turns a sensor from a frame on: its new frame is new_from_old.
void Knock(int sensor_idx, int first_frame_idx, const Quaterniond& new_from_old,
           Simulation* drive) {
  const auto is_turned = [&](int image_idx) {
    const Image& image = drive->scene.images[image_idx];
    return image.sensor_idx == sensor_idx && image.frame_idx >= first_frame_idx;
  };
  for (ImagePair& pair : drive->view_graph.pairs) {
    RelativePose& pose = *pair.relative_pose;
    if (is_turned(pair.image_idx1)) {
      pose.cam2_from_cam1 = pose.cam2_from_cam1 * new_from_old.conjugate();
    }
    if (!is_turned(pair.image_idx2)) continue;
    pose.cam2_from_cam1 = new_from_old * pose.cam2_from_cam1;
    if (pose.translation_direction) {
      pose.translation_direction = new_from_old * *pose.translation_direction;
    }
  }
}

TEST(RigChecksTest, SamplesAreThePoseInTheRig) {
  const Simulation drive = SoundDrive(RigPreset::kKitti360);
  for (const SensorPairSamples& pair : SamplesOf(drive)) {
    const auto typical = FindTypicalPose(pair.samples);
    ASSERT_TRUE(typical.has_value());
    const Rigid3 b_from_a =
        *drive.ground_truth.sensor_from_rig[pair.sensor_b] *
        drive.ground_truth.sensor_from_rig[pair.sensor_a]->Inverse();
    EXPECT_LT(RadToDeg(AngleBetween(typical->b_from_a, b_from_a.rotation)),
              0.2);
    if (!typical->direction) continue;
    EXPECT_LT(RadToDeg(AngleBetween(*typical->direction, b_from_a.translation)),
              5.0);
  }
}

TEST(RigChecksTest, SoundRigsStayTheSame) {
  for (const RigPreset rig :
       {RigPreset::kStereo, RigPreset::kKitti360, RigPreset::kCube6}) {
    const Simulation drive = SoundDrive(rig);
    const auto samples = SamplesOf(drive);
    EXPECT_THAT(FindRigMoves(drive.scene, samples), IsEmpty());
    EXPECT_THAT(FindSwappedCameras(drive.scene, samples), IsEmpty());
  }
}

TEST(RigChecksTest, KnockIsFoundWithCameraAndFrame) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    const int sensor_idx = rig == RigPreset::kStereo ? 1 : 2;
    Simulation drive = SoundDrive(rig);
    Knock(sensor_idx, 15, ExpSO3({0.0, DegToRad(3.0), 0.0}), &drive);
    const auto findings = FindRigMoves(drive.scene, SamplesOf(drive));
    ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kRigMoved));
    EXPECT_EQ(findings[0].cameras[0], drive.scene.sensors[sensor_idx].name);
    EXPECT_THAT(findings[0].frames, ElementsAre(drive.scene.frames[15].name));
    EXPECT_NEAR(findings[0].evidence[0].second, 3.0, 0.3);
  }
}

TEST(RigChecksTest, WrongKnownRotationIsNamed) {
  Simulation drive = SoundDrive();
  for (size_t k = 0; k < drive.scene.sensors.size(); ++k) {
    drive.scene.sensors[k].sensor_from_rig =
        drive.ground_truth.sensor_from_rig[k];
  }
  const auto samples = SamplesOf(drive);
  EXPECT_THAT(CheckKnownRotations(drive.scene, samples, {}), IsEmpty());
  Rigid3& pose = *drive.scene.sensors[1].sensor_from_rig;
  pose.rotation = ExpSO3({DegToRad(2.0), 0.0, 0.0}) * pose.rotation;
  EXPECT_THAT(CheckKnownRotations(drive.scene, samples, {{100, 90}, {100, 90}}),
              IsEmpty());
  const auto findings =
      CheckKnownRotations(drive.scene, samples, {{100, 90}, {100, 10}});
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kWrongKnownRotation));
  EXPECT_THAT(findings[0].cameras, ElementsAre("cam0", "cam1"));
}

TEST(RigChecksTest, SwappedCamerasAreNamedWithTheirFrames) {
  Simulation drive = SoundDrive();
  Scene& scene = drive.scene;
  for (Image& image : scene.images) {
    if (image.frame_idx >= 10 && image.frame_idx < 25) {
      image.sensor_idx = 1 - image.sensor_idx;
    }
  }
  const auto findings = FindSwappedCameras(scene, SamplesOf(drive));
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kSwappedCameras));
  EXPECT_THAT(findings[0].frames,
              ElementsAre(scene.frames[10].name, scene.frames[24].name));
}

// A camera that is late turns relative to its rig wherever the rig turns. With
// the delay removed, nothing remains.
TEST(RigChecksTest, DelaysAreNoMoves) {
  Simulation drive = SoundDrive();
  RigDelays delays;
  delays.delayed = drive.ground_truth;
  delays.cameras = {{1, 0.3, 0.01, true}};
  delays.delayed.motions.resize(drive.scene.images.size());
  std::vector<SensorPairSamples> samples = SamplesOf(drive);
  const Quaterniond& a = drive.ground_truth.sensor_from_rig[0]->rotation;
  for (RigSample& sample : samples[0].samples) {
    const bool turns = sample.frame_idx >= 20;
    const Vector3d velocity(0.0, turns ? DegToRad(10.0) : 0.0, 0.0);
    for (const int image_idx :
         drive.scene.frames[sample.frame_idx].image_idxs) {
      if (drive.scene.images[image_idx].sensor_idx != 1) continue;
      delays.delayed.motions[image_idx].rotation = ExpSO3(0.3 * velocity);
    }
    sample.b_from_a = sample.b_from_a * ExpSO3(a * (0.3 * velocity));
  }
  EXPECT_THAT(CausesOf(FindRigMoves(drive.scene, samples)),
              ElementsAre(Cause::kRigMoved));
  RemoveMotions(drive.scene, delays.delayed, &samples);
  EXPECT_THAT(FindRigMoves(drive.scene, samples), IsEmpty());
  const std::vector<Finding> findings = DescribeDelays(drive.scene, delays);
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kUnsynchronized));
  EXPECT_EQ(findings[0].cameras.front(), drive.scene.sensors[1].name);
  delays.cameras[0].is_certain = false;
  EXPECT_THAT(DescribeDelays(drive.scene, delays), IsEmpty());
}

}  // namespace
}  // namespace mgsfm
