// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/simulator/simulation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

SimulationOptions SmallScene(RigPreset rig, PathPreset path,
                             WorldPreset world = WorldPreset::kScatter) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.world = world;
  options.num_frames = 12;
  if (world == WorldPreset::kStreet) {
    options.max_visible_distance_m = 100.0;
    options.max_num_features_per_image = 300;
  }
  return options;
}

// Whether two keypoints observe the same world point.
bool IsRight(const Simulation& simulation, const ImagePair& pair,
             const Match& match) {
  const int point1 =
      simulation.keypoint_points[pair.image_idx1][match.keypoint_idx1];
  const int point2 =
      simulation.keypoint_points[pair.image_idx2][match.keypoint_idx2];
  return point1 >= 0 && point1 == point2;
}

class SimulationTest : public testing::TestWithParam<
                           std::tuple<RigPreset, PathPreset, WorldPreset>> {
 protected:
  static Simulation Make() {
    const auto [rig, path, world] = GetParam();
    return Simulate(SmallScene(rig, path, world));
  }
};

TEST_P(SimulationTest, KeypointsAreProjectionsOfTheTruth) {
  const Simulation simulation = Make();
  const Scene& scene = simulation.scene;
  ASSERT_GT(simulation.ground_truth.points.size(), 100u);
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      const Image& image = scene.images[o.image_idx];
      const Camera& camera = scene.cameras[image.camera_idx];
      const auto cam_from_world =
          simulation.ground_truth.CamFromWorld(scene, o.image_idx);
      ASSERT_TRUE(cam_from_world.has_value());
      const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                        *cam_from_world * point.point_in_world);
      ASSERT_TRUE(pixel.has_value());
      // The resolution of float at 1000 px is 6e-5 px.
      EXPECT_LT(
          (*pixel - image.keypoints_px[o.keypoint_idx].cast<double>()).norm(),
          1e-4);
    }
  }
}

TEST_P(SimulationTest, EveryImageIsMatchedAndEveryMatchIsRight) {
  const Simulation simulation = Make();
  std::set<int> matched;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    EXPECT_LT(pair.image_idx1, pair.image_idx2);
    matched.insert(pair.image_idx1);
    matched.insert(pair.image_idx2);
    for (const Match& match : pair.matches) {
      EXPECT_TRUE(IsRight(simulation, pair, match));
    }
  }
  EXPECT_EQ(matched.size(), simulation.scene.images.size());
}

TEST_P(SimulationTest, RelativePosesAreThoseOfTheTruth) {
  const Simulation simulation = Make();
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const Rigid3 truth =
        *simulation.ground_truth.CamFromWorld(simulation.scene,
                                              pair.image_idx2) *
        simulation.ground_truth.CamFromWorld(simulation.scene, pair.image_idx1)
            ->Inverse();
    ASSERT_TRUE(pair.relative_pose.has_value());
    EXPECT_LT(AngleBetween(pair.relative_pose->cam2_from_cam1, truth.rotation),
              1e-9);
    if (!pair.relative_pose->translation_direction) {
      EXPECT_LT(truth.translation.norm(), 1e-6);
      continue;
    }
    EXPECT_LT(AngleBetween(*pair.relative_pose->translation_direction,
                           truth.translation),
              1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(
    AllPresets, SimulationTest,
    testing::Combine(
        testing::Values(RigPreset::kMono, RigPreset::kStereo,
                        RigPreset::kKitti360, RigPreset::kCube6),
        testing::Values(PathPreset::kLoop, PathPreset::kCurve,
                        PathPreset::kStraight, PathPreset::kStanding),
        testing::Values(WorldPreset::kScatter, WorldPreset::kStreet)));

TEST(SimulationTest, SeedDecidesEverything) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  options.pixel_noise_px = 1.0;
  options.mismatch_ratio = 0.1;
  options.missing_image_ratio = 0.2;
  const Simulation a = Simulate(options);
  const Simulation b = Simulate(options);
  options.random_seed = 1;
  const Simulation c = Simulate(options);
  ASSERT_EQ(a.scene.images.size(), b.scene.images.size());
  for (size_t i = 0; i < a.scene.images.size(); ++i) {
    EXPECT_EQ(a.scene.images[i].keypoints_px, b.scene.images[i].keypoints_px);
  }
  EXPECT_NE(a.scene.images[0].keypoints_px, c.scene.images[0].keypoints_px);
  EXPECT_LT(a.scene.images.size(), 24u);
}

TEST(SimulationTest, TakesAGivenRigWhoseReferenceIsNotTheFirstByName) {
  SimulationInput input;
  input.rig = MakeRig(RigPreset::kStereo);
  input.rig[0].image_prefix = "right_";
  input.rig[1].image_prefix = "left_";
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kMono, PathPreset::kCurve), input);
  const Scene& scene = simulation.scene;
  EXPECT_EQ(scene.images.front().name, "left_000000.png");
  EXPECT_EQ(scene.sensors.front().name, "left_");
  EXPECT_EQ(scene.rigs.front().ref_sensor_idx, 1);
  EXPECT_LT(simulation.ground_truth.sensor_from_rig[1]->translation.norm(),
            1e-12);
  EXPECT_GT(simulation.ground_truth.sensor_from_rig[0]->translation.norm(),
            0.5);
}

