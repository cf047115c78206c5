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
#include "mgsfm/synthetic/simulation_options.h"

namespace mgsfm {

// A camera of a simulated rig.
struct SimulatedCamera {
  std::string image_prefix;  // "cam0/": names its images "cam0/000000.png", ...
  CameraModelId model;
  int width_px;
  int height_px;
  std::vector<double> params;
  Rigid3 sensor_from_rig;
};

// The first camera is the reference, which is at identity.
std::vector<SimulatedCamera> MakeRig(RigPreset preset);

// What takes the place of a preset, unless it is empty.
struct SimulationInput {
  // The first camera is the reference; of options.rig.
  std::vector<SimulatedCamera> rig;
  // Poses of the reference camera (z is forward, y down on the average), of
  // which every options.frame_step-th is a frame; of options.path.
  std::vector<Rigid3> rig_from_world_path;
  // When; by default options.frame_rate_hz times a second.
  std::vector<double> timestamps_s;
};

enum class PairKind {
  kTrue,                 // the relative pose is that of the two images
  kIsolatedWrong,        // between unrelated places
  kDuplicatedStructure,  // of a group that takes a copy for the original
  kMovingObject,         // the motion relative to a vehicle that fills the view
};

struct Simulation {
  Scene scene;
  // What is verified, with E and a relative_pose: the true one if there is no
  // noise. Equal to what LoadScene makes of the database.
  ViewGraph view_graph;
  // Poses at the instants of the frames; the points that at least two images
  // show, with all keypoints that show them.
  Reconstruction ground_truth;

  // Per image: the pose at its own instant, which differs from that of
  // ground_truth by trigger jitter and offset. The times of images of the scene
  // are those of their frames.
  std::vector<Rigid3> cam_from_world;
  // Per image and keypoint: which of world_points it shows; -1 for clutter and
  // for vehicles that move. The copies of a structure are other points than the
  // originals. A match is right if and only if both keypoints show the same
  // point.
  std::vector<std::vector<int>> keypoint_points;
  std::vector<Eigen::Vector3d> world_points;
  // Per pair of the view graph.
  std::vector<PairKind> pair_kinds;
  std::vector<std::vector<Match>> raw_matches;  // before verification
};

// Deterministic in options and input, whatever context.num_threads is; of the
// context, options.random_seed takes the place of the seed. Each effect has its
// own random numbers, so that switching one on leaves the others as they were.
// Throws Error for options that cannot be met together.
Simulation Simulate(const SimulationOptions& options,
                    const SimulationInput& input = {},
                    const Context& context = {});
// On a given path.
Simulation Simulate(const SimulationOptions& options,
                    const std::vector<Rigid3>& rig_from_world_path,
                    const Context& context = {});

// The same images, poses and instants, without features, points and pairs: what
// images are rendered for.
Simulation SimulateWithoutFeatures(const SimulationOptions& options,
                                   const SimulationInput& input = {},
                                   const Context& context = {});

}  // namespace mgsfm
