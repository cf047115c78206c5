// SPDX-License-Identifier: BSD-3-Clause
// Hazards of the content of a database: cameras, rigs, names, keypoints.
#include "mapper/hazard_drives.h"

namespace mgsfm {
namespace {

TEST(Hazards, Hazard01FrameWithoutReferenceImage) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  RemoveImages(
      [](const std::string& name) {
        return name == "cam0/000003.png" || name == "cam0/000004.png" ||
               name == "cam0/000011.png";
      },
      &drive.contents);
  ExpectAllRight(drive, Map(drive));
}

TEST(Hazards, Hazard02CameraIdsWithGaps) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  std::map<CameraId, CameraId> new_ids;
  const uint32_t ids[] = {2147483646, 7, 100000, 3};
  for (size_t i = 0; i < 4; ++i) {
    Camera& camera = drive.contents.cameras[i];
    camera.id = new_ids.emplace(camera.id, CameraId(ids[i])).first->second;
  }
  for (ImageRow& image : drive.contents.images) {
    image.camera_id = new_ids.at(image.camera_id);
  }
  ExpectAllRight(drive, Map(drive));
}

// Two vehicles with different rigs drive on one road. Matches between their
// forward cameras connect them into one model.
TEST(Hazards, Hazard03TwoRigsInOneDatabase) {
  const Simulation stereo_simulation = Simulate(SmallDrive(RigPreset::kStereo));
  const Simulation kitti_simulation =
      Simulate(SmallDrive(RigPreset::kKitti360));
  Drive stereo = MakeDrive(stereo_simulation);
  Drive kitti = MakeDrive(kitti_simulation);
  const auto stereo_keypoints = KeypointsByPoint(stereo_simulation);
  const auto kitti_keypoints = KeypointsByPoint(kitti_simulation);
  std::vector<TwoViewGeometryRow> pairs;
  for (const ImageRow& image1 : stereo.contents.images) {
    for (const ImageRow& image2 : kitti.contents.images) {
      const int gap =
          std::stoi(image1.name.substr(5)) - std::stoi(image2.name.substr(5));
      if (std::abs(gap) != 1 || !Contains(image2.name, "cam0")) continue;
      TwoViewGeometryRow pair{image1.id,
                              ImageId(image2.id.value() + kIdOffset),
                              TwoViewConfig::kCalibrated,
                              {},
                              {},
                              {},
                              {},
                              {}};
      pair.cam2_from_cam1 = kitti.true_poses.at(image2.name) *
                            stereo.true_poses.at(image1.name).Inverse();
      for (const auto& [point, keypoint1] : stereo_keypoints.at(image1.name)) {
        const auto& keypoints2 = kitti_keypoints.at(image2.name);
        const auto it = keypoints2.find(point);
        if (it != keypoints2.end()) {
          pair.matches.push_back({keypoint1, it->second});
        }
      }
      if (pair.matches.size() >= 30) pairs.push_back(pair);
    }
  }
  ASSERT_FALSE(pairs.empty());
  Rename([](const std::string& name) { return "stereo/" + name; }, 0, &stereo);
  Rename([](const std::string& name) { return "kitti/" + name; }, kIdOffset,
         &kitti);
  Drive drive = Join(stereo, kitti);
  Append(pairs, &drive.contents.pairs);
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.rigs.size(), 2u);
  EXPECT_EQ(outcome.scene.frames.size(), 24u);
  ExpectAllRight(drive, outcome);
}

TEST(Hazards, Hazard04CameraSharedByFolders) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo));
  drive.contents.cameras.pop_back();
  for (ImageRow& image : drive.contents.images) {
    image.camera_id = drive.contents.cameras[0].id;
  }
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.frames.size(), 12u);
  ExpectAllRight(drive, outcome);
}

