// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/world.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/parallel.h"
#include "mgsfm/base/error.h"
#include "synthetic/random_streams.h"
#include "synthetic/street_points.h"
#include "synthetic/weak_cuts.h"

namespace mgsfm {
namespace {

// A surface within this distance does not occlude a point, because the point
// lies on it.
constexpr double kSurfaceMargin_m = 0.5;
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
  World world{Road(drive, kRoadExtension_m), {}, {}, {}, {}, {}, false};
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

}  // namespace mgsfm
