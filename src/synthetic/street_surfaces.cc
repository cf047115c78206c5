// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/street_surfaces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "synthetic/street_builder.h"

namespace mgsfm {
namespace {

constexpr double kCell_m = 5.0;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Where a ray meets a surface, as distance; nothing if it passes it by.
std::optional<double> Meet(const Surface& surface,
                           const Eigen::Vector3d& origin,
                           const Eigen::Vector3d& direction) {
  const Eigen::Vector2d o = origin.head<2>();
  const Eigen::Vector2d d = direction.head<2>();
  double distance = kInfinity;
  if (surface.radius_m == 0.0) {
    const Eigen::Vector2d wall = surface.b - surface.a;
    const Eigen::Vector2d offset = surface.a - o;
    const double cross = d.x() * wall.y() - d.y() * wall.x();
    if (std::abs(cross) < 1e-12) return std::nullopt;
    const double along = (offset.x() * d.y() - offset.y() * d.x()) / cross;
    if (along < 0.0 || along > 1.0) return std::nullopt;
    distance = (offset.x() * wall.y() - offset.y() * wall.x()) / cross;
  } else {
    const Eigen::Vector2d offset = o - surface.a;
    const double a = d.squaredNorm();
    const double b = offset.dot(d);
    const double c = offset.squaredNorm() - surface.radius_m * surface.radius_m;
    const double discriminant = b * b - a * c;
    if (a < 1e-12 || discriminant < 0.0) return std::nullopt;
    distance = (-b - std::sqrt(discriminant)) / a;
  }
  if (distance <= 0.0) return std::nullopt;
  const double height = origin.z() + distance * direction.z();
  if (height < surface.bottom_m || height > surface.top_m) return std::nullopt;
  return distance;
}

Eigen::Vector3d NormalAt(const Surface& surface, const Eigen::Vector3d& point,
                         const Eigen::Vector3d& direction) {
  Eigen::Vector2d normal = point.head<2>() - surface.a;
  if (surface.radius_m == 0.0) {
    const Eigen::Vector2d wall = surface.b - surface.a;
    normal = Eigen::Vector2d(-wall.y(), wall.x());
  }
  normal.normalize();
  if (normal.dot(direction.head<2>()) > 0.0) normal = -normal;
  return {normal.x(), normal.y(), 0.0};
}

struct Box {
  Eigen::Vector2d min, max;
};

Box BoxOf(const Surface& surface) {
  const Eigen::Vector2d margin(surface.radius_m, surface.radius_m);
  return {surface.a.cwiseMin(surface.b) - margin,
          surface.a.cwiseMax(surface.b) + margin};
}

CellGrid MakeGrid(const std::vector<Surface>& surfaces) {
  Box box{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  for (size_t i = 0; i < surfaces.size(); ++i) {
    const Box added = BoxOf(surfaces[i]);
    box.min = i == 0 ? added.min : box.min.cwiseMin(added.min);
    box.max = i == 0 ? added.max : box.max.cwiseMax(added.max);
  }
  return CellGrid(box.min, box.max, kCell_m);
}

// The cells of a grid that a ray passes, in order (Amanatides and Woo, A fast
// voxel traversal algorithm for ray tracing, 1987).
class CellWalk {
 public:
  CellWalk(const CellGrid& grid, const Eigen::Vector2d& origin,
           const Eigen::Vector2d& direction)
      : grid_(grid) {
    const int sizes[] = {grid.num_columns(), grid.num_rows()};
    double begin = 0.0, end = kInfinity;
    for (int axis = 0; axis < 2; ++axis) {
      const double low = grid.min()[axis];
      const double high = low + sizes[axis] * grid.cell_size_m();
      Clip(low - origin[axis], high - origin[axis], direction[axis], &begin,
           &end);
    }
    is_inside_ = begin < end;
    entry_ = begin;
    const Eigen::Vector2d start = origin + begin * direction;
    cell_[0] = grid.Column(start.x());
    cell_[1] = grid.Row(start.y());
    for (int axis = 0; axis < 2; ++axis) {
      step_[axis] = direction[axis] > 0.0 ? 1 : -1;
      const double border =
          grid.min()[axis] +
          (cell_[axis] + (step_[axis] > 0 ? 1 : 0)) * grid.cell_size_m();
      const bool is_parallel = std::abs(direction[axis]) < 1e-12;
      next_[axis] =
          is_parallel ? kInfinity : (border - origin[axis]) / direction[axis];
      delta_[axis] = is_parallel
                         ? kInfinity
                         : grid.cell_size_m() / std::abs(direction[axis]);
    }
  }

  bool IsInside() const { return is_inside_; }
  int Cell() const { return grid_.Cell(cell_[0], cell_[1]); }
  double Entry() const { return entry_; }  // distance where the cell begins

  void Next() {
    const int axis = next_[0] < next_[1] ? 0 : 1;
    entry_ = next_[axis];
    next_[axis] += delta_[axis];
    cell_[axis] += step_[axis];
    const int size = axis == 0 ? grid_.num_columns() : grid_.num_rows();
    is_inside_ = entry_ < kInfinity && cell_[axis] >= 0 && cell_[axis] < size;
  }

 private:
  static void Clip(double low, double high, double slope, double* begin,
                   double* end) {
    if (std::abs(slope) < 1e-12) {
      if (low > 0.0 || high < 0.0) *end = -kInfinity;
      return;
    }
    const double t1 = low / slope, t2 = high / slope;
    *begin = std::max(*begin, std::min(t1, t2));
    *end = std::min(*end, std::max(t1, t2));
  }

  const CellGrid& grid_;
  int cell_[2];
  int step_[2];
  double next_[2];
  double delta_[2];
  double entry_;
  bool is_inside_;
};

}  // namespace

StreetSurfaces::StreetSurfaces(const Road& road, int num_duplicates,
                               uint64_t seed)
    : surfaces_(BuildStreet(road, seed)),
      duplicates_(DuplicateFacades(road, num_duplicates, seed, &surfaces_)),
      grid_(MakeGrid(surfaces_)) {
  FillGrid();
}

void StreetSurfaces::FillGrid() {
  std::vector<std::pair<int, int>> items;
  for (size_t i = 0; i < surfaces_.size(); ++i) {
    const Box box = BoxOf(surfaces_[i]);
    for (int row = grid_.Row(box.min.y()); row <= grid_.Row(box.max.y());
         ++row) {
      for (int column = grid_.Column(box.min.x());
           column <= grid_.Column(box.max.x()); ++column) {
        items.emplace_back(grid_.Cell(column, row), static_cast<int>(i));
      }
    }
  }
  grid_.Fill(items);
}

std::optional<SurfaceHit> StreetSurfaces::Cast(const Eigen::Vector3d& origin,
                                               const Eigen::Vector3d& direction,
                                               double max_distance_m) const {
  double nearest = max_distance_m;
  int surface = -1;
  for (CellWalk walk(grid_, origin.head<2>(), direction.head<2>());
       walk.IsInside() && walk.Entry() < nearest; walk.Next()) {
    for (const int* item = grid_.begin(walk.Cell());
         item != grid_.end(walk.Cell()); ++item) {
      const auto distance = Meet(surfaces_[*item], origin, direction);
      if (!distance || *distance >= nearest) continue;
      nearest = *distance;
      surface = *item;
    }
  }
  if (surface < 0) return std::nullopt;
  return SurfaceHit{
      nearest, surface,
      NormalAt(surfaces_[surface], origin + nearest * direction, direction)};
}

}  // namespace mgsfm
