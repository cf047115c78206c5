// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_points.h"

#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "simulator/random_streams.h"

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
  std::vector<double> arcs;
  for (const double time_s : drive.times_s) {
    arcs.push_back(road.ArcAt(drive, time_s));
  }
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
               std::vector<WorldPoint>* points) const;
  double GroundDistance(const Eigen::Vector3d& origin,
                        const Eigen::Vector3d& direction,
                        const RoadNode& node) const;
  void SetRange(double distance_m, Random* random, WorldPoint* point) const;
  void Add(const WorldPoint& point, const Surface* surface,
           std::vector<WorldPoint>* points) const;

  const SimulationOptions& options_;
  const std::vector<SimulatedCamera>& rig_;
  const World& world_;
};

// The frame of the road at a node, including its slope.
double PointFinder::GroundDistance(const Eigen::Vector3d& origin,
                                   const Eigen::Vector3d& direction,
                                   const RoadNode& node) const {
  const std::vector<RoadNode>& nodes = world_.road.nodes();
  const RoadNode& next = &node == &nodes.back() ? node : *(&node + 1);
  const double slope = std::clamp(next.ground.z() - node.ground.z(), -0.2, 0.2);
  const auto height = [&](const Eigen::Vector3d& v) {
    return v.z() - slope * v.head<2>().dot(node.heading);
  };
  const double descent = -height(direction);
  if (descent < 1e-3) return 1e9;
  return height(origin - node.ground) / descent;
}

void PointFinder::SetRange(double distance_m, Random* random,
                           WorldPoint* point) const {
  const double log_scale =
      kMinLogScale - kMeanMoreLogScale * std::log(1.0 - random->Uniform());
  const double factor = std::exp(std::min(log_scale, kMaxLogScale));
  point->min_distance_m = distance_m / factor;
  point->max_distance_m = distance_m * factor;
  point->min_cos_turn =
      std::cos(DegToRad(random->Uniform(kMinTurn_deg, kMaxTurn_deg)));
  const double mean = options_.repeatability;
  const double half_width = std::min(mean, 1.0 - mean);
  point->repeatability = random->Uniform(mean - half_width, mean + half_width);
  point->strength = random->Uniform();
}

void PointFinder::CastRay(const SimulatedCamera& camera,
                          const Rigid3& world_from_cam, const RoadNode& node,
                          uint64_t seed,
                          std::vector<WorldPoint>* points) const {
  Random random(seed);
  const double x = random.Uniform(0.0, camera.width_px);
  const double y = random.Uniform(0.0, camera.height_px);
  const auto ray = RayFromPixel(camera.model, camera.params.data(), {x, y});
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
  SetRange(distance * kReferenceFocal_px /
               PixelsPerRadian(camera.model, camera.params.data()),
           &random, &point);
  Add(point, surface, points);
}

// A copy has exactly the points of its original.
void PointFinder::Add(const WorldPoint& point, const Surface* surface,
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

}  // namespace

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
      viewpoints.size(), ResolveNumThreads(context.num_threads),
      [&](size_t i) { finder.Find(viewpoints[i], num_rays, i, &found[i]); }, 16,
      [&](size_t num_done) {
        context.ReportProgress("simulation: world", num_done,
                               viewpoints.size());
      });
  std::vector<WorldPoint> points;
  for (const std::vector<WorldPoint>& some : found) {
    for (const WorldPoint& point : some) {
      points.push_back(point);
      const int number = static_cast<int>(points.size()) - 1;
      points.back().appearance = point.is_copy ? number - 1 : number;
    }
  }
  return points;
}

}  // namespace mgsfm
