// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/simulator/simulation.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {
namespace {

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
