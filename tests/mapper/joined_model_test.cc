// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/joined_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "base/random.h"
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

// Beside a finished map with the true poses of the first and last frames.
class FinishedMapTest : public testing::Test {
 protected:
  static constexpr size_t kNumFrames = 30;
  FinishedMapTest() : existing_(kNumFrames, true) {
    existing_.Fill(10, 20, false);
  }
  static Simulation SimulateCurve() {
    SimulationOptions options;
    options.num_frames = kNumFrames;
    options.pixel_noise_px = 0.3;
    Simulation simulation = Simulate(options);
    for (size_t i = 0; i < simulation.scene.sensors.size(); ++i) {
      simulation.scene.sensors[i].sensor_from_rig =
          simulation.ground_truth.sensor_from_rig[i];
    }
    return simulation;
  }
  // The root mean square error of the centers of the new frames.
  double ErrorOf(const Reconstruction& model) const {
    double sum = 0.0;
    for (size_t f = 10; f < 20; ++f) {
      sum += (model.rig_from_world[f]->Center() -
              simulation_.ground_truth.rig_from_world[f]->Center())
                 .squaredNorm();
    }
    return std::sqrt(sum / 10.0);
  }
  // Beside the map, or everything in the world of the map.
  MapperModel Adjust(Reconstruction joined, bool is_beside) const {
    const PositionPriors no_positions;
    Reconstruction map = joined;
    for (size_t f = 0; f < kNumFrames; ++f) {
      if (!existing_[f]) map.rig_from_world[f].reset();
    }
    JoinedModel input{simulation_.scene, no_positions, kNoGravity};
    if (is_beside) {
      input.existing_frames = existing_;
    } else {
      input.parts = &map;
    }
    MapperResult result = AdjustJoinedModel(input, {}, {}, std::move(joined));
    EXPECT_EQ(result.models.size(), 1u);
    return std::move(result.models[0]);
  }
  bool IsFinished(const Point3D& point) const {
    return std::all_of(
        point.track.begin(), point.track.end(), [&](const Observation& o) {
          return existing_[simulation_.scene.images[o.image_idx].frame_idx];
        });
  }

  const Simulation simulation_ = SimulateCurve();
  Mask existing_;
};

TEST_F(FinishedMapTest, StaysAsItIs) {
  Reconstruction joined = simulation_.ground_truth;
  Random random(1);
  for (size_t f = 0; f < kNumFrames; ++f) {
    if (existing_[f]) continue;
    Rigid3& pose = *joined.rig_from_world[f];
    pose = Rigid3::FromRotationAndCenter(
        pose.rotation,
        pose.Center() + 0.05 * Eigen::Vector3d(random.Normal(), random.Normal(),
                                               random.Normal()));
  }
  const MapperModel model = Adjust(joined, true);
  ASSERT_TRUE(model.finished_map && model.finished_map->frames_are_fixed);
  EXPECT_EQ(model.finished_map->num_existing_frames, 20);
  const Reconstruction& beside = model.reconstruction;
  for (size_t f = 0; f < kNumFrames; ++f) {
    if (!existing_[f]) continue;
    const Rigid3 &before = *joined.rig_from_world[f],
                 &after = *beside.rig_from_world[f];
    EXPECT_EQ(after.rotation.coeffs(), before.rotation.coeffs()) << f;
    EXPECT_EQ(after.translation, before.translation) << f;
  }
  std::map<std::vector<Observation>, Eigen::Vector3d> points;
  for (const Point3D& p : beside.points) {
    points.emplace(p.track, p.point_in_world);
  }
  for (const Point3D& point : joined.points) {
    if (!IsFinished(point)) continue;
    ASSERT_EQ(points.count(point.track), 1u);
    EXPECT_EQ(points.at(point.track), point.point_in_world);
  }
  // The map is true, so that the new frames are no worse beside it.
  const MapperModel all = Adjust(joined, false);
  EXPECT_FALSE(all.finished_map);
  EXPECT_LE(ErrorOf(beside), ErrorOf(all.reconstruction));
  EXPECT_EQ(model.bundle.weak_frame_idxs, all.bundle.weak_frame_idxs);
  EXPECT_EQ(model.bundle.sensor_idxs_without_observations,
            all.bundle.sensor_idxs_without_observations);
}

// None of the new points is seen by most frames of the map.
TEST_F(FinishedMapTest, FramesWithoutNewPointsAreNotWeak) {
  existing_.Fill(10, 20, true);
  existing_.Fill(29, 30, false);
  const MapperModel model = Adjust(simulation_.ground_truth, true);
  ASSERT_TRUE(model.finished_map && model.finished_map->frames_are_fixed);
  EXPECT_TRUE(model.bundle.weak_frame_idxs.empty());
  EXPECT_TRUE(model.bundle.sensor_idxs_without_observations.empty());
}

// The last frames and their points are 0.1 m from where the first ones and the
// frames between see them, about ten standard deviations.
TEST_F(FinishedMapTest, IsAdjustedIfNewFramesContradictIt) {
  const Eigen::Vector3d shift(0.0, 0.0, 0.1);
  Reconstruction joined = simulation_.ground_truth;
  for (size_t f = 20; f < kNumFrames; ++f) {
    Rigid3& pose = *joined.rig_from_world[f];
    pose = Rigid3::FromRotationAndCenter(pose.rotation, pose.Center() + shift);
  }
  for (Point3D& point : joined.points) {
    const Observation& first = point.track.front();
    if (simulation_.scene.images[first.image_idx].frame_idx >= 20) {
      point.point_in_world += shift;
    }
  }
  const MapperModel model = Adjust(joined, true);
  ASSERT_TRUE(model.finished_map);
  EXPECT_FALSE(model.finished_map->frames_are_fixed);
  EXPECT_GT(model.finished_map->bend.value(), 1.0);
  const MapperModel all = Adjust(joined, false);
  for (size_t f = 0; f < kNumFrames; ++f) {
    // The order of points changes only rounding, to which solves that stop at
    // a relative change of the cost of 1e-6 add as much.
    EXPECT_LT((model.reconstruction.rig_from_world[f]->Center() -
               all.reconstruction.rig_from_world[f]->Center())
                  .norm(),
              1e-3 * shift.norm());
  }
}

}  // namespace
}  // namespace mgsfm
