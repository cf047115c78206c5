// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/kept_matches.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimation/input_check/sound_drive.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

KeptMatches Count(const Simulation& drive, const Reconstruction& model) {
  return CountKeptMatches(drive.scene, drive.view_graph, model, 2.0, Context());
}

TEST(KeptMatchesTest, TheTruthKeepsAllButWrongPairs) {
  const Simulation drive = SoundDrive();
  const KeptMatches kept = Count(drive, drive.ground_truth);
  EXPECT_GT(kept.total.Share(), 0.9);
  EXPECT_THAT(FindLostMatches(drive.scene, kept), IsEmpty());
}

TEST(KeptMatchesTest, ATurnedCameraLosesItsMatches) {
  const Simulation drive = SoundDrive(RigPreset::kKitti360);
  Reconstruction model = drive.ground_truth;
  Rigid3& pose = *model.sensor_from_rig[2];
  pose.rotation = ExpSO3({DegToRad(5.0), 0.0, DegToRad(30.0)}) * pose.rotation;
  const auto findings = FindLostMatches(drive.scene, Count(drive, model));
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kLostMatches));
  EXPECT_THAT(findings[0].cameras, ElementsAre("cam2"));
}

// Each frame of the stretch is turned by another angle.
TEST(KeptMatchesTest, ATornStretchLosesItsMatches) {
  const Simulation drive = SoundDrive();
  Reconstruction model = drive.ground_truth;
  for (int f = 12; f < 24; ++f) {
    Rigid3& pose = *model.rig_from_world[f];
    pose.rotation =
        ExpSO3({DegToRad(f % 2 == 0 ? 4.0 : -4.0), 0.0, 0.0}) * pose.rotation;
  }
  const auto findings = FindLostMatches(drive.scene, Count(drive, model));
  ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kLostMatches));
  ASSERT_EQ(findings[0].frames.size(), 2u);
  EXPECT_GE(findings[0].frames[0], drive.scene.frames[9].name);
  EXPECT_LE(findings[0].frames[1], drive.scene.frames[26].name);
}

}  // namespace
}  // namespace mgsfm
