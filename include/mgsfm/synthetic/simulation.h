// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"
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

template <>
struct EnumTable<RigPreset> {
  static constexpr std::pair<std::string_view, RigPreset> kNames[] = {
      {"mono", RigPreset::kMono},
      {"stereo", RigPreset::kStereo},
      {"kitti360", RigPreset::kKitti360},
      {"cube6", RigPreset::kCube6}};
};

template <>
struct EnumTable<PathPreset> {
  static constexpr std::pair<std::string_view, PathPreset> kNames[] = {
      {"loop", PathPreset::kLoop},
      {"curve", PathPreset::kCurve},
      {"straight", PathPreset::kStraight},
      {"standing", PathPreset::kStanding}};
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
  int num_matched_frames = 3;
  bool match_different_sensors = true;
  int min_num_matches = 15;
  double pixel_noise_px = 0.0;
  double mismatch_ratio = 0.0;
  double relative_rotation_noise_deg = 0.0;
  double wrong_pair_ratio = 0.0;
  double missing_image_ratio = 0.0;
  bool extrinsics_are_known = false;  // Sensor::sensor_from_rig is given
  uint64_t random_seed = 0;           // Context::random_seed of commands

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("rig", self.rig, AnyValue(), "", "Cameras and how they are mounted.");
    visit("path", self.path, AnyValue(), "", "Where the rig moves.");
    visit("num_frames", self.num_frames, Between(1, 100000), "frames",
          "Instants at which all cameras take an image.");
    visit("frame_spacing", self.frame_spacing_m, GreaterThan(0.0), "m",
          "Distance between two frames.");
    visit("num_points_per_frame", self.num_points_per_frame, AtLeast(1),
          "points", "World points that are added around each frame.");
    visit("max_visible_distance", self.max_visible_distance_m, GreaterThan(1.0),
          "m", "Farther points are not seen.");
    visit("max_num_features", self.max_num_features_per_image, AtLeast(1),
          "features", "Most features of an image.");
    visit("num_matched_frames", self.num_matched_frames, AtLeast(0), "frames",
          "Images are matched with those of the frames up to so many later, "
          "and across the gap of a loop.");
    visit("match_different_sensors", self.match_different_sensors, AnyValue(),
          "", "Match images of different cameras, too.");
    visit("min_num_matches", self.min_num_matches, AtLeast(1), "matches",
          "Pairs with fewer matches are left out.");
    visit("pixel_noise", self.pixel_noise_px, AtLeast(0.0), "px",
          "Standard deviation of each coordinate of the keypoints.");
    visit("mismatch_ratio", self.mismatch_ratio, Between(0.0, 1.0), "",
          "Share of wrong matches among those taken for verified.");
    visit("relative_rotation_noise", self.relative_rotation_noise_deg,
          AtLeast(0.0), "deg",
          "Standard deviation of each axis of the relative rotations.");
    visit("wrong_pair_ratio", self.wrong_pair_ratio, Between(0.0, 1.0), "",
          "Share of pairs with a random relative pose and random matches.");
    visit("missing_image_ratio", self.missing_image_ratio, Between(0.0, 1.0),
          "", "Share of images that were never taken.");
    visit("extrinsics_are_known", self.extrinsics_are_known, AnyValue(), "",
          "Write the poses of the cameras in the rig as known.");
  }
};

struct Simulation {
  Scene scene;
  ViewGraph view_graph;         // with relative_pose and E
  Reconstruction ground_truth;  // points with their true tracks
};

// Deterministic in its options.
Simulation Simulate(const SimulationOptions& options);

}  // namespace mgsfm
