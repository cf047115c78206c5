// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"

namespace mgsfm {

enum class RigPreset {
  kMono,         // one forward-facing camera
  kStereo,       // KITTI: two parallel forward-facing cameras, baseline 0.54 m
  kKitti360,     // forward stereo and two lateral fisheyes, almost no overlap
  kCube6,        // six fisheyes facing outwards, 0.1 m from a common center
  kSmallStereo,  // two parallel cameras, baseline 0.11 m
  kBackToBack,   // two fisheyes facing opposite directions
  kOblique,      // one camera and four that are tilted by 45 degrees
  kDome,         // eight cameras on a circle of 2 m radius that face its center
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
  // Worlds with paths of their own; see docs/reference/simulation.md.
  kHandheld,
  kStairs,
  kElevator,
  kRobot,
  kDrone,
  kDome,
  kTurntable,
  kSquare,
  kHead360,
  kCorridor,
  kSessions,
  kBoat,
  kTrain,
  kCrane,
  kTwoRigs,
  kPedestrians,
  kPole360,
  kBridge,
};

// The noise level of the matches in a world with a path of its own.
enum class NoiseLevel { kNone, kMild, kMedium };

// Presets of all simulation options; see the functions below.
enum class SimulationPreset {
  kSmall,
  kStreet,
  kStandard,
  kAliased,
  kModerate,
  kHard
};

template <>
struct EnumTable<RigPreset> {
  static constexpr std::pair<std::string_view, RigPreset> kNames[] = {
      {"mono", RigPreset::kMono},
      {"stereo", RigPreset::kStereo},
      {"kitti360", RigPreset::kKitti360},
      {"cube6", RigPreset::kCube6},
      {"small_stereo", RigPreset::kSmallStereo},
      {"back_to_back", RigPreset::kBackToBack},
      {"oblique", RigPreset::kOblique},
      {"dome", RigPreset::kDome}};
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
struct EnumTable<SimulationPreset> {
  static constexpr std::pair<std::string_view, SimulationPreset> kNames[] = {
      {"small", SimulationPreset::kSmall},
      {"street", SimulationPreset::kStreet},
      {"standard", SimulationPreset::kStandard},
      {"aliased", SimulationPreset::kAliased},
      {"moderate", SimulationPreset::kModerate},
      {"hard", SimulationPreset::kHard}};
};

template <>
struct EnumTable<WorldPreset> {
  static constexpr std::pair<std::string_view, WorldPreset> kNames[] = {
      {"scatter", WorldPreset::kScatter},
      {"street", WorldPreset::kStreet},
      {"handheld", WorldPreset::kHandheld},
      {"stairs", WorldPreset::kStairs},
      {"elevator", WorldPreset::kElevator},
      {"robot", WorldPreset::kRobot},
      {"drone", WorldPreset::kDrone},
      {"dome", WorldPreset::kDome},
      {"turntable", WorldPreset::kTurntable},
      {"square", WorldPreset::kSquare},
      {"head360", WorldPreset::kHead360},
      {"corridor", WorldPreset::kCorridor},
      {"sessions", WorldPreset::kSessions},
      {"boat", WorldPreset::kBoat},
      {"train", WorldPreset::kTrain},
      {"crane", WorldPreset::kCrane},
      {"two_rigs", WorldPreset::kTwoRigs},
      {"pedestrians", WorldPreset::kPedestrians},
      {"pole360", WorldPreset::kPole360},
      {"bridge", WorldPreset::kBridge}};
};

template <>
struct EnumTable<NoiseLevel> {
  static constexpr std::pair<std::string_view, NoiseLevel> kNames[] = {
      {"none", NoiseLevel::kNone},
      {"mild", NoiseLevel::kMild},
      {"medium", NoiseLevel::kMedium}};
};

// See docs/reference/simulation.md. The defaults suit small tests: exact data
// without verification. StreetSimulation() returns realistic settings.
struct SimulationOptions {
  Option<RigPreset> rig{"rig", RigPreset::kStereo,
                        "Choose the cameras and their poses in the rig."};
  Option<PathPreset> path{"path", PathPreset::kCurve,
                          "Choose the trajectory of the rig."};
  Option<int> num_frames{"num_frames", 20, Between(1, 100000), "frames",
                         "Simulate this many frames of `path`."};
  Option<double> frame_spacing_m{
      "frame_spacing", 1.0, GreaterThan(0.0), "m",
      "Set the distance between consecutive frames of `path`."};
  Option<int> frame_step{
      "frame_step", 1, AtLeast(1),
      "Use every n-th pose of an input trajectory as a frame."};
  Option<double> frame_rate_hz{
      "frame_rate", 10.0, GreaterThan(0.0), "Hz",
      "Set the poses per second of a trajectory without timestamps or, in a "
      "world with a path of its own, the rate at which the same motion is "
      "sampled."};
  Option<bool> time_names{
      "time_names", false,
      "Name images by their times in nanoseconds instead of frame numbers."};

