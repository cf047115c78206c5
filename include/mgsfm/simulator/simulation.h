// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/simulator/simulation_options.h"

namespace mgsfm {

// A camera of a simulated rig.
struct SimulatedCamera {
  std::string image_prefix;  // e.g. "cam0/" for images "cam0/000000.png", ...
  CameraModelId model;
  int width_px;
  int height_px;
  std::vector<double> params;
  Rigid3 sensor_from_rig;
  int rig = 0;  // of a world with several rigs
};

// The first camera is the reference sensor with identity pose.
std::vector<SimulatedCamera> MakeRig(RigPreset preset);

// Replacements for the presets. Empty members keep the preset.
struct SimulationInput {
  // Replaces options.rig. The first camera is the reference sensor.
  std::vector<SimulatedCamera> rig;
  // Replaces options.path: poses of the reference camera in a world whose y
  // axis points down. Every options.frame_step-th pose becomes a frame.
  std::vector<Rigid3> rig_from_world_path;
  // Times of the poses. If empty, poses are 1 / options.frame_rate_hz apart.
  std::vector<double> timestamps_s;
};

enum class PairKind {
  kTrue,                 // correct relative pose
  kIsolatedWrong,        // images of unrelated places
  kDuplicatedStructure,  // matches a duplicate to its original
  kMovingObject,         // motion relative to a vehicle that dominates the view
};

struct Simulation {
  Scene scene;
  // Verified pairs with E and a relative pose, which is exact without noise.
  // Equals the result of LoadScene on the written database.
  ViewGraph view_graph;
  // Poses at the times of the frames, and the points observed by at least two
  // images with all their observations.
  Reconstruction ground_truth;

  // Per image: the pose at its capture time, which differs from ground_truth by
  // trigger jitter and offset. Timestamps in the scene are those of the frames.
  std::vector<Rigid3> cam_from_world;
  // Per image and keypoint: the index of the observed point in world_points; -1
  // for clutter and moving vehicles. Points of a duplicate structure differ
  // from those of the original. A match is correct if both keypoints observe
  // the same point.
  std::vector<std::vector<int>> keypoint_points;
  std::vector<Eigen::Vector3d> world_points;
  std::vector<PairKind> pair_kinds;  // per pair of the view graph
};

// Deterministic for given options and input, independent of
// context.num_threads. The seed is options.random_seed, not that of the
// context. Each effect draws from its own random stream, so enabling one does
// not change the others. Throws Error for contradictory options.
Simulation Simulate(const SimulationOptions& options,
                    const SimulationInput& input = {},
                    const Context& context = {});
// Simulates a drive along known poses.
Simulation Simulate(const SimulationOptions& options,
                    const std::vector<Rigid3>& rig_from_world_path,
                    const Context& context = {});

// The same images, poses and timestamps without features, points and pairs, for
// rendering.
Simulation SimulateWithoutFeatures(const SimulationOptions& options,
                                   const SimulationInput& input = {},
                                   const Context& context = {});

}  // namespace mgsfm
