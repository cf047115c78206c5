// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "simulator/cell_grid.h"
#include "simulator/drive.h"

namespace mgsfm {

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
