// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <string>

#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {
namespace {

// The pose of a camera rotated in the rig by yaw (about the y axis, which
// points down, so positive angles turn right), then pitch and roll.
Rigid3 MountedCamera(double yaw_deg, double pitch_deg, double roll_deg,
                     const Eigen::Vector3d& center_in_rig) {
  const Eigen::Quaterniond rig_from_sensor =
      ExpSO3(Eigen::Vector3d(0.0, DegToRad(yaw_deg), 0.0)) *
      ExpSO3(Eigen::Vector3d(DegToRad(pitch_deg), 0.0, 0.0)) *
      ExpSO3(Eigen::Vector3d(0.0, 0.0, DegToRad(roll_deg)));
  return Rigid3::FromRotationAndCenter(rig_from_sensor.conjugate(),
                                       center_in_rig);
}

SimulatedCamera KittiCamera(const std::string& image_prefix,
                            const Rigid3& sensor_from_rig) {
  return {image_prefix,
          CameraModelId::kPinhole,
          1226,
          370,
          {707.0912, 707.0912, 601.8873, 183.1104},
          sensor_from_rig};
}

SimulatedCamera FisheyeCamera(const std::string& image_prefix, double focal_px,
                              int size_px, const Rigid3& sensor_from_rig) {
  const double center_px = 0.5 * size_px;
  return {image_prefix,
          CameraModelId::kOpenCVFisheye,
          size_px,
          size_px,
          {focal_px, focal_px, center_px, center_px, 0.01, -0.003, 0.0, 0.0},
          sensor_from_rig};
}

std::vector<SimulatedCamera> MakeCube() {
  std::vector<SimulatedCamera> rig;
  for (int i = 0; i < 6; ++i) {
    const double yaw_deg = 60.0 * i;
    const double yaw = DegToRad(yaw_deg);
    const Eigen::Vector3d center(0.1 * std::sin(yaw), 0.0,
                                 0.1 * (std::cos(yaw) - 1.0));
    rig.push_back(FisheyeCamera("cam" + std::to_string(i) + "/", 330.0, 1000,
                                MountedCamera(yaw_deg, 0.0, 0.0, center)));
  }
  return rig;
}

SimulatedCamera SmallCamera(int number, const Rigid3& sensor_from_rig) {
  return {
      "cam" + std::to_string(number) + "/", CameraModelId::kPinhole, 752, 480,
      {458.0, 457.0, 376.0, 240.0},         sensor_from_rig};
}

// Cameras at angles about the vertical axis of the reference camera.
std::vector<SimulatedCamera> MakeDome() {
  std::vector<SimulatedCamera> rig;
  constexpr double kRadius_m = 2.0;
  for (int i = 0; i < 8; ++i) {
    const double yaw = DegToRad(45.0 * i);
    const Eigen::Vector3d center(-kRadius_m * std::sin(yaw), 0.0,
                                 kRadius_m * (1.0 - std::cos(yaw)));
    rig.push_back(SmallCamera(i, MountedCamera(45.0 * i, 0.0, 0.0, center)));
  }
  return rig;
}

RigPreset RigOf(WorldPreset world) {
  switch (world) {
    case WorldPreset::kHead360:
    case WorldPreset::kPole360:
      return RigPreset::kBackToBack;
    case WorldPreset::kDrone:
      return RigPreset::kOblique;
    case WorldPreset::kSessions:
      return RigPreset::kKitti360;
    case WorldPreset::kDome:
      return RigPreset::kDome;
    case WorldPreset::kTrain:
    case WorldPreset::kBoat:
    case WorldPreset::kBridge:
    case WorldPreset::kCrane:
    case WorldPreset::kTwoRigs:
      return RigPreset::kStereo;
    default:
      return RigPreset::kSmallStereo;
  }
}

}  // namespace

