// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/ground.h"

#include <algorithm>
#include <cmath>

#include "simulator/cell_walk.h"

namespace mgsfm {
namespace {

// Resolution of the height map and of the distance to the road.
constexpr double kHeightCell_m = 4.0;
constexpr double kDistanceCell_m = 1.0;
// Larger than the rounding of coordinates of 100 km.
constexpr double kMargin_m = 1e-9;

std::vector<Eigen::Vector2d> Positions(const Road& road) {
  std::vector<Eigen::Vector2d> positions;
  positions.reserve(road.nodes().size());
  for (const RoadNode& node : road.nodes()) {
    positions.emplace_back(node.ground.head<2>());
  }
  return positions;
}

// The smallest root of a t^2 + b t + c in [begin, end].
std::optional<double> FirstRoot(double a, double b, double c, double begin,
                                double end) {
  const double discriminant = b * b - 4.0 * a * c;
  if (discriminant < 0.0) return std::nullopt;
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  const double roots[] = {std::abs(a) > 0.0 ? q / a : end + 1.0,
                          std::abs(q) > 0.0 ? c / q : end + 1.0};
  std::optional<double> first;
  for (const double root : roots) {
    if (root >= begin && root <= end && (!first || root < *first)) first = root;
  }
  return first;
}

}  // namespace

Ground::Field::Field(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                     double cell_size_m)
    : grid(min, max, cell_size_m),
      values((grid.num_columns() + 1) * (grid.num_rows() + 1), 0.0) {}

Eigen::Vector2d Ground::Field::Corner(int column, int row) const {
  return grid.min() + grid.cell_size_m() * Eigen::Vector2d(column, row);
}

double Ground::Field::Interpolate(const Eigen::Vector2d& position) const {
  const int column = grid.Column(position.x()), row = grid.Row(position.y());
  const Eigen::Vector2d offset =
      (position - Corner(column, row)) / grid.cell_size_m();
  const double x = std::clamp(offset.x(), 0.0, 1.0);
  const double y = std::clamp(offset.y(), 0.0, 1.0);
  return (1.0 - y) * ((1.0 - x) * At(column, row) + x * At(column + 1, row)) +
         y * ((1.0 - x) * At(column, row + 1) + x * At(column + 1, row + 1));
}

Ground::Ground(const Road& road, const Eigen::Vector2d& min,
               const Eigen::Vector2d& max)
    : heights_(min, max, kHeightCell_m),
      road_distances_(min, max, kDistanceCell_m) {
  for (int row = 0; row <= heights_.grid.num_rows(); ++row) {
    for (int column = 0; column <= heights_.grid.num_columns(); ++column) {
      const Eigen::Vector2d corner = heights_.Corner(column, row);
      double sum = 0.0, weight_sum = 0.0;
      for (const RoadNode& node : road.nodes()) {
        const double distance =
            (node.ground.head<2>() - corner).squaredNorm() + 2.0;
        const double weight = 1.0 / (distance * distance * distance);
        sum += weight * node.ground.z();
        weight_sum += weight;
      }
      heights_.At(column, row) = sum / weight_sum;
    }
  }
  max_height_m_ =
      *std::max_element(heights_.values.begin(), heights_.values.end());

  const std::vector<Eigen::Vector2d> positions = Positions(road);
  const CellGrid nodes = CellGrid::OfPoints(positions, kMaxRoadDistance_m);
  for (int row = 0; row <= road_distances_.grid.num_rows(); ++row) {
    for (int column = 0; column <= road_distances_.grid.num_columns();
         ++column) {
      const Eigen::Vector2d corner = road_distances_.Corner(column, row);
      double& distance = road_distances_.At(column, row);
      distance = kMaxRoadDistance_m;
      nodes.ForEachNear(corner, kMaxRoadDistance_m, [&](int i) {
        distance = std::min(distance, (positions[i] - corner).norm());
      });
    }
  }
}

double Ground::HeightAt(const Eigen::Vector2d& position) const {
  return heights_.Interpolate(position);
}

double Ground::RoadDistanceAt(const Eigen::Vector2d& position) const {
  return road_distances_.Interpolate(position);
}

// Within a cell, the height of a ray above the ground is quadratic in the
// distance along the ray.
std::optional<double> Ground::MeetCell(int cell, const Eigen::Vector3d& origin,
                                       const Eigen::Vector3d& direction,
                                       double begin_m, double end_m) const {
  const CellGrid& grid = heights_.grid;
  const int row = cell / grid.num_columns();
  const int column = cell % grid.num_columns();
  const Eigen::Vector2d start =
      (origin.head<2>() - heights_.Corner(column, row)) / grid.cell_size_m();
  const Eigen::Vector2d step = direction.head<2>() / grid.cell_size_m();
  const double h = heights_.At(column, row);
  const double hx = heights_.At(column + 1, row) - h;
  const double hy = heights_.At(column, row + 1) - h;
  const double hxy = heights_.At(column + 1, row + 1) - h - hx - hy;
  const double a = -hxy * step.x() * step.y();
  const double b = direction.z() - hx * step.x() - hy * step.y() -
                   hxy * (start.x() * step.y() + start.y() * step.x());
  const double c = origin.z() - h - hx * start.x() - hy * start.y() -
                   hxy * start.x() * start.y();
  return FirstRoot(a, b, c, begin_m, end_m);
}

std::optional<double> Ground::Cast(const Eigen::Vector3d& origin,
                                   const Eigen::Vector3d& direction,
                                   double max_distance_m) const {
  // Skip the part of the ray above the highest ground.
  double skipped = 0.0;
  if (origin.z() > max_height_m_) {
    if (direction.z() >= 0.0) return std::nullopt;
    skipped = (max_height_m_ - origin.z()) / direction.z();
    if (skipped >= max_distance_m) return std::nullopt;
  }
  const Eigen::Vector3d start = origin + skipped * direction;
  const double max_rest = max_distance_m - skipped;
  CellWalk walk(heights_.grid, start.head<2>(), direction.head<2>());
  while (walk.IsInside() && walk.Entry() < max_rest) {
    const int cell = walk.Cell();
    const double begin = walk.Entry();
    walk.Next();
    // The margin avoids gaps between cells due to rounding.
    const auto rest = MeetCell(cell, start, direction, begin - kMargin_m,
                               std::min(walk.Entry(), max_rest) + kMargin_m);
    if (rest) return skipped + *rest;
  }
  return std::nullopt;
}

}  // namespace mgsfm
