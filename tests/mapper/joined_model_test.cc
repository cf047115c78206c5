// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/joined_model.h"

#include <gtest/gtest.h>

#include <map>

#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Color = Eigen::Matrix<uint8_t, 3, 1>;

// Joined elsewhere, in another unit, from parts with true poses.
TEST(JoinedModelTest, HasTheWorldOfItsPartsColorsAndConfidence) {
  SimulationOptions simulated;
  simulated.num_frames = 20;
  simulated.pixel_noise_px = 0.3;
  const Simulation simulation = Simulate(simulated);
  const Scene& scene = simulation.scene;
  const Reconstruction& truth = simulation.ground_truth;
  Reconstruction joined = truth;
  TransformWorld({2.0, ExpSO3({0.1, 0.2, 0.3}), {5.0, 6.0, 7.0}}, &joined);
  std::map<Observation, Color> color_of;
  for (size_t i = 0; i < joined.points.size(); ++i) {
    Point3D& point = joined.points[i];
    point.color = Color(1 + i % 251, 1 + i % 241, 7);
    for (const Observation& o : point.track) color_of[o] = point.color;
  }
  const PositionPriors no_positions;
  const MapperResult result = AdjustJoinedModel(
      {scene, no_positions, kNoGravity, &truth}, {}, {}, std::move(joined));

  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  const MapperModel& model = result.models[0];
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    ASSERT_TRUE(model.reconstruction.rig_from_world[f]);
    // Noise of 0.3 px moves cameras by about a thousandth of the depth, 10 m.
    EXPECT_LT((model.reconstruction.rig_from_world[f]->Center() -
               truth.rig_from_world[f]->Center())
                  .norm(),
              0.05);
    EXPECT_GT(model.confidence.of_frame[f].value_or(0.0), 0.5);
  }
  EXPECT_GT(2 * model.reconstruction.points.size(), truth.points.size());
  for (const Point3D& point : model.reconstruction.points) {
    EXPECT_EQ(point.color, color_of.at(point.track.front()));
  }
}

}  // namespace
}  // namespace mgsfm