// cam0/a/000000.png and cam0/b/000000.png were not taken at the same time, and
// no pair connects the two sequences.
TEST(Hazards, Hazard05SameFileNamesInTwoSequences) {
  SimulationOptions options = SmallDrive(RigPreset::kStereo);
  Drive first = MakeDriveWithoutRigs(options);
  options.random_seed = 9;
  options.num_frames = 8;
  Drive second = MakeDriveWithoutRigs(options);
  const auto insert = [](const std::string& sequence) {
    return [sequence](const std::string& name) {
      return name.substr(0, 5) + sequence + "/" + name.substr(5);
    };
  };
  Rename(insert("a"), 0, &first);
  Rename(insert("b"), kIdOffset, &second);
  for (ImageRow& image : second.contents.images) {
    image.camera_id = CameraId(image.camera_id.value() - kIdOffset);
  }
  second.contents.cameras.clear();
  const Drive drive = Join(first, second);
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.rigs.size(), 1u);
  EXPECT_EQ(outcome.scene.frames.size(), 20u);
  ASSERT_EQ(outcome.result.models.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    const Evaluation evaluation = EvaluateModel(drive, outcome, i);
    EXPECT_EQ(evaluation.num_registered, i == 0 ? 24 : 16);
    ExpectRight(evaluation);
  }
}

// Keypoints outside the domain of the camera model have no ray.
TEST(Hazards, Hazard13KeypointsWithoutRay) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  for (ImageRow& image : drive.contents.images) {
    for (size_t i = 0; i < image.keypoints_px.size(); i += 10) {
      image.keypoints_px[i] = {1e6f, -1e6f};
    }
  }
  ExpectAllRight(drive, Map(drive));
}

// COLMAP 4 writes no relative pose for pairs that it verified with a rig.
// tests/io/database_test.cc reads all of its schemas.
TEST(Hazards, Hazard14PairsVerifiedWithTheRig) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  for (TwoViewGeometryRow& pair : drive.contents.pairs) {
    pair.config = TwoViewConfig::kCalibratedRig;
    pair.cam2_from_cam1.reset();
    pair.E.reset();
  }
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.result.view_graph.num_dropped_config, 0);
  ExpectAllRight(drive, outcome);
}

// Points behind the image plane are used like all others.
TEST(Hazards, Hazard16FisheyesOf180DegreesAndMore) {
  for (const RigPreset rig : {RigPreset::kKitti360, RigPreset::kCube6}) {
    SimulationOptions options = SmallDrive(rig);
    options.max_num_features_per_image = 400;
    const Drive drive = MakeDriveWithoutRigs(options);
    const Outcome outcome = Map(drive);
    ExpectAllRight(drive, outcome);
    int num_behind = 0;
    const Reconstruction& model = outcome.result.models[0].reconstruction;
    for (const Point3D& point : model.points) {
      for (const Observation& o : point.track) {
        const Rigid3 pose = *model.CamFromWorld(outcome.scene, o.image_idx);
        num_behind += (pose * point.point_in_world).z() < 0.0;
      }
    }
    EXPECT_GT(num_behind, 20);
  }
}

// Focal lengths without a prior are wrong by 8 %. They are recovered from the
// pairs and refined with all points.
TEST(Hazards, Hazard20NoCameraHasAPriorFocalLength) {
  SimulationOptions options = SmallDrive(RigPreset::kStereo, 24);
  options.max_num_features_per_image = 400;
  Drive drive = MakeDriveWithoutRigs(options);
  const std::vector<Camera> true_cameras = drive.contents.cameras;
  for (Camera& camera : drive.contents.cameras) {
    camera.has_prior_focal_length = false;
    for (const int k : InfoOf(camera.model).focal_length_idxs) {
      camera.params[k] *= 1.08;
    }
  }
  for (TwoViewGeometryRow& pair : drive.contents.pairs) {
    pair.config = TwoViewConfig::kUncalibrated;
    pair.cam2_from_cam1.reset();
    pair.E.reset();
  }
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  const auto& cameras = outcome.result.models[0].reconstruction.cameras;
  ASSERT_EQ(cameras.size(), true_cameras.size());
  for (size_t i = 0; i < cameras.size(); ++i) {
    EXPECT_NEAR(cameras[i].params[0] / true_cameras[i].params[0], 1.0, 0.01);
  }
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 48);
  EXPECT_LT(evaluation.position_m->max, 0.1);
}

}  // namespace
}  // namespace mgsfm
