// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <utility>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

// A box with detectable points on its surface, which hides what is behind it.
struct TexturedBox {
  Rigid3 world_from_box;
  Eigen::Vector3d half_size_m;
  double points_per_m2;
  double reach_m;  // maximum distance at which points are detected
  // Boxes with the same look have the same points in their own frames.
  int look = -1;
  int duplicate = -1;  // index into copy_from_original, for both
  bool is_copy = false;
};

using Path = std::function<Rigid3(double time_s)>;

// A box that moves.
struct Body {
  TexturedBox box;  // its pose in the body is world_from_box
  Path world_from_body;
};

// A world without roads: what is there, and how the rigs move, in continuous
// time. The z axis of the world points up.
struct WorldPlan {
  std::vector<TexturedBox> boxes;
  std::vector<Body> bodies;
  double body_feature_ratio = 0.0;  // maximum share of features on bodies
  std::vector<Path> world_from_rigs;
  std::vector<std::pair<double, double>> sessions_s = {{0.0, 0.0}};
  std::vector<Rigid3> copy_from_original;
};

// Whether `world` has a plan, unlike scattered points and the street.
bool IsPlanned(WorldPreset world);
WorldPlan PlanWorld(WorldPreset world, uint64_t seed);

// Whether the line of sight between two points, in the frame of the box, passes
// through the box.
bool Crosses(const Eigen::Vector3d& half_size_m, const Eigen::Vector3d& begin,
             const Eigen::Vector3d& end);

}  // namespace mgsfm
