// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/world.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "simulator/random_streams.h"
#include "simulator/weak_cuts.h"

namespace mgsfm {
namespace {

// Points are also sampled from positions up to this distance beyond both ends
// of the drive.
constexpr int kMoreViewpoints_m = 15;
// Rays per camera and meter, relative to the maximum number of features. Short
// drives use more rays per meter.
constexpr double kRaysPerFeature = 0.3;
constexpr double kMinDrive_m = 30.0;
// Probability that a ray finds a feature on a surface.
constexpr double kGroundProbability = 0.3;
constexpr double kSkylineProbability = 0.2;
// The grazing view of the ground has no features beyond this distance.
constexpr double kMaxGroundDistance_m = 40.0;
// Depth variation of facades.
constexpr double kRelief_m = 0.12;
// Limits of the change of distance (factor) and direction up to which points
// are detectable. They vary between points.
constexpr double kMinLogScale = 0.04, kMeanMoreLogScale = 0.2,
                 kMaxLogScale = 1.2;
constexpr double kMinTurn_deg = 3.0, kMaxTurn_deg = 25.0;

struct Viewpoint {
  Rigid3 rig_from_world;
  const RoadNode* node;
};

std::vector<Viewpoint> FindViewpoints(const Drive& drive, const Road& road) {
  std::vector<double> arcs = Transformed(
      drive.times_s, [&](double time_s) { return road.ArcAt(drive, time_s); });
  const int first = road.driven_begin();
  const int last = road.driven_end() - 1;
  std::vector<Viewpoint> viewpoints;
  for (int i = first - kMoreViewpoints_m; i <= last + kMoreViewpoints_m; ++i) {
    const RoadNode& node = road.nodes()[i];
    if (node.is_repeated) continue;
    const int on_drive = std::clamp(i, first, last);
    const auto pose = std::lower_bound(arcs.begin(), arcs.end() - 1, on_drive);
    Rigid3 rig_from_world = drive.rig_from_world[pose - arcs.begin()];
    const Eigen::Vector3d ahead(node.heading.x(), node.heading.y(), 0.0);
    const Eigen::Vector3d center =
        rig_from_world.Center() +
        (i - on_drive) * (road.level_from_world().conjugate() * ahead);
    viewpoints.push_back(
        {Rigid3::FromRotationAndCenter(rig_from_world.rotation, center),
         &node});
  }
  return viewpoints;
}

class PointFinder {
 public:
  PointFinder(const SimulationOptions& options,
              const std::vector<SimulatedCamera>& rig, const World& world)
      : options_(options), rig_(rig), world_(world) {}

  // Appends the points of copies after those of their originals.
  void Find(const Viewpoint& viewpoint, int num_rays, uint64_t stream,
            std::vector<WorldPoint>* points) const {
    Random random = RandomOf(options_.random_seed, Effect::kPoints, stream);
    for (const SimulatedCamera& camera : rig_) {
      const Rigid3 world_from_cam =
          (camera.sensor_from_rig * viewpoint.rig_from_world).Inverse();
      for (int i = 0; i < num_rays; ++i) {
        CastRay(camera, world_from_cam, *viewpoint.node, random.NextBits(),
                points);
      }
    }
  }

 private:
  void CastRay(const SimulatedCamera& camera, const Rigid3& world_from_cam,
               const RoadNode& node, uint64_t seed,
               std::vector<WorldPoint>* points) const {
    Random random(seed);
    const double x = random.Uniform(0.0, camera.width_px);
    const double y = random.Uniform(0.0, camera.height_px);
    const auto ray = RayFromPixel(camera, {x, y});
    if (!ray) return;
    const Eigen::Quaterniond& level_from_world = world_.road.level_from_world();
    const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
    const Eigen::Vector3d origin_in_level =
        level_from_world * world_from_cam.translation;
    const Eigen::Vector3d direction_in_level = level_from_world * direction;

    const auto hit = world_.surfaces->Cast(origin_in_level, direction_in_level,
                                           options_.max_visible_distance_m);
    const double ground =
        GroundDistance(origin_in_level, direction_in_level, node);
    const double kind = random.Uniform();
    WorldPoint point;
    double distance = 0.0;
    const Surface* surface = nullptr;
    if (hit && hit->distance_m < ground) {
      surface = &world_.surfaces->surfaces()[hit->surface];
      distance = hit->distance_m;
      point.normal = level_from_world.conjugate() * hit->normal;
    } else if (ground < kMaxGroundDistance_m) {
      if (kind > kGroundProbability) return;
      distance = ground;
      point.normal = level_from_world.conjugate() * Eigen::Vector3d::UnitZ();
    } else {
      const double slope = direction_in_level.z();
      if (slope < -0.01 || slope > 0.2 || kind > kSkylineProbability) return;
      distance = options_.max_visible_distance_m * random.Uniform(1.2, 4.0);
      point.normal = -direction;
    }
    point.best_view = -direction;
    point.position = world_from_cam.translation + distance * direction;
    if (surface != nullptr) {
      point.position += random.Uniform(0.0, kRelief_m) * point.normal;
    }
    SetRange(distance * kReferenceFocal_px / PixelsPerRadian(camera), &random,
             &point);
    Add(point, surface, points);
  }

