// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "simulator/cell_grid.h"
#include "simulator/road.h"

namespace mgsfm {

// The ground around a road in its level frame: a height map on a square grid
// with bilinear interpolation. Heights average those of nearby nodes of the
// road.
class Ground {
 public:
  // Covers the box.
  Ground(const Road& road, const Eigen::Vector2d& min,
         const Eigen::Vector2d& max);

  double HeightAt(const Eigen::Vector2d& position) const;
  // Distance to the center line of the road, at most kMaxRoadDistance_m;
  // bilinear.
  double RoadDistanceAt(const Eigen::Vector2d& position) const;
  // Lane, kerb and pavement end at 5.4 m.
  static constexpr double kMaxRoadDistance_m = 8.0;

  // The distance at which a ray of unit direction that starts above the ground
  // intersects it.
  std::optional<double> Cast(const Eigen::Vector3d& origin,
                             const Eigen::Vector3d& direction,
                             double max_distance_m) const;

 private:
  // Values at the corners of the cells of a grid.
  struct Field {
    CellGrid grid;
    std::vector<double> values;

    Field(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
          double cell_size_m);
    Eigen::Vector2d Corner(int column, int row) const;
    double& At(int column, int row) {
      return values[row * (grid.num_columns() + 1) + column];
    }
    double At(int column, int row) const {
      return values[row * (grid.num_columns() + 1) + column];
    }
    double Interpolate(const Eigen::Vector2d& position) const;
  };

  std::optional<double> MeetCell(int cell, const Eigen::Vector3d& origin,
                                 const Eigen::Vector3d& direction,
                                 double begin_m, double end_m) const;

  Field heights_;
  Field road_distances_;
  double max_height_m_;
};

}  // namespace mgsfm
