// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "synthetic/cell_grid.h"
#include "synthetic/drive.h"

namespace mgsfm {

// The road below a drive, in a level frame: z is up, the unit is the metre.
// Nodes follow each other at one metre; the road goes on beyond both ends of
// the drive.
struct RoadNode {
  Eigen::Vector3d ground;
  Eigen::Vector2d heading = Eigen::Vector2d::UnitX();
  // Whether the road was here before, and whether the drive itself was, in the
  // same direction.
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
  // The nodes that the drive itself passes.
  int driven_begin() const { return extension_; }
  int driven_end() const {
    return static_cast<int>(nodes_.size()) - extension_;
  }
  // Whether any node is closer than that, horizontally.
  bool IsNear(const Eigen::Vector2d& position, double distance_m) const;

  // Distance along the road, in nodes, where the drive is at that time.
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
