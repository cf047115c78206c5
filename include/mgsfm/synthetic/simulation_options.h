// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"

namespace mgsfm {

enum class RigPreset {
  kMono,      // one forward-facing camera
  kStereo,    // KITTI: two parallel forward-facing cameras, baseline 0.54 m
  kKitti360,  // forward stereo and two lateral fisheyes, almost no overlap
  kCube6,     // six fisheyes facing outwards, 0.1 m from a common centre
};

enum class PathPreset {
  kLoop,      // a closed circle; first and last frames observe the same points
  kCurve,     // a winding, slightly hilly road
  kStraight,  // an exactly straight line with constant orientation
  kStanding,  // no motion at all
};

enum class WorldPreset {
  // Random points around the path, all visible within max_visible_distance. For
  // small tests.
  kScatter,
  // Facades with gaps, ground, trees, parked cars and a skyline with mutual
  // occlusion. Points are detected only from near their best viewpoints.
  kStreet,
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

template <>
struct EnumTable<WorldPreset> {
  static constexpr std::pair<std::string_view, WorldPreset> kNames[] = {
      {"scatter", WorldPreset::kScatter}, {"street", WorldPreset::kStreet}};
};

// See docs/reference/simulation.md. The defaults suit small tests: exact data
// without verification. StreetSimulation() returns realistic settings.
struct SimulationOptions {
  RigPreset rig = RigPreset::kStereo;
  PathPreset path = PathPreset::kCurve;
  int num_frames = 20;
  double frame_spacing_m = 1.0;
  int frame_step = 1;
  double frame_rate_hz = 10.0;

  WorldPreset world = WorldPreset::kScatter;
  int num_points_per_frame = 300;
  double max_visible_distance_m = 30.0;
  int max_num_features_per_image = 500;
  double repeatability = 0.5;
  double clutter_ratio = 0.0;

  int num_matched_frames = 3;
  bool match_different_sensors = true;
  int num_matched_frames_across = 100000;
  int max_num_loop_images = 0;
  int min_num_matches = 15;
  double max_verification_error_px = 0.0;

  double pixel_noise_px = 0.0;
  double mismatch_ratio = 0.0;
  double epipolar_outlier_ratio = 0.0;
  double moving_feature_ratio = 0.0;
  double relative_rotation_noise_deg = 0.0;
  double wrong_pair_ratio = 0.0;
  double isolated_wrong_pair_ratio = 0.0;
  double duplicated_pair_ratio = 0.0;
  double missing_image_ratio = 0.0;
  double trigger_jitter_ms = 0.0;
  double trigger_offset_ms = 0.0;

  bool extrinsics_are_known = false;  // sets Sensor::sensor_from_rig
  uint64_t random_seed = 0;           // Context::random_seed of commands

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    DescribeDrive(self, visit);
    DescribeWorld(self, visit);
    DescribeMatching(self, visit);
    DescribeHardships(self, visit);
    DescribeWrongPairs(self, visit);
    visit("extrinsics_are_known", self.extrinsics_are_known, AnyValue(), "",
          "Write the true poses of the sensors in the rig as known.");
  }

 private:
  template <class Self, class Visitor>
  static void DescribeDrive(Self& self, Visitor& visit) {
    visit("rig", self.rig, AnyValue(), "",
          "Preset of the cameras and their poses in the rig.");
    visit("path", self.path, AnyValue(), "",
          "Preset of the trajectory of the rig.");
    visit("num_frames", self.num_frames, Between(1, 100000), "frames",
          "Number of frames of `path`.");
    visit("frame_spacing", self.frame_spacing_m, GreaterThan(0.0), "m",
          "Distance between consecutive frames of `path`.");
    visit("frame_step", self.frame_step, AtLeast(1), "",
          "Use every n-th pose of an input trajectory as a frame.");
    visit("frame_rate", self.frame_rate_hz, GreaterThan(0.0), "Hz",
          "Poses per second of a trajectory without timestamps.");
  }

  template <class Self, class Visitor>
  static void DescribeWorld(Self& self, Visitor& visit) {
    visit("world", self.world, AnyValue(), "", "Preset of the scene.");
    visit("num_points_per_frame", self.num_points_per_frame, AtLeast(1),
          "points", "Number of points around each frame of a scattered world.");
    visit("max_visible_distance", self.max_visible_distance_m, GreaterThan(1.0),
          "m",
          "Maximum distance of visible points. In a street, the skyline is "
          "always visible.");
    visit("max_num_features", self.max_num_features_per_image, AtLeast(1),
          "features", "Maximum number of features per image.");
    visit(
        "repeatability", self.repeatability, Between(0.0, 1.0), "",
        "Mean probability of detecting a visible point of a street. Scattered "
        "points are always detected.");
    visit("clutter_ratio", self.clutter_ratio, Between(0.0, 0.9), "",
          "Fraction of features that do not correspond to a world point.");
  }

