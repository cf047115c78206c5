// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/track_points.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "support/translation_input.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

struct Tracks {
  void Add(const std::vector<int>& image_idxs) {
    for (const int image_idx : image_idxs) {
      tracks.observations.push_back({image_idx, 0});
      points.observation_is_used.push_back(true);
    }
    tracks.FinishGroup();
    points.point_in_world.emplace_back(Vector3d::Zero());
  }

  ObservationGroups tracks;
  TrackRays rays{tracks, {}, {}};
  TrackPoints points;
};

TEST(SelectTracksTest, LongTracksComeFirst) {
  Tracks all;
  all.Add({0, 2});
  all.Add({0, 2, 4});
  all.Add({0, 6});
  EXPECT_EQ(SelectTracks(all.rays, all.points, 8, 0),
            (std::vector<size_t>{0, 1, 2}));
  // The first track adds nothing to the second; only the third sees image 6.
  EXPECT_EQ(SelectTracks(all.rays, all.points, 8, 1),
            (std::vector<size_t>{1, 2}));
}

Positions TruePositions(const TranslationInput& input) {
  const Reconstruction& truth = input.simulation.ground_truth;
  Positions positions;
  for (const auto& pose : truth.rig_from_world) {
    positions.frame_is_placed.push_back(true);
    positions.frame_center.push_back(pose->Center());
  }
  for (const auto& pose : truth.sensor_from_rig) {
    positions.sensor_translation.push_back(pose->translation);
  }
  return positions;
}

TEST(TrackPointsTest, RaysExistWhereKeypointAndRotationDo) {
  SimulationOptions options;
  options.num_frames = 6;
  TranslationInput input = MakeTranslationInput(options);
  input.rotations.rig_from_world[2].reset();
  const Observation missing = input.tracks.observations.front();
  input.bearings.images[missing.image_idx].is_valid[missing.keypoint_idx] =
      false;
  const Scene& scene = input.simulation.scene;
  const PositionProblem problem = MakePositionProblem(scene, input.rotations);
  const TrackRays rays =
      ComputeTrackRays(problem, input.bearings, input.tracks, 2);
  size_t num_rays = 0;
  for (size_t k = 0; k < input.tracks.observations.size(); ++k) {
    const Observation& o = input.tracks.observations[k];
    const bool is_missing = o.image_idx == missing.image_idx &&
                            o.keypoint_idx == missing.keypoint_idx;
    const bool expected =
        scene.images[o.image_idx].frame_idx != 2 && !is_missing;
    EXPECT_EQ(rays.has_ray[k], expected);
    if (!expected) continue;
    ++num_rays;
    EXPECT_NEAR(rays.rays_in_world[k].norm(), 1.0, 1e-12);
  }
  EXPECT_EQ(rays.has_ray.Count(), num_rays);
  EXPECT_GT(num_rays, 100u);
}

// Exact rays give the true points, and these give a missing frame its place.
TEST(TrackPointsTest, TruePositionsGiveTruePointsAndBack) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.num_frames = 8;
  const TranslationInput input = MakeTranslationInput(options);
  const PositionProblem problem =
      MakePositionProblem(input.simulation.scene, input.rotations);
  const TrackRays rays =
      ComputeTrackRays(problem, input.bearings, input.tracks, 2);
  const Positions truth = TruePositions(input);
  TrackPointOptions point_options;
  point_options.max_error_rad = 1e-3;
  point_options.min_angle_rad = 5e-3;
  const TrackPoints points =
      TriangulateTracks(problem, rays, truth, point_options, 2);
  size_t num_points = 0;
  const auto& true_points = input.simulation.ground_truth.points;
  for (size_t t = 0; t < true_points.size(); ++t) {
    if (!points.point_in_world[t]) continue;
    ++num_points;
    EXPECT_LT(
        (*points.point_in_world[t] - true_points[t].point_in_world).norm(),
        1e-6);
  }
  EXPECT_GT(num_points, true_points.size() / 2);
  Positions without = truth;
  without.frame_is_placed[3] = false;
  without.frame_center[3].setConstant(1e3);
  const FramePlacement placement =
      PlaceFramesByPoints(problem, rays, points, 1e-3, 2, without);
  EXPECT_EQ(placement.num_placed, 1);
  EXPECT_TRUE(placement.positions.frame_is_placed[3]);
  EXPECT_LT(
      (placement.positions.frame_center[3] - truth.frame_center[3]).norm(),
      1e-6);
}

}  // namespace
}  // namespace mgsfm
