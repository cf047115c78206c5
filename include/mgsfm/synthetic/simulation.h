// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

enum class RigPreset {
  kMono,      // one camera, looking ahead
  kStereo,    // KITTI's: two parallel cameras 0.54 m apart, looking ahead
  kKitti360,  // stereo ahead and two fisheyes to the sides, almost no overlap
  kCube6,     // six fisheyes around a head, 0.1 m from its centre
};

enum class PathPreset {
  kLoop,      // a closed circle; first and last frames see the same points
  kCurve,     // a winding, slightly hilly road
  kStraight,  // an exactly straight line at constant orientation
  kStanding,  // no motion at all
};

// A small world with exact ground truth, for tests and demonstrations: points
// on both sides of, below and above a path, each visible within
// `max_visible_distance_m`.
struct SimulationOptions {
  RigPreset rig = RigPreset::kStereo;
  PathPreset path = PathPreset::kCurve;
  int num_frames = 20;
  double frame_spacing_m = 1.0;
  int num_points_per_frame = 300;
  double max_visible_distance_m = 30.0;
  int max_num_features_per_image = 500;
  // Images are matched with those of the frames up to so many later (all
  // sensors with all) and, on a loop, across the gap.
  int num_matched_frames = 3;
  bool match_different_sensors = true;
  int min_num_matches = 15;

  double pixel_noise_px = 0.0;
  double mismatch_ratio = 0.0;               // of the matches kept as inliers
  double relative_rotation_noise_deg = 0.0;  // of RelativePose
  double wrong_pair_ratio = 0.0;      // pairs with a random relative pose
  double missing_image_ratio = 0.0;   // images that were never taken
  bool extrinsics_are_known = false;  // Sensor::sensor_from_rig given
  uint64_t random_seed = 0;
};

struct Simulation {
  Scene scene;
  ViewGraph view_graph;         // with relative_pose and E
  Reconstruction ground_truth;  // points with their true tracks
};

// Deterministic in its options.
Simulation Simulate(const SimulationOptions& options);

}  // namespace mgsfm
