// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/ray_grid.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {

// The motion of the rig: poses at increasing times, some of which are frames.
struct Drive {
  std::vector<Rigid3> rig_from_world;
  std::vector<double> times_s;
  std::vector<int> pose_of_frame;
  bool is_closed = false;  // the first frame follows the last one
  bool is_level = false;   // the z axis of the world points up
  int num_rigs = 1;        // they take frames in turns

  // Interpolates, and extrapolates beyond the ends, with constant velocity.
  Rigid3 PoseAt(double time_s) const;
  int num_frames() const { return static_cast<int>(pose_of_frame.size()); }
  const Rigid3& PoseOfFrame(int frame) const {
    return rig_from_world[pose_of_frame[frame]];
  }
  double TimeOfFrame(int frame) const { return times_s[pose_of_frame[frame]]; }
};

// The drive along the trajectory of `input`, or of `options` if it has none.
// Throws Error for times that do not increase or do not match the poses.
Drive MakeDrive(const SimulationOptions& options, const SimulationInput& input);

// The paths of a plan at `options.frame_rate_hz`; several rigs alternate.
Drive SamplePlan(const SimulationOptions& options, const WorldPlan& plan);

// The road below a drive in a level frame with z up, in meters. Consecutive
// nodes are one meter apart. The road extends beyond both ends of the drive.
struct RoadNode {
  Eigen::Vector3d ground;
  Eigen::Vector2d heading = Eigen::Vector2d::UnitX();
  // Whether an earlier part of the road, or of the drive in the same direction,
  // passes here.
  bool is_revisited = false;
  bool is_repeated = false;

  Eigen::Vector2d Left() const { return {-heading.y(), heading.x()}; }
};

class Road {
 public:
  Road(const Drive& drive, int extension_m);

  const Eigen::Quaterniond& level_from_world() const {
    return level_from_world_;
  }
  const std::vector<RoadNode>& nodes() const { return nodes_; }
  // Horizontal positions of the nodes.
  std::vector<Eigen::Vector2d> Positions() const;
  // The nodes passed by the drive.
  int driven_begin() const { return extension_; }
  int driven_end() const {
    return static_cast<int>(nodes_.size()) - extension_;
  }
  // Whether the horizontal distance to any node is smaller.
  bool IsNear(const Eigen::Vector2d& position, double distance_m) const;

  // Arc length at which the drive is at a time (one node is 1 m).
  double ArcAt(const Drive& drive, double time_s) const;
  // A pose on the road: origin on the ground, x to the left, y up, z ahead.
  Rigid3 WorldFromPlace(double arc_m, double left_m) const;

 private:
  void AddNodes(const std::vector<Eigen::Vector3d>& grounds,
                const Eigen::Vector2d& default_heading);
  void SetHeadings();
  void FindRevisits();

  int extension_;  // nodes beyond each end of the drive
  Eigen::Quaterniond level_from_world_;
  std::vector<RoadNode> nodes_;
  std::vector<double> arc_of_pose_;
  CellGrid grid_;
};

}  // namespace mgsfm
