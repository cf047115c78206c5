// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/ray_grid.h"
#include "simulator/road.h"

namespace mgsfm {

// Surfaces along a road in its level frame: vertical walls (facades, sides of
// parked cars) and vertical cylinders (poles, trunks and crowns of trees).
struct Surface {
  Eigen::Vector2d a;  // end of a wall, center of a cylinder
  Eigen::Vector2d b;  // other end of a wall
  double radius_m;    // of a cylinder; 0 for walls
  double bottom_m;
  double top_m;
  // The position of a facade along the road, and its side (1 left, -1 right).
  int node = -1;
  int side = 0;
  // The duplicate structure of which this surface is the original or the copy.
  int original_of = -1;
  int copy_of = -1;
};

struct SurfaceHit {
  double distance_m;
  int surface;
  Eigen::Vector3d normal;
};

class StreetSurfaces {
 public:
  // Revisited places have one set of facades, which do not block any pass of
  // the drive. At most `num_duplicates` facades are copied to other places,
  // near `preferred_nodes` of the road where possible.
  StreetSurfaces(const Road& road, int num_duplicates, uint64_t seed,
                 const std::vector<int>& preferred_nodes = {});

  const std::vector<Surface>& surfaces() const { return surfaces_; }
  // Per facade that exists at two places: copy_from_original, in the level
  // frame.
  const std::vector<Rigid3>& duplicates() const { return duplicates_; }

  // The first surface that a ray of unit direction intersects.
  std::optional<SurfaceHit> Cast(const Eigen::Vector3d& origin,
                                 const Eigen::Vector3d& direction,
                                 double max_distance_m) const;

 private:
  void FillGrid();

  std::vector<Surface> surfaces_;
  std::vector<Rigid3> duplicates_;
  CellGrid grid_;
};

}  // namespace mgsfm
