// SPDX-License-Identifier: BSD-3-Clause
// Hazards of the motion of a rig and of the overlap of its cameras.
#include "mapper/hazard_drives.h"

namespace mgsfm {
namespace {

bool AreOfDifferentSensors(const std::string& name1, const std::string& name2) {
  return name1.substr(0, 4) != name2.substr(0, 4);
}

// The motion determines the rotation of the camera in the rig if the rig
// rotates enough. Otherwise the camera must be rejected; it must not get the
// rotation of the reference sensor.
TEST(Hazards, Hazard06CameraNeverRegisteredWithOthers) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360, 36);
  for (const PathPreset path : {PathPreset::kCurve, PathPreset::kStraight}) {
    options.path = path;
    const Simulation simulation = Simulate(options);
    Drive drive = MakeDriveWithoutRigs(options);
    RemovePairs(
        [](const std::string& name1, const std::string& name2) {
          return AreOfDifferentSensors(name1, name2) &&
                 (Contains(name1, "cam3") || Contains(name2, "cam3"));
        },
        &drive.contents);
    const Outcome outcome = Map(drive);
    ASSERT_EQ(outcome.result.models.size(), 1u);
    const Reconstruction& model = outcome.result.models[0].reconstruction;
    const SensorRotationSummary& rotation = outcome.result.rotation.sensors[3];
    EXPECT_FALSE(rotation.message.empty());
    // Whether a short winding drive rotates enough depends on the noise.
    if (path == PathPreset::kStraight) {
      EXPECT_FALSE(rotation.is_observable);
    }
    ASSERT_EQ(model.sensor_from_rig[3].has_value(), rotation.is_observable);
    if (rotation.is_observable) {
      EXPECT_LT(RadToDeg(AngleBetween(
                    model.sensor_from_rig[3]->rotation,
                    simulation.ground_truth.sensor_from_rig[3]->rotation)),
                1.0);
    }
    const Evaluation evaluation = EvaluateModel(drive, outcome);
    EXPECT_EQ(evaluation.num_registered, rotation.is_observable ? 144 : 108);
    EXPECT_LT(evaluation.rotation_deg->max, 1.0);
  }
}

// The data determine neither the lengths of the lever arms nor the viewing
// directions of the cameras about the direction of motion.
TEST(Hazards, Hazard07StraightDriveWithoutOverlap) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360);
  options.path = PathPreset::kStraight;
  options.match_different_sensors = false;
  const Drive drive = MakeDriveWithoutRigs(options);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  for (size_t i = 1; i < 4; ++i) {
    EXPECT_FALSE(outcome.result.rotation.sensors[i].is_observable);
    EXPECT_FALSE(outcome.result.rotation.sensors[i].message.empty());
    EXPECT_FALSE(
        outcome.result.models[0].reconstruction.sensor_from_rig[i].has_value());
  }
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 12);
  ExpectRight(evaluation);
}

// All cameras of a known rig then move alike in any unit of length: the lever
// arms do not determine it, and the summary states so.
TEST(Hazards, Hazard07StraightDriveWithoutOverlapButKnownRig) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360);
  options.path = PathPreset::kStraight;
  options.match_different_sensors = false;
  options.extrinsics_are_known = true;
  const Drive drive = MakeDrive(Simulate(options));
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const MapperModel& model = outcome.result.models[0];
  EXPECT_FALSE(model.translation.is_metric);
  for (size_t i = 1; i < 4; ++i) {
    EXPECT_FALSE(model.translation.sensors[i].message.empty());
  }
  std::vector<ImagePoses> references;
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const Image& image = outcome.scene.images[i];
    const auto pose =
        model.reconstruction.CamFromWorld(outcome.scene, static_cast<int>(i));
    ASSERT_TRUE(pose.has_value()) << image.name;
    if (!outcome.scene.IsReference(image.sensor_idx)) continue;
    references.push_back(
        {image.name, true, pose, drive.true_poses.at(image.name)});
  }
  ExpectRight(Evaluate(references, true, {}, {}));
}