std::vector<SimulatedCamera> MakeRig(RigPreset preset) {
  const SimulatedCamera left = KittiCamera("cam0/", Rigid3());
  const SimulatedCamera right = KittiCamera(
      "cam1/", MountedCamera(1.0, 0.3, -0.2, Eigen::Vector3d(0.5372, 0, 0)));
  switch (preset) {
    case RigPreset::kMono:
      return {left};
    case RigPreset::kStereo:
      return {left, right};
    case RigPreset::kKitti360:
      return {left, right,
              FisheyeCamera("cam2/", 430.0, 1400,
                            MountedCamera(-90.0, 2.0, 1.0, {-0.4, -0.1, -0.7})),
              FisheyeCamera("cam3/", 430.0, 1400,
                            MountedCamera(90.0, -1.0, 2.0, {0.9, -0.1, -0.7}))};
    case RigPreset::kCube6:
      return MakeCube();
    case RigPreset::kSmallStereo:
      return {SmallCamera(0, Rigid3()),
              SmallCamera(1, MountedCamera(0.5, -0.3, 0.4, {0.11, 0, 0}))};
    case RigPreset::kBackToBack:
      return {FisheyeCamera("cam0/", 330.0, 1000, Rigid3()),
              FisheyeCamera("cam1/", 330.0, 1000,
                            MountedCamera(180.0, 0.5, 0.3, {0, 0, -0.03}))};
    case RigPreset::kOblique:
      return {SmallCamera(0, Rigid3()),
              SmallCamera(1, MountedCamera(0, 45, 0, {0, -0.1, 0})),
              SmallCamera(2, MountedCamera(0, -45, 0, {0, 0.1, 0})),
              SmallCamera(3, MountedCamera(45, 0, 0, {0.1, 0, 0})),
              SmallCamera(4, MountedCamera(-45, 0, 0, {-0.1, 0, 0}))};
    case RigPreset::kDome:
      return MakeDome();
  }
  return {};
}

SimulationOptions StreetSimulation(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.world = WorldPreset::kStreet;
  options.max_visible_distance_m = 100.0;
  options.max_num_features_per_image = 400;
  options.clutter_ratio = 0.25;
  options.num_matched_frames = 10;
  options.num_matched_frames_across = 2;
  options.max_num_loop_images = 5;
  options.max_verification_error_px = 4.0;
  return options;
}

SimulationOptions StandardSimulation(RigPreset rig) {
  SimulationOptions options = StreetSimulation(rig);
  options.pixel_noise_px = 0.7;
  options.mismatch_ratio = 0.2;
  options.epipolar_outlier_ratio = 0.03;
  options.moving_feature_ratio = 0.1;
  options.isolated_wrong_pair_ratio = 0.02;
  return options;
}

SimulationOptions AliasedSimulation(RigPreset rig) {
  SimulationOptions options = StandardSimulation(rig);
  options.duplicated_pair_ratio = 0.02;
  return options;
}

SimulationOptions ModerateSimulation(RigPreset rig) {
  SimulationOptions options = AliasedSimulation(rig);
  options.pixel_noise_px = 0.8;
  options.mismatch_ratio = 0.25;
  options.epipolar_outlier_ratio = 0.04;
  options.moving_feature_ratio = 0.15;
  options.convoy_ratio = 0.3;
  options.missing_image_ratio = 0.02;
  options.weak_cut_spacing = 90;
  return options;
}

SimulationOptions HardSimulation(RigPreset rig) {
  SimulationOptions options = ModerateSimulation(rig);
  options.pixel_noise_px = 1.0;
  options.mismatch_ratio = 0.35;
  options.epipolar_outlier_ratio = 0.05;
  options.moving_feature_ratio = 0.2;
  options.convoy_ratio = 0.45;
  options.isolated_wrong_pair_ratio = 0.025;
  options.duplicated_pair_ratio = 0.025;
  options.missing_image_ratio = 0.03;
  options.weak_cut_spacing = 60;
  return options;
}

SimulationOptions PresetSimulation(SimulationPreset preset, RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  switch (preset) {
    case SimulationPreset::kSmall:
      return options;
    case SimulationPreset::kStreet:
      return StreetSimulation(rig);
    case SimulationPreset::kStandard:
      return StandardSimulation(rig);
    case SimulationPreset::kAliased:
      return AliasedSimulation(rig);
    case SimulationPreset::kModerate:
      return ModerateSimulation(rig);
    case SimulationPreset::kHard:
      return HardSimulation(rig);
  }
  return options;
}

SimulationOptions WorldSimulation(WorldPreset world, NoiseLevel level) {
  SimulationOptions options = StreetSimulation(RigOf(world));
  options.world = world;
  options.repeatability = 0.7;
  if (world == WorldPreset::kSquare) {
    options.num_matched_frames = 100000;
    options.num_matched_frames_across = 100000;
    options.max_num_loop_images = 0;
  }
  // The share of moving features is a property of the world.
  options.moving_feature_ratio = PlanWorld(world, 0).body_feature_ratio;
  if (world == WorldPreset::kStairs || world == WorldPreset::kHead360) {
    options.duplicated_pair_ratio = level == NoiseLevel::kNone ? 0.0 : 0.02;
  }
  if (level == NoiseLevel::kNone) return options;
  options.pixel_noise_px = 0.4;
  options.keypoint_noise_tail = 0.2;
  options.mismatch_ratio = 0.1;
  if (level == NoiseLevel::kMedium) {
    options.mismatch_ratio = 0.25;
    options.epipolar_outlier_ratio = 0.03;
    options.isolated_wrong_pair_ratio = 0.01;
  }
  return options;
}

}  // namespace mgsfm