TEST(SimulationTest, TakesEverySoManyThPoseOfATrajectory) {
  std::vector<Rigid3> path;
  for (int i = 0; i < 21; ++i) {
    path.push_back(Rigid3::FromRotationAndCenter(Eigen::Quaterniond::Identity(),
                                                 {0.0, 0.0, 0.5 * i}));
  }
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve, WorldPreset::kStreet);
  options.frame_step = 2;
  const Simulation simulation = Simulate(options, path);
  ASSERT_EQ(simulation.scene.frames.size(), 11u);
  EXPECT_EQ(simulation.scene.frames[3].name, "000006");
  EXPECT_LT(
      (simulation.ground_truth.rig_from_world[3]->Center() - path[6].Center())
          .norm(),
      1e-12);
}

TEST(SimulationTest, TriggerJitterMovesImagesWithTheSpeedOfTheDrive) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kStraight);
  options.trigger_jitter_ms = 50.0;
  const Simulation simulation = Simulate(options);
  double max_offset_m = 0.0;
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const auto at_frame = simulation.ground_truth.CamFromWorld(
        simulation.scene, static_cast<int>(i));
    const double offset_m =
        (at_frame->Center() - simulation.cam_from_world[i].Center()).norm();
    // 1 m a frame, 10 frames a second.
    EXPECT_LE(offset_m, 0.5 + 1e-9);
    max_offset_m = std::max(max_offset_m, offset_m);
  }
  EXPECT_GT(max_offset_m, 0.25);
}

TEST(SimulationTest, TriggerOffsetDelaysAllCamerasButTheFirst) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kStraight);
  options.trigger_offset_ms = 20.0;
  const Simulation simulation = Simulate(options);
  const Scene& scene = simulation.scene;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto at_frame =
        simulation.ground_truth.CamFromWorld(scene, static_cast<int>(i));
    const double offset_m =
        (at_frame->Center() - simulation.cam_from_world[i].Center()).norm();
    // 1 m a frame, 10 frames a second.
    EXPECT_NEAR(offset_m,
                scene.IsReference(scene.images[i].sensor_idx) ? 0.0 : 0.2,
                1e-9);
    EXPECT_NEAR(*scene.images[i].timestamp_s, 0.1 * scene.images[i].frame_idx,
                1e-9);
  }
}

TEST(SimulationTest, StreetsLookTheSameWhenVisitedAgain) {
  // Around a block and beyond the start.
  std::vector<Rigid3> path;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (int i = 0; i < 300; ++i) {
    const double yaw = 2.0 * kPi * i / 200.0;
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0));
    path.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    center += 1.5 * (world_from_rig * Eigen::Vector3d::UnitZ());
  }
  SimulationOptions options = StreetSimulation(RigPreset::kMono);
  options.max_num_loop_images = 3;
  const Simulation simulation = Simulate(options, path);
  std::vector<int> num_loop_pairs(simulation.scene.images.size(), 0);
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const int gap = pair.image_idx2 - pair.image_idx1;
    if (gap > options.num_matched_frames) ++num_loop_pairs[pair.image_idx2];
  }
  for (int i = 210; i < 300; ++i) {
    EXPECT_GE(num_loop_pairs[i], 1) << i;
    EXPECT_LE(num_loop_pairs[i], 3) << i;
  }
}

TEST(SimulationTest, TheRoadBehindTheStartHasPointsWhenItIsDriven) {
  // Out, back on a parallel path past the start, and back to the start.
  std::vector<Rigid3> path;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double yaw = 0.0;
  const auto drive = [&](int num_steps, double turn) {
    for (int i = 0; i < num_steps; ++i) {
      const Eigen::Quaterniond world_from_rig =
          ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0));
      path.push_back(
          Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
      center += 2.0 * (world_from_rig * Eigen::Vector3d::UnitZ());
      yaw += turn;
    }
  };
  drive(10, 0.0);
  drive(30, kPi / 30.0);
  drive(70, 0.0);
  drive(30, kPi / 30.0);
  const size_t begin_behind = path.size();
  drive(60, 0.0);
  const Simulation simulation =
      Simulate(StreetSimulation(RigPreset::kMono), path);
  ASSERT_LT(path.back().Center().norm(), 5.0);
  std::vector<int> num_matches(path.size(), 0);  // with the next image
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    if (pair.image_idx2 != pair.image_idx1 + 1) continue;
    for (const Match& match : pair.matches) {
      num_matches[pair.image_idx1] += IsRight(simulation, pair, match);
    }
  }
  num_matches.pop_back();
  std::vector<int> sorted = num_matches;
  std::sort(sorted.begin(), sorted.end());
  for (size_t i = begin_behind; i < num_matches.size(); ++i) {
    EXPECT_GE(num_matches[i], sorted[sorted.size() / 2] / 2) << i;
  }
}

TEST(SimulationTest, OptionsThatCannotBeMetTogetherAreErrors) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  options.duplicated_pair_ratio = 0.1;
  EXPECT_THROW(Simulate(options), Error);

  SimulationInput input;
  input.rig_from_world_path = {Rigid3(), Rigid3()};
  input.timestamps_s = {1.0, 1.0};
  EXPECT_THROW(Simulate({}, input), Error);
  input.timestamps_s = {1.0};
  EXPECT_THROW(Simulate({}, input), Error);
}

}  // namespace
}  // namespace mgsfm
