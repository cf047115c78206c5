// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"

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

enum class WorldPreset {
  // Points at random on both sides of, below and above the path, all of which
  // are seen within max_visible_distance: for small tests.
  kScatter,
  // Facades with gaps, ground, trees, parked cars and a skyline, which hide
  // each other; a point is recognised from near its best viewpoint only.
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

// What docs/simulation.md explains. The defaults are for small tests, exact and
// without verification; StreetSimulation() is the realistic setting.
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
  int num_matched_frames_across = -1;
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

  bool extrinsics_are_known = false;  // Sensor::sensor_from_rig is given
  uint64_t random_seed = 0;           // Context::random_seed of commands

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    DescribeDrive(self, visit);
    DescribeWorld(self, visit);
    DescribeMatching(self, visit);
    DescribeHardships(self, visit);
    DescribeWrongPairs(self, visit);
    visit("extrinsics_are_known", self.extrinsics_are_known, AnyValue(), "",
          "Write the poses of the cameras in the rig as known.");
  }

 private:
  template <class Self, class Visitor>
  static void DescribeDrive(Self& self, Visitor& visit) {
    visit("rig", self.rig, AnyValue(), "", "Cameras and how they are mounted.");
    visit("path", self.path, AnyValue(), "", "Where the rig moves.");
    visit("num_frames", self.num_frames, Between(1, 100000), "frames",
          "Instants of `path` at which all cameras take an image.");
    visit("frame_spacing", self.frame_spacing_m, GreaterThan(0.0), "m",
          "Distance between two frames of `path`.");
    visit("frame_step", self.frame_step, AtLeast(1), "",
          "Of a given trajectory, every so many-th pose is a frame.");
    visit("frame_rate", self.frame_rate_hz, GreaterThan(0.0), "Hz",
          "Poses per second of a path or trajectory without times.");
  }

  template <class Self, class Visitor>
  static void DescribeWorld(Self& self, Visitor& visit) {
    visit("world", self.world, AnyValue(), "", "What there is to see.");
    visit("num_points_per_frame", self.num_points_per_frame, AtLeast(1),
          "points",
          "World points that are added around each frame, if scattered.");
    visit("max_visible_distance", self.max_visible_distance_m, GreaterThan(1.0),
          "m",
          "Farther points are not seen; in a street, only the skyline is.");
    visit("max_num_features", self.max_num_features_per_image, AtLeast(1),
          "features", "Most features of an image.");
    visit("repeatability", self.repeatability, Between(0.0, 1.0), "",
          "Mean probability that an image has a feature where a point of the "
          "street can be recognised. Scattered points always have.");
    visit("clutter_ratio", self.clutter_ratio, Between(0.0, 0.9), "",
          "Share of features that show no point of the world.");
  }

  template <class Self, class Visitor>
  static void DescribeMatching(Self& self, Visitor& visit) {
    visit("num_matched_frames", self.num_matched_frames, AtLeast(0), "frames",
          "Images are matched with those of the frames up to so many later, "
          "and across the gap of a loop.");
    visit("match_different_sensors", self.match_different_sensors, AnyValue(),
          "", "Match images of different cameras, too.");
    visit("num_matched_frames_across", self.num_matched_frames_across,
          AtLeast(-1), "frames",
          "The same for images of different cameras; -1: like the others.");
    visit("max_num_loop_images", self.max_num_loop_images, AtLeast(0), "images",
          "Each image is matched with at most so many earlier ones of a place "
          "that is visited again: those with the most in common.");
    visit("min_num_matches", self.min_num_matches, AtLeast(1), "matches",
          "Pairs with fewer matches are left out.");
    visit("max_verification_error", self.max_verification_error_px,
          AtLeast(0.0), "px",
          "Matches farther from the epipolar geometry do not pass; 0: all "
          "matches are taken for verified.");
  }

  template <class Self, class Visitor>
  static void DescribeHardships(Self& self, Visitor& visit) {
    visit("pixel_noise", self.pixel_noise_px, AtLeast(0.0), "px",
          "Standard deviation of each coordinate of the keypoints.");
    visit("mismatch_ratio", self.mismatch_ratio, Between(0.0, 1.0), "",
          "Share of matches, before verification, with a random keypoint.");
    visit("epipolar_outlier_ratio", self.epipolar_outlier_ratio,
          Between(0.0, 1.0), "",
          "Share of matches with a wrong keypoint on the epipolar line.");
    visit("moving_feature_ratio", self.moving_feature_ratio, Between(0.0, 0.9),
          "",
          "Share of features on vehicles: ahead and alongside at almost the "
          "same speed, and oncoming. Images without a vehicle have none.");
    visit("relative_rotation_noise", self.relative_rotation_noise_deg,
          AtLeast(0.0), "deg",
          "Standard deviation of each axis that is added to the relative "
          "rotations.");
    visit("missing_image_ratio", self.missing_image_ratio, Between(0.0, 1.0),
          "", "Share of images that were never taken.");
    visit("trigger_jitter", self.trigger_jitter_ms, AtLeast(0.0), "ms",
          "Each image is taken up to so much before or after its frame.");
    visit("trigger_offset", self.trigger_offset_ms, AnyValue(), "ms",
          "Images of all cameras but the first are taken so much after their "
          "frame.");
  }

  template <class Self, class Visitor>
  static void DescribeWrongPairs(Self& self, Visitor& visit) {
    visit("wrong_pair_ratio", self.wrong_pair_ratio, Between(0.0, 1.0), "",
          "Share of pairs that get a random relative pose and random matches.");
    visit("isolated_wrong_pair_ratio", self.isolated_wrong_pair_ratio,
          Between(0.0, 0.9), "",
          "Pairs of unrelated places, with a plausible motion that 15 to 60 "
          "matches agree with, as a share of all pairs.");
    visit("duplicated_pair_ratio", self.duplicated_pair_ratio,
          Between(0.0, 0.9), "",
          "Pairs that take a copy of a facade for the original, in groups "
          "that agree among themselves, as a share of all pairs.");
  }
};

// The realistic setting without any hardship: a street, 400 features per
// image, matched and verified as the databases of COLMAP are (each image with
// the next 10 of its camera, those of other cameras within 2 frames, and 5 of
// each place that is visited again).
SimulationOptions StreetSimulation(RigPreset rig);

// The same with 0.7 px noise, 20 % mismatches, 3 % epipolar outliers, 10 % of
// the features on vehicles, 2 % isolated wrong pairs: what accuracy is
// measured with.
SimulationOptions StandardSimulation(RigPreset rig);

// The same with a further 2 % of pairs from duplicated structures.
SimulationOptions AliasedSimulation(RigPreset rig);

}  // namespace mgsfm
