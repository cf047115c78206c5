// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_surfaces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "simulator/random_streams.h"
#include "simulator/ray_grid.h"

namespace mgsfm {
namespace {

// Minimum distances of facades and street furniture to the path of the drive.
constexpr double kFacadeClearance_m = 4.5;
constexpr double kFurnitureClearance_m = 2.2;
// Dimensions of the simulated street, here and in the functions below. They
// only need to be plausible. Nodes are one meter apart.
constexpr double kFoundation_m = 2.0;
constexpr double kBuildingDepth_m = 8.0;
constexpr double kGapProbability = 0.35;

// Facades with gaps, parked cars, trees and poles along a road.
class StreetBuilder {
 public:
  StreetBuilder(const Road& road, uint64_t seed) : road_(road), seed_(seed) {}

  std::vector<Surface> Build() {
    for (const int side : {-1, 1}) {
      BuildFacades(side);
      PlaceFurniture(side);
    }
    return std::move(surfaces_);
  }

 private:
  // A segment with one house, or a gap.
  struct Block {
    bool is_gap = true;
    double offset_m = 0.0;
    double height_m = 0.0;
    int num_nodes_left = 0;
  };

  void BuildFacades(int side) {
    Random random = RandomOf(seed_, Effect::kFacades, side + 1);
    const std::vector<RoadNode>& nodes = road_.nodes();
    Block block;
    for (size_t i = 0; i + 1 < nodes.size(); ++i) {
      const int node = static_cast<int>(i);
      const bool can_build = !nodes[i].is_revisited;
      if (!can_build || block.num_nodes_left == 0) {
        if (!block.is_gap) AddEndWalls(node, side, block);
        block = can_build ? MakeBlock(block.is_gap, &random) : Block();
        if (!block.is_gap) AddEndWalls(node, side, block);
      }
      if (!can_build) continue;
      --block.num_nodes_left;
      if (block.is_gap) continue;
      const Eigen::Vector2d a = Beside(node, side, block.offset_m);
      const Eigen::Vector2d b = Beside(node + 1, side, block.offset_m);
      // The inner side of a narrow bend would fold back.
      if ((b - a).dot(nodes[i].heading) < 0.2) continue;
      const size_t num_before = surfaces_.size();
      AddWall(a, b, nodes[i].ground.z(), block.height_m, kFacadeClearance_m);
      if (surfaces_.size() == num_before) continue;
      surfaces_.back().node = node;
      surfaces_.back().side = side;
    }
  }

  Block MakeBlock(bool was_gap, Random* random) const {
    Block block;
    block.is_gap = !was_gap && random->Uniform() < kGapProbability;
    if (block.is_gap) {
      block.num_nodes_left = static_cast<int>(random->Uniform(3.0, 14.0));
    } else {
      block.num_nodes_left = static_cast<int>(random->Uniform(8.0, 30.0));
      block.offset_m = random->Uniform(5.5, 14.0);
      block.height_m = random->Uniform(4.0, 11.0);
    }
    return block;
  }

  void AddEndWalls(int node, int side, const Block& block) {
    // A wall is left out as a whole if its center is near the road.
    constexpr double kPiece_m = 2.0;
    for (double depth = 0.0; depth < kBuildingDepth_m; depth += kPiece_m) {
      AddWall(Beside(node, side, block.offset_m + depth),
              Beside(node, side, block.offset_m + depth + kPiece_m),
              road_.nodes()[node].ground.z(), block.height_m,
              kFacadeClearance_m);
    }
  }

  void PlaceFurniture(int side) {
    constexpr int kCarNodes = 6;  // a car and a gap
    Random random = RandomOf(seed_, Effect::kStreetFurniture, side + 1);
    const std::vector<RoadNode>& nodes = road_.nodes();
    int next_car = 0;
    for (size_t i = 0; i + 5 < nodes.size(); ++i) {
      const double kind = random.Uniform();
      const double offset = random.Uniform();
      if (nodes[i].is_revisited) continue;
      const int node = static_cast<int>(i);
      const double ground = nodes[i].ground.z();
      if (kind < 0.06 && node >= next_car) {
        AddParkedCar(node, side, 3.0 + offset);
        next_car = node + kCarNodes;
      } else if (kind > 0.96) {
        const Eigen::Vector2d center = Beside(node, side, 3.5 + 2.0 * offset);
        AddCylinder(center, 0.2, ground - kFoundation_m, ground + 3.0);
        AddCylinder(center, 1.5 + offset, ground + 2.8, ground + 7.0);
      } else if (kind > 0.91) {
        AddCylinder(Beside(node, side, 3.2 + 1.5 * offset), 0.1,
                    ground - kFoundation_m, ground + 3.0 + 3.0 * offset);
      }
    }
  }

