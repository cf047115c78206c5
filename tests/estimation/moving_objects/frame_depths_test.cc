// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/frame_depths.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"
#include "rotation_averaging/rotation_estimation.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

FrameDepths Measure(const Simulation& simulation, int num_threads = 1,
                    const DepthOptions& options = {0.5, 1.0}) {
  const Scene& scene = simulation.scene;
  const FramePairIndex index(scene, simulation.view_graph);
  const EstimatedRotations rotations = EstimateRotations(
      {scene, simulation.view_graph, index},
      {RotationAveragingOptions(), PairFilteringOptions()}, Context());
  return MeasureFrameDepths(
      {scene, ComputeBearings(scene, scene.cameras, 1), index,
       simulation.view_graph, simulation.view_graph, rotations.estimate},
      options, Threads(num_threads));
}

// The places of the sensors are those of the rig up to one factor. Side cameras
// share the edges of their images with the front cameras, where single frames
// have few matches.
TEST(FrameDepths, PlacesOfSensors) {
  SimulationOptions options = StandardSimulation(RigPreset::kKitti360);
  options.num_frames = 40;
  for (const uint64_t seed : {1, 2, 3}) {
    options.random_seed = seed;
    const Simulation simulation = Simulate(options);
    const FrameDepths depths = Measure(simulation);
    const auto& truth = simulation.ground_truth.sensor_from_rig;
    ASSERT_EQ(depths.cam_from_rig.size(), 4u);
    const auto offset = [](const std::optional<Rigid3>& cam1_from_rig,
                           const std::optional<Rigid3>& cam2_from_rig) {
      return (*cam2_from_rig * cam1_from_rig->Inverse()).translation;
    };
    const double scale =
        offset(truth[0], truth[1]).norm() /
        offset(depths.cam_from_rig[0], depths.cam_from_rig[1]).norm();
    for (const int sensor : {1, 2, 3}) {
      ASSERT_TRUE(depths.cam_from_rig[sensor].has_value());
      const Eigen::Vector3d error =
          scale * offset(depths.cam_from_rig[0], depths.cam_from_rig[sensor]) -
          offset(truth[0], truth[sensor]);
      EXPECT_LT(error.norm(), 0.1 * offset(truth[0], truth[sensor]).norm())
          << "sensor " << sensor << ", seed " << seed;
    }
  }
}

// A distance is off by its standard deviation, mostly.
TEST(FrameDepths, DistancesScatterWithinTheirStandardDeviations) {
  SimulationOptions options = StandardSimulation(RigPreset::kStereo);
  options.num_frames = 20;
  const Simulation simulation = Simulate(options);
  const FrameDepths depths = Measure(simulation);
  const Scene& scene = simulation.scene;
  const double baseline_m =
      simulation.ground_truth.sensor_from_rig[1]->translation.norm();
  const double baseline =
      (*depths.cam_from_rig[1] * depths.cam_from_rig[0]->Inverse())
          .translation.norm();
  int num_distances = 0, num_within = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Eigen::Vector3d center =
        simulation.cam_from_world[i].Inverse().translation;
    for (size_t k = 0; k < depths.keypoints[i].size(); ++k) {
      const int point = simulation.keypoint_points[i][k];
      const KeypointDepth* depth = depths.Find(static_cast<int>(i), k);
      if (!depth || point < 0) continue;
      const double expected =
          (simulation.world_points[point] - center).norm() / baseline_m;
      ++num_distances;
      num_within += std::abs(depth->distance / baseline / expected - 1.0) <
                    3.0 * depth->relative_sigma;
    }
  }
  EXPECT_GT(num_distances, 1000);
  EXPECT_GT(num_within, 0.9 * num_distances);
}

size_t NumDistances(const FrameDepths& depths) {
  size_t number = 0;
  for (const auto& keypoints : depths.keypoints) {
    for (const auto& depth : keypoints) number += depth ? 1 : 0;
  }
  return number;
}

// Points that are too far for the baseline have no depth, however small
// min_parallax_deg is.
TEST(FrameDepths, DepthsAreSignificant) {
  SimulationOptions options = StandardSimulation(RigPreset::kStereo);
  options.num_frames = 10;
  const Simulation simulation = Simulate(options);
  const FrameDepths precise = Measure(simulation, 1, {0.01, 1.0});
  const FrameDepths noisy = Measure(simulation, 1, {0.01, 4.0});
  for (const FrameDepths* depths : {&precise, &noisy}) {
    for (const auto& keypoints : depths->keypoints) {
      for (const auto& depth : keypoints) {
        if (!depth) continue;
        EXPECT_LE(depth->relative_sigma, 0.5 * (1.0 + 1e-9));
      }
    }
  }
  EXPECT_GT(NumDistances(noisy), 100u);
  EXPECT_LT(NumDistances(noisy), NumDistances(precise));
  EXPECT_LT(NumDistances(Measure(simulation, 1, {3.0, 1.0})),
            NumDistances(precise));
}

TEST(FrameDepths, ThreadsDoNotChangeABit) {
  SimulationOptions options = StandardSimulation(RigPreset::kKitti360);
  options.num_frames = 10;
  const Simulation simulation = Simulate(options);
  const FrameDepths one = Measure(simulation), three = Measure(simulation, 3);
  ASSERT_EQ(one.cam_from_rig.size(), three.cam_from_rig.size());
  for (size_t i = 0; i < one.cam_from_rig.size(); ++i) {
    const auto &a = one.cam_from_rig[i], &b = three.cam_from_rig[i];
    ASSERT_EQ(a.has_value(), b.has_value());
    if (!a) continue;
    EXPECT_EQ(a->rotation.coeffs(), b->rotation.coeffs());
    EXPECT_EQ(a->translation, b->translation);
  }
  for (size_t i = 0; i < one.keypoints.size(); ++i) {
    ASSERT_EQ(one.keypoints[i].size(), three.keypoints[i].size());
    for (size_t k = 0; k < one.keypoints[i].size(); ++k) {
      const auto &a = one.keypoints[i][k], &b = three.keypoints[i][k];
      ASSERT_EQ(a.has_value(), b.has_value());
      if (!a) continue;
      EXPECT_EQ(a->distance, b->distance);
      EXPECT_EQ(a->relative_sigma, b->relative_sigma);
    }
  }
}

}  // namespace
}  // namespace mgsfm
