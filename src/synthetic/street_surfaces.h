// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "synthetic/cell_grid.h"
#include "synthetic/road.h"

namespace mgsfm {

// What stands along a road, in its level frame: upright walls (facades, sides
// of parked cars) and upright cylinders (poles, trunks, crowns of trees).
struct Surface {
  Eigen::Vector2d a;  // end of a wall, centre of a cylinder
  Eigen::Vector2d b;  // other end of a wall
  double radius_m;    // of a cylinder; 0 for walls
  double bottom_m;
  double top_m;
  // Of facades: where along the road, and on which side (1 left, -1 right).
  int node = -1;
  int side = 0;
  // The duplicated block that it belongs to, as original or as copy.
  int original_of = -1;
  int copy_of = -1;
};

struct SurfaceHit {
  double distance_m;
  int surface;
  Eigen::Vector3d normal;
};

// A facade that stands at two places.
struct Duplicate {
  Rigid3 copy_from_original;  // in the level frame
};

class StreetSurfaces {
 public:
  // Facades are built once where the drive passes several times, and leave all
  // of its ways free; some have copies elsewhere, up to `num_duplicates`.
  StreetSurfaces(const Road& road, int num_duplicates, uint64_t seed);

  const std::vector<Surface>& surfaces() const { return surfaces_; }
  const std::vector<Duplicate>& duplicates() const { return duplicates_; }

  // The nearest surface that a ray of unit direction meets.
  std::optional<SurfaceHit> Cast(const Eigen::Vector3d& origin,
                                 const Eigen::Vector3d& direction,
                                 double max_distance_m) const;

 private:
  void FillGrid();

  std::vector<Surface> surfaces_;
  std::vector<Duplicate> duplicates_;
  CellGrid grid_;
};

}  // namespace mgsfm
