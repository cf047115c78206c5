// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/ray_grid.h"
#include "simulator/road.h"
#include "simulator/street_surfaces.h"

namespace mgsfm {

// The ground around a road in its level frame: a height map on a square grid
// with bilinear interpolation. Heights average those of nearby nodes of the
// road.
class Ground {
 public:
  // Covers the box.
  Ground(const Road& road, const Eigen::AlignedBox2d& box);

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

    Field(const Eigen::AlignedBox2d& box, double cell_size_m);
    Eigen::Vector2d Corner(int column, int row) const;
    // Sets each value to value_at(corner).
    template <class Value>
    void Fill(const Value& value_at) {
      double* value = values.data();
      for (int row = 0; row <= grid.num_rows(); ++row) {
        for (int column = 0; column <= grid.num_columns(); ++column) {
          *value++ = value_at(Corner(column, row));
        }
      }
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

// Display colors: red, green and blue in [0, 1].
using Color = Eigen::Vector3f;

// The appearance of a street: a color for each point of its surfaces. Houses,
// cars and trees have individual seeds. The camera affects only the footprint
// of its pixels.
class StreetPainter {
 public:
  // `surfaces` and `ground` must outlive this object.
  StreetPainter(const std::vector<Surface>& surfaces, const Ground& ground,
                uint64_t seed);

  Color PaintSurface(const SurfaceHit& hit, const Eigen::Vector3d& point,
                     double footprint_m) const;
  Color PaintGround(const Eigen::Vector3d& point, double footprint_m) const;
  // Sky and hills at infinity.
  Color PaintBackdrop(const Eigen::Vector3d& direction,
                      double footprint_rad) const;

 private:
  enum class Look { kHouse, kCar, kPole, kTrunk, kCrown };

  // Consecutive segments of a wall share one coat of paint.
  struct Coat {
    Look look;
    uint32_t seed;
    double begin_m;   // start of the segment along the wall
    double ground_m;  // reference level of heights
  };

  Coat FirstCoat(const Surface& surface, uint32_t number) const;
  Color PaintHouse(const Coat& coat, double u, double v,
                   double footprint_m) const;
  Color PaintCar(const Coat& coat, double length_m, double piece_u, double v,
                 double footprint_m) const;
  Color PaintPlant(const Coat& coat, double u, double v,
                   double footprint_m) const;

  const std::vector<Surface>& surfaces_;
  const Ground& ground_;
  const uint32_t seed_;
  std::vector<Coat> coats_;  // per surface
};

}  // namespace mgsfm