  template <class Self, class Visitor>
  static void DescribeMatching(Self& self, Visitor& visit) {
    visit("num_matched_frames", self.num_matched_frames, AtLeast(0), "frames",
          "Match images up to this many frames apart, also between the ends of "
          "a closed path.");
    visit("match_different_sensors", self.match_different_sensors, AnyValue(),
          "", "Also match images of different sensors.");
    visit("num_matched_frames_across", self.num_matched_frames_across,
          Between(0, 100000), "frames",
          "Additional limit on num_matched_frames for images of different "
          "sensors.");
    visit("max_num_loop_images", self.max_num_loop_images, AtLeast(0), "images",
          "Maximum number of earlier images matched with each image of a "
          "revisited place, those with the most common points.");
    visit("min_num_matches", self.min_num_matches, AtLeast(1), "matches",
          "Minimum number of matches of an image pair.");
    visit("max_verification_error", self.max_verification_error_px,
          AtLeast(0.0), "px",
          "Maximum epipolar error of verified matches; 0 accepts all matches.");
  }

  template <class Self, class Visitor>
  static void DescribeHardships(Self& self, Visitor& visit) {
    visit("pixel_noise", self.pixel_noise_px, AtLeast(0.0), "px",
          "Standard deviation of each coordinate of the keypoints.");
    visit("mismatch_ratio", self.mismatch_ratio, Between(0.0, 1.0), "",
          "Fraction of random matches before verification.");
    visit("epipolar_outlier_ratio", self.epipolar_outlier_ratio,
          Between(0.0, 1.0), "",
          "Fraction of wrong matches that satisfy the epipolar constraint.");
    visit("moving_feature_ratio", self.moving_feature_ratio, Between(0.0, 0.9),
          "",
          "Fraction of features on moving vehicles in images that show one.");
    visit("relative_rotation_noise", self.relative_rotation_noise_deg,
          AtLeast(0.0), "deg",
          "Standard deviation, about each axis, of the error added to relative "
          "rotations.");
    visit("missing_image_ratio", self.missing_image_ratio, Between(0.0, 1.0),
          "", "Fraction of missing images.");
    visit("trigger_jitter", self.trigger_jitter_ms, AtLeast(0.0), "ms",
          "Maximum deviation of the capture time of an image from the time of "
          "its frame.");
    visit("trigger_offset", self.trigger_offset_ms, AnyValue(), "ms",
          "Delay of the images of all sensors except the first relative to "
          "their frame.");
  }

  template <class Self, class Visitor>
  static void DescribeWrongPairs(Self& self, Visitor& visit) {
    visit("wrong_pair_ratio", self.wrong_pair_ratio, Between(0.0, 1.0), "",
          "Fraction of pairs with a random relative pose and random matches.");
    visit(
        "isolated_wrong_pair_ratio", self.isolated_wrong_pair_ratio,
        Between(0.0, 0.9), "",
        "Fraction of pairs between unrelated places with a plausible relative "
        "pose and 15 to 60 consistent matches.");
    visit("duplicated_pair_ratio", self.duplicated_pair_ratio,
          Between(0.0, 0.9), "",
          "Fraction of pairs that match duplicate structures, i.e. copies of a "
          "facade, in groups of mutually consistent pairs.");
  }
};

// Realistic settings without degradations: a street with 400 features per
// image, matched and verified like a COLMAP database. Each image is matched
// with the next 10 images of its sensor, with images of other sensors within 2
// frames, and with 5 images of each revisited place.
SimulationOptions StreetSimulation(RigPreset rig);

// StreetSimulation with 0.7 px noise, 20 % mismatches, 3 % epipolar outliers,
// 10 % of the features on vehicles and 2 % isolated wrong pairs. The accuracy
// benchmarks use these settings.
SimulationOptions StandardSimulation(RigPreset rig);

// StandardSimulation with an additional 2 % of pairs of duplicate structures.
SimulationOptions AliasedSimulation(RigPreset rig);

}  // namespace mgsfm