  Option<WorldPreset> world{"world", WorldPreset::kScatter,
                            "Choose the scene."};
  Option<int> num_points_per_frame{
      "num_points_per_frame", 300, AtLeast(1), "points",
      "Scatter this many points around each frame of a scattered world."};
  Option<double> max_visible_distance_m{
      "max_visible_distance", 30.0, GreaterThan(1.0), "m",
      "Hide points beyond this distance. In a street, the skyline is always "
      "visible."};
  Option<int> max_num_features_per_image{
      "max_num_features", 500, AtLeast(1), "features",
      "Detect at most this many features per image."};
  Option<double> repeatability{
      "repeatability", 0.5, Between(0.0, 1.0),
      "Set the mean probability of detecting a visible point of a street. "
      "Scattered points are always detected."};
  Option<double> clutter_ratio{
      "clutter_ratio", 0.0, Between(0.0, 0.9),
      "Let this fraction of features correspond to no world point."};

  Option<int> num_matched_frames{
      "num_matched_frames", 3, AtLeast(0), "frames",
      "Match images up to this many frames apart, also between the ends of a "
      "closed path."};
  Option<bool> match_different_sensors{
      "match_different_sensors", true,
      "Also match images of different sensors."};
  Option<int> num_matched_frames_across{
      "num_matched_frames_across", 100000, Between(0, 100000), "frames",
      "Limit num_matched_frames further for images of different sensors."};
  Option<int> max_num_loop_images{
      "max_num_loop_images", 0, AtLeast(0), "images",
      "Match each image of a revisited place with at most this many earlier "
      "images, the ones with the most common points."};
  Option<int> min_num_matches{"min_num_matches", 15, AtLeast(1), "matches",
                              "Drop image pairs with fewer matches."};
  Option<double> max_verification_error_px{
      "max_verification_error", 0.0, AtLeast(0.0), "px",
      "Reject matches with a larger epipolar error. 0 accepts all matches."};