  // The frame of the road at a node, including its slope.
  double GroundDistance(const Eigen::Vector3d& origin,
                        const Eigen::Vector3d& direction,
                        const RoadNode& node) const {
    const std::vector<RoadNode>& nodes = world_.road.nodes();
    const RoadNode& next = &node == &nodes.back() ? node : *(&node + 1);
    const double slope =
        std::clamp(next.ground.z() - node.ground.z(), -0.2, 0.2);
    const auto height = [&](const Eigen::Vector3d& v) {
      return v.z() - slope * v.head<2>().dot(node.heading);
    };
    const double descent = -height(direction);
    if (descent < 1e-3) return 1e9;
    return height(origin - node.ground) / descent;
  }

  void SetRange(double distance_m, Random* random, WorldPoint* point) const {
    const double log_scale =
        kMinLogScale - kMeanMoreLogScale * std::log(1.0 - random->Uniform());
    const double factor = std::exp(std::min(log_scale, kMaxLogScale));
    point->min_distance_m = distance_m / factor;
    point->max_distance_m = distance_m * factor;
    point->min_cos_turn =
        std::cos(DegToRad(random->Uniform(kMinTurn_deg, kMaxTurn_deg)));
    const double mean = options_.repeatability;
    const double half_width = std::min(mean, 1.0 - mean);
    point->repeatability =
        random->Uniform(mean - half_width, mean + half_width);
    point->strength = random->Uniform();
  }

  // A copy has exactly the points of its original.
  void Add(const WorldPoint& point, const Surface* surface,
           std::vector<WorldPoint>* points) const {
    if (surface != nullptr && surface->copy_of >= 0) return;
    points->push_back(point);
    if (surface == nullptr || surface->original_of < 0) return;
    points->back().duplicate = surface->original_of;
    const Rigid3& copy_from_original =
        world_.copy_from_original[surface->original_of];
    WorldPoint copy = points->back();
    copy.position = copy_from_original * point.position;
    copy.best_view = copy_from_original.rotation * point.best_view;
    copy.normal = copy_from_original.rotation * point.normal;
    copy.is_copy = true;
    points->push_back(copy);
  }

  const SimulationOptions& options_;
  const std::vector<SimulatedCamera>& rig_;
  const World& world_;
};

// Generates World::points from its road and surfaces.
std::vector<WorldPoint> FindStreetPoints(
    const SimulationOptions& options, const std::vector<SimulatedCamera>& rig,
    const Drive& drive, const World& world, const Context& context) {
  const std::vector<Viewpoint> viewpoints = FindViewpoints(drive, world.road);
  const double missing_length =
      std::max(1.0, kMinDrive_m / static_cast<double>(viewpoints.size()));
  const int num_rays = static_cast<int>(std::ceil(
      kRaysPerFeature * missing_length * options.max_num_features_per_image));
  const PointFinder finder(options, rig, world);
  std::vector<std::vector<WorldPoint>> found(viewpoints.size());
  ParallelFor(
      viewpoints.size(), context, "simulation: world",
      [&](size_t i) { finder.Find(viewpoints[i], num_rays, i, &found[i]); },
      16);
  std::vector<WorldPoint> points = Concatenated(found);
  for (const int i : Indices(points.size())) {
    points[i].appearance = points[i].is_copy ? i - 1 : i;
  }
  return points;
}

// A surface within this distance does not occlude a point, because the point
// lies on it.
constexpr double kSurfaceMargin_m = 0.5;
// The same for boxes, relative to the distance.
constexpr double kBoxMargin = 1e-3;
// Points of boxes are recognized within this angle of their best view, which is
// within half of it of the normal, and over this range of distances.
constexpr double kMaxBoxTurn_deg = 55.0;
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
    const auto node_of = [&](int cut) {
      return static_cast<int>(world.road.ArcAt(drive, drive.TimeOfFrame(cut)));
    };
    world.surfaces.emplace(world.road, num_duplicates, options.random_seed,
                           Transformed(world.weak_cuts, node_of));
    const Eigen::Quaterniond& level_from_world = world.road.level_from_world();
    const Rigid3 world_from_level{level_from_world.conjugate(),
                                  Eigen::Vector3d::Zero()};
    for (const Rigid3& copy_from_original : world.surfaces->duplicates()) {
      world.copy_from_original.push_back(world_from_level * copy_from_original *
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
          std::tan(DegToRad(0.5 * kMaxBoxTurn_deg)) * random.Uniform(-1.0, 1.0);
    }
    normal[axis] = position[axis] < 0.0 ? -1.0 : 1.0;
    position[axis] = normal[axis] * half[axis];
    WorldPoint point;
    point.position = box.world_from_box * position;
    point.normal = box.world_from_box.rotation * normal;
    point.best_view =
        box.world_from_box.rotation * (normal + tilt).normalized();
    point.min_cos_turn = std::cos(DegToRad(kMaxBoxTurn_deg));
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
