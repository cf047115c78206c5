// SPDX-License-Identifier: BSD-3-Clause
#include "health/kept_matches.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "health/sound_drive.h"

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

// ------------------------------------------------------- refuted findings

Finding DoubtAbout(const std::vector<std::string>& cameras) {
  Finding finding;
  finding.cause = Cause::kWrongFocalLength;
  finding.cameras = cameras;
  return finding;
}

Scene SceneOfCameras(const std::vector<std::string>& names) {
  Scene scene;
  for (const std::string& name : names) {
    scene.sensors.push_back({name, 0, 0, Rigid3()});
  }
  return scene;
}

// Of 1000 matches per sensor and model.
KeptMatches Keeps(const std::vector<size_t>& num_kept) {
  KeptMatches kept;
  for (const size_t count : num_kept) kept.sensors.push_back({1000, count});
  return kept;
}

TEST(WithoutRefutedTest, NineteenOfTwentyMatchesRefuteADoubt) {
  const Scene scene = SceneOfCameras({"left", "right"});
  const std::vector<Finding> doubts = {DoubtAbout({"left"}),
                                       DoubtAbout({"right"})};
  const auto left = WithoutRefuted(scene, {Keeps({950, 949})}, doubts);
  ASSERT_EQ(left.size(), 1u);
  EXPECT_THAT(left[0].cameras, ElementsAre("right"));
}

TEST(WithoutRefutedTest, AllCamerasOfAFindingMustBeHealthy) {
  const Scene scene = SceneOfCameras({"left", "right"});
  const std::vector<Finding> doubts = {DoubtAbout({"left", "right"})};
  EXPECT_EQ(WithoutRefuted(scene, {Keeps({1000, 900})}, doubts).size(), 1u);
  EXPECT_THAT(WithoutRefuted(scene, {Keeps({1000, 990})}, doubts), IsEmpty());
}

TEST(WithoutRefutedTest, TheMatchesOfAllModelsCount) {
  const Scene scene = SceneOfCameras({"left"});
  const std::vector<Finding> doubts = {DoubtAbout({"left"})};
  EXPECT_THAT(WithoutRefuted(scene, {Keeps({1000}), Keeps({901})}, doubts),
              IsEmpty());
  EXPECT_EQ(WithoutRefuted(scene, {Keeps({1000}), Keeps({899})}, doubts).size(),
            1u);
}

TEST(WithoutRefutedTest, NothingIsRefutedWithoutMatchesOrCameras) {
  const Scene scene = SceneOfCameras({"left"});
  const std::vector<Finding> doubts = {DoubtAbout({"left"}), DoubtAbout({}),
                                       DoubtAbout({"elsewhere"})};
  KeptMatches none;
  none.sensors.resize(1);
  EXPECT_EQ(WithoutRefuted(scene, {none}, doubts).size(), 3u);
  EXPECT_EQ(WithoutRefuted(scene, {}, doubts).size(), 3u);
  EXPECT_EQ(WithoutRefuted(scene, {Keeps({1000})}, doubts).size(), 2u);
}

// The truth refutes a doubt about a right focal length, and not one about a
// focal length that is 30 % wrong.
TEST(WithoutRefutedTest, AWrongFocalLengthCostsTooManyMatches) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = PathPreset::kCurve;
  options.num_frames = 20;
  options.max_num_features_per_image = 100;
  options.pixel_noise_px = 0.5;
  const Simulation drive = Simulate(options);
  Reconstruction model = drive.ground_truth;
  const std::string camera = drive.scene.sensors[0].name;
  const auto doubts_left = [&] {
    return WithoutRefuted(drive.scene, {Count(drive, model)},
                          {DoubtAbout({camera})});
  };
  EXPECT_THAT(doubts_left(), IsEmpty());
  for (Camera& of_model : model.cameras) {
    of_model.params[0] *= 0.7;  // of PINHOLE: fx, fy
    of_model.params[1] *= 0.7;
  }
  EXPECT_EQ(doubts_left().size(), 1u);
}

}  // namespace
}  // namespace mgsfm
