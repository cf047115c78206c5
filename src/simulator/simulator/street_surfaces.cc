// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_surfaces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "simulator/cell_walk.h"
#include "simulator/street_builder.h"

namespace mgsfm {
namespace {

// The grid in which rays look for surfaces; it does not change what they meet.
constexpr double kCell_m = 5.0;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The distance at which a ray intersects a surface; nullopt if it does not.
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

}  // namespace

StreetSurfaces::StreetSurfaces(const Road& road, int num_duplicates,
                               uint64_t seed,
                               const std::vector<int>& preferred_nodes)
    : surfaces_(BuildStreet(road, seed)),
      duplicates_(DuplicateFacades(road, num_duplicates, preferred_nodes, seed,
                                   &surfaces_)),
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
