// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/known_rigs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Simulation DriveWithKnownRig(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 12;
  options.pixel_noise_px = 0.5;
  options.relative_rotation_noise_deg = 0.5;
  options.wrong_pair_ratio = 0.1;
  options.extrinsics_are_known = true;
  return Simulate(options);
}

std::string ErrorOf(const Simulation& simulation) {
  try {
    const Bearings bearings = ComputeBearings(simulation.scene, 1);
    CheckKnownRigs(simulation.scene, {bearings, simulation.view_graph});
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

Rigid3& PoseOf(Simulation* simulation, int sensor_idx) {
  return *simulation->scene.sensors[sensor_idx].sensor_from_rig;
}

TEST(KnownRigsTest, TrueRigsPass) {
  for (const RigPreset rig : {RigPreset::kMono, RigPreset::kStereo,
                              RigPreset::kKitti360, RigPreset::kCube6}) {
    for (const PathPreset path :
         {PathPreset::kCurve, PathPreset::kLoop, PathPreset::kStanding}) {
      EXPECT_EQ(ErrorOf(DriveWithKnownRig(rig, path)), "");
    }
  }
}

// All large rotations between the frames of a straight drive are wrong.
TEST(KnownRigsTest, WrongPairsOfAStraightDriveAreNoContradiction) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kStraight);
  EXPECT_EQ(ErrorOf(simulation), "");
  Random random(1, 0);
  size_t num_wrong = 0;
  for (ImagePair& pair : simulation.view_graph.pairs) {
    const Image& image1 = simulation.scene.images[pair.image_idx1];
    const Image& image2 = simulation.scene.images[pair.image_idx2];
    if (image1.sensor_idx != image2.sensor_idx || !pair.relative_pose) continue;
    Eigen::Vector3d turn;
    for (int k = 0; k < 3; ++k) turn[k] = random.Uniform(-1.0, 1.0);
    pair.relative_pose->cam2_from_cam1 =
        ExpSO3(turn) * pair.relative_pose->cam2_from_cam1;
    ++num_wrong;
  }
  EXPECT_GT(num_wrong, 40u);
  EXPECT_EQ(ErrorOf(simulation), "");
}

// Another direction of the translation, with another rotation, explains the
// matches in a cone of five degrees as well.
TEST(KnownRigsTest, NarrowOverlapsAreNoContradiction) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kCurve);
  const Bearings bearings = ComputeBearings(simulation.scene, 1);
  const Eigen::Vector3d center = Eigen::Vector3d(0.4, 0.0, 1.0).normalized();
  int num_pairs = 0;
  for (ImagePair& pair : simulation.view_graph.pairs) {
    const auto& images = simulation.scene.images;
    if (images[pair.image_idx1].frame_idx !=
            images[pair.image_idx2].frame_idx ||
        !pair.relative_pose || !pair.relative_pose->translation_direction) {
      continue;
    }
    const auto is_outside = [&](const Match& match) {
      return AngleBetween(bearings.Ray(pair.image_idx1,
                                       static_cast<int>(match.keypoint_idx1)),
                          center) > DegToRad(5.0);
    };
    pair.matches.erase(
        std::remove_if(pair.matches.begin(), pair.matches.end(), is_outside),
        pair.matches.end());
    Eigen::Vector3d& direction = *pair.relative_pose->translation_direction;
    direction = ExpSO3(DegToRad(60.0) * Eigen::Vector3d::UnitY()) * direction;
    ++num_pairs;
  }
  EXPECT_GT(num_pairs, 6);
  EXPECT_EQ(ErrorOf(simulation), "");
}

TEST(KnownRigsTest, UnknownPosesAreNotJudged) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kCurve);
  simulation.scene.sensors[1].sensor_from_rig.reset();
  EXPECT_EQ(ErrorOf(simulation), "");
}

TEST(KnownRigsTest, WrongRotationIsNamed) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kCurve);
  PoseOf(&simulation, 1).rotation =
      ExpSO3({0.0, DegToRad(20.0), 0.0}) * PoseOf(&simulation, 1).rotation;
  EXPECT_THAT(ErrorOf(simulation),
              AllOf(HasSubstr("'cam0'"), HasSubstr("'cam1'"),
                    HasSubstr("rotation"), HasSubstr("contradicts")));
}

TEST(KnownRigsTest, InvertedPoseIsFound) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kCurve);
  PoseOf(&simulation, 1) = PoseOf(&simulation, 1).Inverse();
  EXPECT_THAT(ErrorOf(simulation),
              AllOf(HasSubstr("direction of the translation"),
                    HasSubstr("not rig_from_cam")));
}

TEST(KnownRigsTest, OrderOfQuaternionsIsFound) {
  for (const bool is_inverse : {false, true}) {
    Simulation simulation =
        DriveWithKnownRig(RigPreset::kKitti360, PathPreset::kCurve);
    for (Sensor& sensor : simulation.scene.sensors) {
      Rigid3& pose = *sensor.sensor_from_rig;
      if (is_inverse) pose = pose.Inverse();
      const Eigen::Quaterniond q = pose.rotation;
      // The reference is the identity in any order.
      if (!q.vec().isZero()) pose.rotation = {q.x(), q.y(), q.z(), q.w()};
    }
    EXPECT_THAT(ErrorOf(simulation),
                AllOf(HasSubstr("x y z w"), HasSubstr("w x y z")));
    EXPECT_EQ(ErrorOf(simulation).find("inverse") != std::string::npos,
              is_inverse);
  }
}

// Cameras without common field of view contradict each other by their rotations
// between frames.
TEST(KnownRigsTest, WrongRotationWithoutOverlapIsFound) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kKitti360, PathPreset::kLoop);
  auto& pairs = simulation.view_graph.pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const ImagePair& pair) {
                               const auto& images = simulation.scene.images;
                               return images[pair.image_idx1].sensor_idx !=
                                      images[pair.image_idx2].sensor_idx;
                             }),
              pairs.end());
  EXPECT_EQ(ErrorOf(simulation), "");
  PoseOf(&simulation, 2).rotation =
      ExpSO3({0.0, 0.0, DegToRad(90.0)}) * PoseOf(&simulation, 2).rotation;
  EXPECT_THAT(ErrorOf(simulation), HasSubstr("contradicts"));
}

TEST(KnownRigsTest, MapperRefusesAContradictoryRig) {
  Simulation simulation =
      DriveWithKnownRig(RigPreset::kStereo, PathPreset::kCurve);
  PoseOf(&simulation, 1) = PoseOf(&simulation, 1).Inverse();
  EXPECT_THROW(
      (void)RunMapper({simulation.scene, simulation.view_graph}, {}, {}),
      Error);
}

}  // namespace
}  // namespace mgsfm
