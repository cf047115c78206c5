// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <vector>

#include "mgsfm/simulator/simulation.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {
namespace {

SimulationOptions Slow(WorldPreset world, NoiseLevel level) {
  SimulationOptions options = WorldSimulation(world, level);
  options.frame_rate_hz = 1.0;
  return options;
}

class WorldsTest : public testing::TestWithParam<WorldPreset> {};

TEST_P(WorldsTest, TruthProjectsToKeypointsWithoutNoise) {
  const Simulation simulation = Simulate(Slow(GetParam(), NoiseLevel::kNone));
  ASSERT_GT(simulation.view_graph.pairs.size(), 0);
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const Image& image = simulation.scene.images[i];
    const Camera& camera = simulation.ground_truth.cameras[image.camera_idx];
    for (size_t j = 0; j < image.keypoints_px.size(); ++j) {
      const int point = simulation.keypoint_points[i][j];
      if (point < 0) continue;
      const auto pixel = ProjectToPixel(
          camera.model, camera.params.data(),
          simulation.cam_from_world[i] * simulation.world_points[point]);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_LT((*pixel - image.keypoints_px[j].cast<double>()).norm(), 1e-3);
    }
  }
}

TEST_P(WorldsTest, SeedDecides) {
  SimulationOptions options = Slow(GetParam(), NoiseLevel::kMedium);
  const Simulation first = Simulate(options), again = Simulate(options);
  options.random_seed = 1;
  const Simulation other = Simulate(options);
  ASSERT_EQ(first.scene.images.size(), again.scene.images.size());
  for (size_t i = 0; i < first.scene.images.size(); ++i) {
    EXPECT_EQ(first.scene.images[i].keypoints_px,
              again.scene.images[i].keypoints_px);
  }
  EXPECT_NE(first.scene.images[0].keypoints_px,
            other.scene.images[0].keypoints_px);
}

TEST_P(WorldsTest, RatesSampleTheSameMotion) {
  SimulationOptions options = Slow(GetParam(), NoiseLevel::kNone);
  const auto poses_of = [](const Simulation& simulation) {
    std::map<std::pair<int, double>, Eigen::Vector3d> centers;
    for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
      const Image& image = simulation.scene.images[i];
      centers[{image.sensor_idx, *image.timestamp_s}] =
          simulation.cam_from_world[i].Center();
    }
    return centers;
  };
  const auto slow = poses_of(SimulateWithoutFeatures(options));
  options.frame_rate_hz = 3.0;  // an odd factor, so that rigs keep their turns
  const auto fast = poses_of(SimulateWithoutFeatures(options));
  int num_common = 0;
  for (const auto& [key, center] : slow) {
    for (const auto& [other_key, other] : fast) {
      if (key.first == other_key.first &&
          std::abs(key.second - other_key.second) < 1e-9) {
        EXPECT_LT((center - other).norm(), 1e-9);
        ++num_common;
      }
    }
  }
  EXPECT_EQ(num_common, slow.size());
}

std::vector<WorldPreset> AllWorlds() {
  std::vector<WorldPreset> worlds;
  for (const auto& [name, world] : EnumTable<WorldPreset>::kNames) {
    if (IsPlanned(world)) worlds.push_back(world);
  }
  return worlds;
}

INSTANTIATE_TEST_SUITE_P(All, WorldsTest, testing::ValuesIn(AllWorlds()));

TEST(WorldPlanTest, NoRigMovesThroughABox) {
  for (const WorldPreset world : AllWorlds()) {
    // The pictures of a square are taken at random places.
    if (world == WorldPreset::kSquare) continue;
    for (uint64_t seed = 0; seed < 20; ++seed) {
      const WorldPlan plan = PlanWorld(world, seed);
      for (const auto& [begin_s, end_s] : plan.sessions_s) {
        for (double time_s = begin_s; time_s < end_s; time_s += 0.1) {
          for (const Path& world_from_rig : plan.world_from_rigs) {
            const Eigen::Vector3d rig_in_world =
                world_from_rig(time_s).translation;
            for (const TexturedBox& box : plan.boxes) {
              const Eigen::Vector3d rig_in_box =
                  box.world_from_box.Inverse() * rig_in_world;
              EXPECT_FALSE(
                  (rig_in_box.cwiseAbs().array() < box.half_size_m.array())
                      .all())
                  << EnumName(world) << ", seed " << seed << ", " << time_s
                  << " s, box " << box.look;
            }
          }
        }
      }
    }
  }
}

TEST(WorldPlanTest, HullKeepsItsRays) {
  const WorldPlan plan = PlanWorld(WorldPreset::kTrain, 0);
  ASSERT_FALSE(plan.bodies.empty());
  for (const Body& body : plan.bodies) {
    const auto rig_from_body = [&](double time_s) {
      return plan.world_from_rigs[0](time_s).Inverse() *
             body.world_from_body(time_s);
    };
    for (const double time_s : {0.1, 7.0, 20.0}) {
      const Rigid3 change =
          rig_from_body(time_s) * rig_from_body(0.0).Inverse();
      EXPECT_LT(change.translation.norm(), 1e-9);
      EXPECT_LT(change.rotation.vec().norm(), 1e-9);
    }
  }
}

}  // namespace
}  // namespace mgsfm
