// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/partial_model.h"
#include "support/permuted_ids.h"

namespace mgsfm {
namespace {

Simulation Drive() {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 10;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.3;
  options.mismatch_ratio = 0.1;
  return Simulate(options);
}

MapperOptions FixAll() {
  MapperOptions options;
  options.bundle_adjustment.refine_rig_from_world = false;
  options.bundle_adjustment.refine_sensor_from_rig = RefineMode::kNo;
  return options;
}

Reconstruction WithoutPoints(Reconstruction model) {
  model.points.clear();
  return model;
}

MapperResult Triangulate(const Simulation& simulation,
                         const Reconstruction& start) {
  Context context;
  context.num_threads = 2;
  return TriangulatePoints(
      {simulation.scene, simulation.view_graph, {}, {}, start}, FixAll(),
      context);
}

// The largest error of points with at least 5 observations, relative to their
// distance from the nearest camera.
double LargestError(const Simulation& simulation, const Reconstruction& model) {
  double largest = 0.0;
  for (const Point3D& point : model.points) {
    if (point.track.size() < 5) continue;
    const Observation& o = point.track.front();
    const int truth = simulation.keypoint_points[o.image_idx][o.keypoint_idx];
    if (truth < 0) continue;
    double distance = 1e9;
    for (const Observation& other : point.track) {
      distance = std::min(
          distance,
          (simulation.world_points[truth] -
           model.CamFromWorld(simulation.scene, other.image_idx)->Center())
              .norm());
    }
    largest = std::max(
        largest,
        (point.point_in_world - simulation.world_points[truth]).norm() /
            distance);
  }
  return largest;
}

TEST(PointTriangulation, FindsThePointsWithFixedCameras) {
  const Simulation simulation = Drive();
  const Reconstruction start = WithoutPoints(simulation.ground_truth);
  const MapperResult result = Triangulate(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  EXPECT_EQ(MaxPoseDifference(model, start), 0.0);
  EXPECT_GT(model.points.size(), simulation.ground_truth.points.size() / 3);
  EXPECT_LT(LargestError(simulation, model), 0.15);
  for (size_t i = 0; i < start.cameras.size(); ++i) {
    EXPECT_EQ(model.cameras[i].params, start.cameras[i].params);
  }
}

TEST(PointTriangulation, IgnoresFramesThatTheModelLacks) {
  const Simulation simulation = Drive();
  const MapperResult result = Triangulate(
      simulation, WithoutFrames(simulation.scene, simulation.ground_truth,
                                [](int i) { return i >= 8; }));
  ASSERT_EQ(result.models.size(), 1u);
  ASSERT_EQ(result.unregistered_frames.size(), 2u);
  EXPECT_EQ(result.unregistered_frames[0].reason,
            "it is not in the input model");
  for (const Point3D& point : result.models[0].reconstruction.points) {
    for (const Observation& o : point.track) {
      EXPECT_LT(simulation.scene.images[o.image_idx].frame_idx, 8);
    }
  }
}

TEST(PointTriangulation, WithoutMatchesThereIsNoModel) {
  Simulation simulation = Drive();
  simulation.view_graph.pairs.clear();
  EXPECT_TRUE(Triangulate(simulation, WithoutPoints(simulation.ground_truth))
                  .models.empty());
}

}  // namespace
}  // namespace mgsfm