// The rig stops in the middle of a drive: copies of frame 6 with independent
// noise, matched like frame 6 and with each other.
TEST(Hazards, Hazard08StandingFramesAmongMovingOnes) {
  constexpr int kNumCopies = 4;
  const auto is_stop = [](const std::string& name) {
    return Contains(name, "/000006");
  };
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 14));
  DatabaseContents& contents = drive.contents;
  const std::vector<ImageRow> images = contents.images;
  const std::vector<TwoViewGeometryRow> pairs = contents.pairs;
  Random random(4);
  const auto copy_of = [&](ImageId id, int copy) {
    return copy == 0 || !is_stop(NameOf(contents, id))
               ? id
               : ImageId(id.value() + kIdOffset * copy);
  };
  const auto add_pair = [&](TwoViewGeometryRow pair, ImageId id1, ImageId id2) {
    pair.image_id1 = id1;
    pair.image_id2 = id2;
    if (id2 < id1) SwapImages(&pair);
    contents.pairs.push_back(pair);
  };
  for (int copy = 1; copy <= kNumCopies; ++copy) {
    for (ImageRow image : images) {
      if (!is_stop(image.name)) continue;
      TwoViewGeometryRow same{
          image.id, image.id, TwoViewConfig::kPanoramic, {}, {}, {}, {}, {}};
      for (uint32_t i = 0; i < image.keypoints_px.size(); ++i) {
        same.matches.push_back({i, i});
      }
      for (int other = 0; other < copy; ++other) {
        add_pair(same, copy_of(image.id, other), copy_of(image.id, copy));
      }
      const Rigid3 true_pose = drive.true_poses.at(image.name);
      image.id = copy_of(image.id, copy);
      image.name.insert(image.name.rfind('.'), "_" + std::to_string(copy));
      for (Eigen::Vector2f& keypoint : image.keypoints_px) {
        keypoint +=
            Eigen::Vector2d(0.3 * random.Normal(), 0.3 * random.Normal())
                .cast<float>();
      }
      drive.true_poses[image.name] = true_pose;
      contents.images.push_back(image);
    }
    for (const TwoViewGeometryRow& pair : pairs) {
      const ImageId id1 = copy_of(pair.image_id1, copy);
      const ImageId id2 = copy_of(pair.image_id2, copy);
      if (id1 != pair.image_id1 || id2 != pair.image_id2) {
        add_pair(pair, id1, id2);
      }
    }
  }
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.frames.size(), 14u + kNumCopies);
  ExpectAllRight(drive, outcome);
}

// Gaps of one to six frames; neither names nor ids follow the order of time.
TEST(Hazards, Hazard18IrregularFramesInNoOrderOfTime) {
  constexpr int kNumFrames = 30;
  SimulationOptions options = SmallDrive(RigPreset::kStereo, kNumFrames);
  options.num_matched_frames = 7;
  Drive drive = MakeDriveWithoutRigs(options);
  const auto frame_of = [](const std::string& name) {
    return std::stoi(name.substr(5));
  };
  RemoveImages(
      [&](const std::string& name) {
        const int frame = frame_of(name);
        return frame == 2 || frame == 4 || frame == 5 ||
               (frame >= 9 && frame <= 13) || frame == 20 ||
               (frame >= 23 && frame <= 25);
      },
      &drive.contents);
  Rename(
      [&](const std::string& name) {
        // 7 and 30 are coprime.
        const int number = 100 + 7 * frame_of(name) % kNumFrames;
        return name.substr(0, 5) + "000" + std::to_string(number) + ".png";
      },
      0, &drive);
  ExpectAllRight(drive, Map(drive));
}

// The images of the last camera are in reverse order on a circular drive, so
// that no rotation in the rig fits more than a few of them.
TEST(Hazards, Hazard19NoRotationInTheRigFits) {
  constexpr int kNumFrames = 36;
  SimulationOptions options = SmallDrive(RigPreset::kKitti360, kNumFrames);
  options.path = PathPreset::kLoop;
  Drive drive = MakeDriveWithoutRigs(options);
  Rename(
      [](const std::string& name) {
        if (!Contains(name, "cam3")) return name;
        const int number = 100 + kNumFrames - 1 - std::stoi(name.substr(5));
        return "cam3/000" + std::to_string(number) + ".png";
      },
      0, &drive);
  Rename(
      [](const std::string& name) {
        if (Contains(name, "cam3")) return name;
        const int number = 100 + std::stoi(name.substr(5));
        return name.substr(0, 5) + "000" + std::to_string(number) + ".png";
      },
      0, &drive);
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.frames.size(), 36u);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_FALSE(outcome.result.rotation.sensors[3].is_observable);
  EXPECT_FALSE(outcome.result.rotation.sensors[3].message.empty());
  EXPECT_FALSE(
      outcome.result.models[0].reconstruction.sensor_from_rig[3].has_value());
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 3 * kNumFrames);
  ExpectRight(evaluation);
}

// The default model assumes simultaneous triggers. At 10 m/s, 10 ms correspond
// to 0.1 m: nothing is lost, and errors do not exceed that.
TEST(Hazards, Hazard21ImperfectTrigger) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360, 20);
  options.trigger_jitter_ms = 10.0;
  const Drive drive = MakeDriveWithoutRigs(options);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 80);
  EXPECT_LT(evaluation.position_m->max, 0.15);
  EXPECT_LT(evaluation.rotation_deg->max, 1.0);
}

}  // namespace
}  // namespace mgsfm