  void AddParkedCar(int node, int side, double offset_m) {
    constexpr int kLength = 4;
    constexpr double kWidth_m = 1.8;
    constexpr double kHeight_m = 1.45;
    const double ground = road_.nodes()[node].ground.z();
    const Eigen::Vector2d corners[] = {
        Beside(node, side, offset_m), Beside(node + kLength, side, offset_m),
        Beside(node + kLength, side, offset_m + kWidth_m),
        Beside(node, side, offset_m + kWidth_m)};
    for (int i = 0; i < 4; ++i) {
      AddWall(corners[i], corners[(i + 1) % 4], ground, kHeight_m,
              kFurnitureClearance_m);
    }
  }

  void AddWall(const Eigen::Vector2d& a, const Eigen::Vector2d& b,
               double ground_m, double height_m, double clearance_m) {
    if (road_.IsNear(0.5 * (a + b), clearance_m)) return;
    surfaces_.push_back(
        {a, b, 0.0, ground_m - kFoundation_m, ground_m + height_m});
  }

  void AddCylinder(const Eigen::Vector2d& center, double radius_m,
                   double bottom_m, double top_m) {
    if (road_.IsNear(center, kFurnitureClearance_m)) return;
    surfaces_.push_back({center, center, radius_m, bottom_m, top_m});
  }

  Eigen::Vector2d Beside(int node, int side, double offset_m) const {
    const RoadNode& at = road_.nodes()[node];
    return at.ground.head<2>() + side * offset_m * at.Left();
  }

  const Road& road_;
  const uint64_t seed_;
  std::vector<Surface> surfaces_;
};

// Length of duplicate structures in meters, and how many fit along a road.
constexpr int kMinBlockNodes = 18;
constexpr int kMaxBlockNodes = 30;
constexpr double kMinFacadeShare = 0.5;
constexpr int kNodesPerDuplicate = 120, kNodesPerDuplicateAtCuts = 60;

// The first and last node of a straight segment of road.
bool IsStraight(const Road& road, int begin, int size) {
  const std::vector<RoadNode>& nodes = road.nodes();
  const double min_cos = std::cos(DegToRad(6.0));
  for (int i = begin; i < begin + size; ++i) {
    if (nodes[i].is_revisited ||
        nodes[i].heading.dot(nodes[begin + size / 2].heading) < min_cos) {
      return false;
    }
  }
  return true;
}

// The pose of the center of a segment, with x forward and y to the left.
Rigid3 LevelFromMiddle(const Road& road, int begin, int size) {
  const RoadNode& node = road.nodes()[begin + size / 2];
  const double yaw = std::atan2(node.heading.y(), node.heading.x());
  return {ExpSO3(yaw * Eigen::Vector3d::UnitZ()), node.ground};
}

// Counts facades only.
bool IsOfStretch(const Surface& surface, int begin, int size) {
  return surface.side != 0 && surface.node >= begin &&
         surface.node < begin + size;
}

int NumFacades(const std::vector<Surface>& surfaces, int begin, int size) {
  return static_cast<int>(CountIf(
      surfaces, [&](const Surface& s) { return IsOfStretch(s, begin, size); }));
}

Surface Moved(const Rigid3& new_from_old, const Surface& old) {
  const auto transform = [&](const Eigen::Vector2d& position) {
    const Eigen::Vector3d moved =
        new_from_old * Eigen::Vector3d(position.x(), position.y(), 0.0);
    return Eigen::Vector2d(moved.head<2>());
  };
  Surface surface = old;
  surface.a = transform(old.a);
  surface.b = transform(old.b);
  surface.bottom_m += new_from_old.translation.z();
  surface.top_m += new_from_old.translation.z();
  return surface;
}

// Segments of road for duplicate structures. Each is used at most once.
class StretchFinder {
 public:
  StretchFinder(const Road& road, const std::vector<Surface>& surfaces)
      : road_(road), surfaces_(surfaces), is_used_(road.nodes().size(), 0) {}

  // The first node of a free straight segment, mostly with facades if they are
  // `needed`; -1 if there is none.
  int Find(int size, bool is_facade_needed, Random* random) const {
    return Find(size, is_facade_needed, road_.driven_begin(),
                road_.driven_end() - size, random);
  }

  // The same within a distance before or after a node.
  int FindNear(int node, int size, Random* random) const {
    constexpr int kMaxDistance = 40;  // meters, as nodes are one meter apart
    return Find(
        size, false, std::max(road_.driven_begin(), node - kMaxDistance - size),
        std::min(road_.driven_end() - size, node + kMaxDistance), random);
  }

  // Also keeps a distance to other duplicate structures.
  void Use(int begin, int size) {
    constexpr int kDistance = 10;  // meters
    const int end = static_cast<int>(is_used_.size());
    for (int i = std::max(0, begin - kDistance);
         i < std::min(end, begin + size + kDistance); ++i) {
      is_used_[i] = 1;
    }
  }

