// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/world.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "simulator/random_streams.h"
#include "simulator/street_points.h"
#include "simulator/weak_cuts.h"

namespace mgsfm {
namespace {

// A surface within this distance does not occlude a point, because the point
// lies on it.
constexpr double kSurfaceMargin_m = 0.5;
// The same for boxes, relative to the distance.
constexpr double kBoxMargin = 1e-3;
// Points of boxes are recognized within this angle of their best view, which is
// within half of it of the normal, and over this range of distances.
constexpr double kMaxTurn_deg = 55.0;
constexpr double kDistanceRange = 6.0;
constexpr double kSmallestReach_m = 12.5;  // finest level of PointIndex

std::vector<WorldPoint> ScatterPoints(const SimulationOptions& options,
                                      const Drive& drive) {
  std::vector<WorldPoint> points;
  for (int frame = 0; frame < drive.num_frames(); ++frame) {
    Random random = RandomOf(options.random_seed, Effect::kPoints, frame);
    const Rigid3 world_from_rig = drive.PoseOfFrame(frame).Inverse();
    for (int i = 0; i < options.num_points_per_frame; ++i) {
      const double side = random.Uniform() < 0.5 ? -1.0 : 1.0;
      const double x = side * random.Uniform(2.0, 14.0);
      const double y = random.Uniform(-6.0, 1.6);
      const double z = random.Uniform(-10.0, options.max_visible_distance_m);
      WorldPoint point;
      point.position = world_from_rig * Eigen::Vector3d(x, y, z);
      point.max_distance_m = options.max_visible_distance_m;
      point.strength = random.Uniform();
      point.appearance = static_cast<int>(points.size());
      points.push_back(point);
    }
  }
  return points;
}

}  // namespace

PointIndex::PointIndex(const std::vector<WorldPoint>& points,
                       const Eigen::Quaterniond& level_from_world) {
  double max_reach = kSmallestReach_m;
  for (const WorldPoint& point : points) {
    max_reach = std::max(max_reach, point.max_distance_m);
  }
  double smaller_reach = -1.0;
  for (double reach = kSmallestReach_m; smaller_reach < max_reach;
       smaller_reach = reach, reach *= 2.0) {
    std::vector<int> members;
    std::vector<Eigen::Vector2d> positions;
    for (size_t i = 0; i < points.size(); ++i) {
      const double distance = points[i].max_distance_m;
      if (distance <= smaller_reach || distance > reach) continue;
      members.push_back(static_cast<int>(i));
      positions.emplace_back((level_from_world * points[i].position).head<2>());
    }
    if (members.empty()) continue;
    CellGrid grid = CellGrid::OfPoints(positions, 0.5 * reach);
    levels_.push_back({reach, std::move(members), std::move(grid)});
  }
}

bool World::IsHidden(const Eigen::Vector3d& point,
                     const Eigen::Vector3d& camera_center) const {
  for (const TexturedBox& box : boxes) {
    const Rigid3 box_from_world = box.world_from_box.Inverse();
    // Points lie on boxes, so the line of sight ends just before them.
    const Eigen::Vector3d end =
        box_from_world * (point + kBoxMargin * (camera_center - point));
    if (Crosses(box.half_size_m, box_from_world * camera_center, end)) {
      return true;
    }
  }
  if (!surfaces) return false;
  const Eigen::Vector3d view =
      road.level_from_world() * (point - camera_center);
  const double distance = view.norm();
  return distance > kSurfaceMargin_m &&
         surfaces
             ->Cast(road.level_from_world() * camera_center, view / distance,
                    distance - kSurfaceMargin_m)
             .has_value();
}

World MakeWorld(const SimulationOptions& options,
                const std::vector<SimulatedCamera>& rig, const Drive& drive,
                int num_duplicates, const Context& context) {
  World world{Road(drive, kRoadExtension_m), {}, {}, {}, {}, {}, {}, false};
  world.weak_cuts = PlanWeakCuts(options, drive);
  if (options.world == WorldPreset::kScatter) {
    if (num_duplicates > 0) {
      throw Error(
          "duplicated_pair_ratio requires facades; set world to "
          "street");
    }
    world.points = ScatterPoints(options, drive);
  } else {
    world.distances_scale = true;
    std::vector<int> preferred_nodes;
    for (const int cut : world.weak_cuts) {
      preferred_nodes.push_back(
          static_cast<int>(world.road.ArcAt(drive, drive.TimeOfFrame(cut))));
    }
    world.surfaces.emplace(world.road, num_duplicates, options.random_seed,
                           preferred_nodes);
    const Eigen::Quaterniond& level_from_world = world.road.level_from_world();
    const Rigid3 world_from_level{level_from_world.conjugate(),
                                  Eigen::Vector3d::Zero()};
    for (const Duplicate& duplicate : world.surfaces->duplicates()) {
      world.copy_from_original.push_back(world_from_level *
                                         duplicate.copy_from_original *
                                         world_from_level.Inverse());
    }
    world.points = FindStreetPoints(options, rig, drive, world, context);
  }
  world.index = PointIndex(world.points, world.road.level_from_world());
  return world;
}

std::vector<WorldPoint> PointsOnBox(const TexturedBox& box, uint64_t seed) {
  Random random = RandomOf(seed, Effect::kPoints, box.look);
  const Eigen::Vector3d& half = box.half_size_m;
  const Eigen::Vector3d areas(half.y() * half.z(), half.z() * half.x(),
                              half.x() * half.y());
  const int num_points =
      static_cast<int>(std::lround(8.0 * areas.sum() * box.points_per_m2));
  std::vector<WorldPoint> points;
  for (int i = 0; i < num_points; ++i) {
    const double share = random.Uniform(0.0, areas.sum());
    const int axis = share < areas[0] ? 0 : share < areas[0] + areas[1] ? 1 : 2;
    Eigen::Vector3d position, normal = Eigen::Vector3d::Zero(), tilt;
    for (int k = 0; k < 3; ++k) {
      position[k] = half[k] * random.Uniform(-1.0, 1.0);
      tilt[k] =
          std::tan(DegToRad(0.5 * kMaxTurn_deg)) * random.Uniform(-1.0, 1.0);
    }
    normal[axis] = position[axis] < 0.0 ? -1.0 : 1.0;
    position[axis] = normal[axis] * half[axis];
    WorldPoint point;
    point.position = box.world_from_box * position;
    point.normal = box.world_from_box.rotation * normal;
    point.best_view =
        box.world_from_box.rotation * (normal + tilt).normalized();
    point.min_cos_turn = std::cos(DegToRad(kMaxTurn_deg));
    point.max_distance_m = box.reach_m * random.Uniform(0.3, 1.0);
    point.min_distance_m = point.max_distance_m / kDistanceRange;
    point.repeatability = random.Uniform(0.3, 0.9);
    point.strength = random.Uniform();
    point.duplicate = box.duplicate;
    point.is_copy = box.is_copy;
    points.push_back(point);
  }
  return points;
}

World MakeWorld(const WorldPlan& plan, uint64_t seed, const Drive& drive) {
  World world{Road(drive, kRoadExtension_m), {}, {}, {}, {}, {}, {}, true};
  world.boxes = plan.boxes;
  world.copy_from_original = plan.copy_from_original;
  std::map<std::pair<int, int>, int> first_of_original;
  for (const TexturedBox& box : plan.boxes) {
    const int first = static_cast<int>(world.points.size());
    const auto original =
        first_of_original.emplace(std::pair(box.look, box.duplicate), first)
            .first->second;
    for (WorldPoint& point : PointsOnBox(box, seed)) {
      point.appearance =
          original + static_cast<int>(world.points.size()) - first;
      world.points.push_back(point);
    }
  }
  world.index = PointIndex(world.points, world.road.level_from_world());
  return world;
}

}  // namespace mgsfm