  Option<double> pixel_noise_px{
      "pixel_noise", 0.0, AtLeast(0.0), "px",
      "Set the standard deviation of each coordinate of the keypoints."};
  Option<double> keypoint_noise_tail{
      "keypoint_noise_tail", 0.0, Between(0.0, 0.5),
      "Draw keypoint noise from Student's t distribution with the inverse of "
      "this number of degrees of freedom, and let it grow with the scale of "
      "the keypoint: pixel_noise holds for the smallest. 0: normal noise."};
  Option<double> focal_length_error{
      "focal_length_error", 0.0, Between(-0.2, 0.2),
      "Set the relative error of the written focal lengths."};
  Option<double> mismatch_ratio{
      "mismatch_ratio", 0.0, Between(0.0, 1.0),
      "Set the fraction of random matches before verification."};
  Option<double> epipolar_outlier_ratio{
      "epipolar_outlier_ratio", 0.0, Between(0.0, 1.0),
      "Set the fraction of wrong matches that satisfy the epipolar "
      "constraint."};
  Option<double> moving_feature_ratio{"moving_feature_ratio", 0.0,
                                      Between(0.0, 0.9),
                                      "Set the fraction of features on moving "
                                      "vehicles in images that show one."};
  Option<double> convoy_ratio{
      "convoy_ratio", 0.0, Between(0.0, 0.9),
      "Set the fraction of the drive along which a large vehicle ahead or "
      "alongside stays at a constant distance for tens of frames."};
  Option<double> convoy_feature_ratio{
      "convoy_feature_ratio", 0.45, Between(0.0, 0.9),
      "Limit the fraction of the features of an image on such vehicles."};
  Option<int> weak_cut_spacing{
      "weak_cut_spacing", 0, AtLeast(0), "frames",
      "Set the mean number of frames between weak cuts, where the appearance "
      "of the street changes so much that few matches connect both sides. 0: "
      "no weak cuts."};
  Option<int> min_num_weak_cut_matches{
      "min_num_weak_cut_matches", 60, AtLeast(1), "matches",
      "Keep at least this many correct matches of all pairs across a weak "
      "cut."};
  Option<int> max_num_weak_cut_matches{
      "max_num_weak_cut_matches", 170, AtLeast(1), "matches",
      "Keep at most this many correct matches of all pairs across a weak cut, "
      "unless fewer than two pairs remain."};
  Option<double> relative_rotation_noise_deg{
      "relative_rotation_noise", 0.0, AtLeast(0.0), "deg",
      "Set the standard deviation, about each axis, of the error added to "
      "relative rotations."};
  Option<double> missing_image_ratio{"missing_image_ratio", 0.0,
                                     Between(0.0, 1.0),
                                     "Set the fraction of missing images."};
  Option<double> trigger_jitter_ms{
      "trigger_jitter", 0.0, AtLeast(0.0), "ms",
      "Set the maximum deviation of the capture time of an image from the time "
      "of its frame."};
  Option<double> trigger_offset_ms{"trigger_offset", 0.0, AnyValue(), "ms",
                                   "Delay the images of all sensors except the "
                                   "first relative to their frame."};
  Option<double> readout_ms{
      "readout", 0.0, AtLeast(0.0), "ms",
      "Set the time from the first to the last row of an image (rolling "
      "shutter); the middle row has the time of the image."};
  Option<double> wrong_pair_ratio{"wrong_pair_ratio", 0.0, Between(0.0, 1.0),
                                  "Set the fraction of pairs with a random "
                                  "relative pose and random matches."};
  Option<double> isolated_wrong_pair_ratio{
      "isolated_wrong_pair_ratio", 0.0, Between(0.0, 0.9),
      "Set the fraction of pairs between unrelated places with a plausible "
      "relative pose and 15 to 60 consistent matches."};
  Option<double> duplicated_pair_ratio{
      "duplicated_pair_ratio", 0.0, Between(0.0, 0.9),
      "Set the fraction of pairs that match duplicate structures, i.e. two "
      "equal facades, in groups of mutually consistent pairs."};

  Option<bool> extrinsics_are_known{
      "extrinsics_are_known", false,
      "Write the true poses of the sensors in the rig as known."};
  uint64_t random_seed = 0;  // Context::random_seed of commands

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(rig, path, num_frames, frame_spacing_m, frame_step, frame_rate_hz,
          time_names, world, num_points_per_frame, max_visible_distance_m,
          max_num_features_per_image, repeatability, clutter_ratio,
          num_matched_frames, match_different_sensors,
          num_matched_frames_across, max_num_loop_images, min_num_matches,
          max_verification_error_px, pixel_noise_px, keypoint_noise_tail,
          focal_length_error, mismatch_ratio, epipolar_outlier_ratio,
          moving_feature_ratio, convoy_ratio, convoy_feature_ratio,
          weak_cut_spacing, min_num_weak_cut_matches, max_num_weak_cut_matches,
          relative_rotation_noise_deg, missing_image_ratio, trigger_jitter_ms,
          trigger_offset_ms, readout_ms, wrong_pair_ratio,
          isolated_wrong_pair_ratio, duplicated_pair_ratio,
          extrinsics_are_known);
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

// AliasedSimulation with 0.8 px noise, 25 % mismatches, 4 % epipolar outliers,
// about 15 % of the features on vehicles, 4 % wrong pairs, 2 % missing images
// and weak cuts with duplicate structures nearby.
SimulationOptions ModerateSimulation(RigPreset rig);

// HardSimulation: AliasedSimulation with 1 px noise, 35 % mismatches, 5 %
// epipolar outliers, about 20 % of the features on vehicles, 5 % wrong pairs, 3
// % missing images and more weak cuts.
SimulationOptions HardSimulation(RigPreset rig);

// A world with a path of its own, with the rig that suits it. mild: 0.5 px
// noise with heavy tails, 10 % mismatches; medium: 25 % mismatches, 3 %
// epipolar outliers, 1 % isolated wrong pairs.
SimulationOptions WorldSimulation(WorldPreset world, NoiseLevel level);

// The options of a preset; kSmall selects the defaults.
SimulationOptions PresetSimulation(SimulationPreset preset, RigPreset rig);

}  // namespace mgsfm