 private:
  int Find(int size, bool is_facade_needed, int first_begin, int end_begin,
           Random* random) const {
    // Finds a place with probability 0.99 if 2.3 % of all are suitable.
    constexpr int kNumTrials = 200;
    if (first_begin >= end_begin) return -1;
    const auto num_begins = static_cast<uint32_t>(end_begin - first_begin);
    for (int i = 0; i < kNumTrials; ++i) {
      const int begin =
          first_begin + static_cast<int>(random->Index(num_begins));
      const bool is_free = std::none_of(is_used_.begin() + begin,
                                        is_used_.begin() + begin + size,
                                        [](char used) { return used != 0; });
      if (!is_free || !IsStraight(road_, begin, size)) continue;
      if (is_facade_needed &&
          NumFacades(surfaces_, begin, size) < kMinFacadeShare * 2 * size) {
        continue;
      }
      return begin;
    }
    return -1;
  }

  const Road& road_;
  const std::vector<Surface>& surfaces_;
  Mask is_used_;
};

// Copies facades to other places, replacing existing surfaces. Both places are
// straight and apart from each other, and no place is used twice. There may be
// fewer than `num_duplicates` suitable places. Duplicates are near the
// preferred nodes of the road, in turn, where possible.
std::vector<Rigid3> DuplicateFacades(const Road& road, int num_duplicates,
                                     const std::vector<int>& preferred_nodes,
                                     uint64_t seed,
                                     std::vector<Surface>* surfaces) {
  std::vector<Rigid3> duplicates;
  const std::vector<Surface> street = *surfaces;
  StretchFinder finder(road, street);
  const int num_driven = road.driven_end() - road.driven_begin();
  const int max_num = std::max(
      1, num_driven / (preferred_nodes.empty() ? kNodesPerDuplicate
                                               : kNodesPerDuplicateAtCuts));
  for (int i = 0; i < std::min(num_duplicates, max_num); ++i) {
    Random random = RandomOf(seed, Effect::kDuplicates, i);
    const int size =
        kMinBlockNodes +
        static_cast<int>(random.Index(kMaxBlockNodes - kMinBlockNodes));
    const int original = finder.Find(size, true, &random);
    if (original < 0) continue;
    finder.Use(original, size);
    int copy = -1;
    if (!preferred_nodes.empty()) {
      const int node = preferred_nodes[i % preferred_nodes.size()];
      copy = finder.FindNear(node, size, &random);
    }
    if (copy < 0) copy = finder.Find(size, false, &random);
    if (copy < 0) continue;
    finder.Use(copy, size);
    // Vary the distance and the angle to the road.
    const Rigid3 shift{
        ExpSO3(DegToRad(random.Uniform(-2.0, 2.0)) * Eigen::Vector3d::UnitZ()),
        {0.0, random.Uniform(-0.8, 0.8), 0.0}};
    duplicates.push_back(LevelFromMiddle(road, copy, size) * shift *
                         LevelFromMiddle(road, original, size).Inverse());
    const int number = static_cast<int>(duplicates.size()) - 1;
    EraseIf(surfaces,
            [&](const Surface& s) { return IsOfStretch(s, copy, size); });
    const size_t num_surfaces = surfaces->size();
    for (size_t j = 0; j < num_surfaces; ++j) {
      if (!IsOfStretch((*surfaces)[j], original, size)) continue;
      (*surfaces)[j].original_of = number;
      Surface surface = Moved(duplicates.back(), (*surfaces)[j]);
      // The road may bend, or another road may pass, where the facade of the
      // original is.
      if (road.IsNear(0.5 * (surface.a + surface.b), kFacadeClearance_m)) {
        continue;
      }
      surface.original_of = -1;
      surface.copy_of = number;
      surface.node = -1;
      surface.side = 0;
      surfaces->push_back(surface);
    }
  }
  return duplicates;
}

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

Eigen::AlignedBox2d BoxOf(const Surface& surface) {
  const Eigen::Vector2d margin(surface.radius_m, surface.radius_m);
  return {surface.a.cwiseMin(surface.b) - margin,
          surface.a.cwiseMax(surface.b) + margin};
}

CellGrid MakeGrid(const std::vector<Surface>& surfaces) {
  Eigen::AlignedBox2d box;
  for (const Surface& surface : surfaces) box.extend(BoxOf(surface));
  if (surfaces.empty()) box.extend(Eigen::Vector2d(0.0, 0.0));
  return CellGrid(box, kCell_m);
}

}  // namespace

StreetSurfaces::StreetSurfaces(const Road& road, int num_duplicates,
                               uint64_t seed,
                               const std::vector<int>& preferred_nodes)
    : surfaces_(StreetBuilder(road, seed).Build()),
      duplicates_(DuplicateFacades(road, num_duplicates, preferred_nodes, seed,
                                   &surfaces_)),
      grid_(MakeGrid(surfaces_)) {
  FillGrid();
}

void StreetSurfaces::FillGrid() {
  std::vector<std::pair<int, int>> items;
  for (size_t i = 0; i < surfaces_.size(); ++i) {
    const Eigen::AlignedBox2d box = BoxOf(surfaces_[i]);
    const int row_end = grid_.Row(box.max().y());
    const int column_end = grid_.Column(box.max().x());
    for (int row = grid_.Row(box.min().y()); row <= row_end; ++row) {
      for (int column = grid_.Column(box.min().x()); column <= column_end;
           ++column) {
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
