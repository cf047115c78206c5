// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/detection.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "simulator/random_streams.h"
#include "simulator/world.h"

namespace mgsfm {
namespace {

constexpr int kNumPoints = 300;  // per vehicle
// Plausible dimensions of a car and of traffic.
constexpr double kWidth_m = 1.8, kHeight_m = 1.5, kLength_m = 4.4;
constexpr double kLane_m = 3.5;
constexpr double kOncomingSpeed_m_s = 10.0;
constexpr double kMeanPassage_s = 8.0;
constexpr double kSeenBefore_s = 6.0, kSeenAfter_s = 3.0;

// Dimensions of a lorry or bus in a convoy, and its place relative to the rig.
constexpr double kConvoyWidth_m = 2.5, kConvoyHeight_m = 3.2,
                 kConvoyLength_m = 10.0;
constexpr double kMinConvoyGap_m = 4.0, kMaxConvoyGap_m = 9.0;
constexpr double kMaxConvoySpeed_m_s = 0.3;
constexpr double kMinConvoyFrames = 20.0, kMaxConvoyFrames = 60.0;
// Points of a side of a lorry relative to those that fill an image, as a side
// is partly out of view.
constexpr double kConvoyPointReserve = 1.5;
constexpr double kMaxConvoyDistance_m = 40.0;

double Exponential(double mean, Random* random) {
  return -mean * std::log(1.0 - random->Uniform());
}

// Random points on the four sides of a box.
VehiclePoint RandomPoint(Random* random) {
  VehiclePoint point;
  const double side = random->Uniform() < 0.5 ? -1.0 : 1.0;
  const double height = random->Uniform(0.2, kHeight_m);
  if (random->Uniform() < kLength_m / (kLength_m + kWidth_m)) {
    point.normal = side * Eigen::Vector3d::UnitX();
    point.position = {0.5 * side * kWidth_m, height,
                      kLength_m * random->Uniform(-0.5, 0.5)};
  } else {
    point.normal = side * Eigen::Vector3d::UnitZ();
    point.position = {kWidth_m * random->Uniform(-0.5, 0.5), height,
                      0.5 * side * kLength_m};
  }
  const double distance = 3.0 * std::exp(random->Uniform(0.0, 2.5));
  const double factor = std::exp(random->Uniform(0.3, 0.9));
  point.min_distance_m = distance / factor;
  point.max_distance_m = distance * factor;
  point.strength = random->Uniform();
  return point;
}

// A random point on one of the four sides of a lorry.
VehiclePoint RandomConvoyPoint(int side, Random* random) {
  const double sign = side < 2 ? -1.0 : 1.0;
  const bool is_lateral = side % 2 == 0;
  const double along = random->Uniform(-0.5, 0.5);
  const double height = random->Uniform(0.4, kConvoyHeight_m);
  VehiclePoint point;
  point.normal =
      sign * (is_lateral ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ());
  point.position = is_lateral ? Eigen::Vector3d(0.5 * sign * kConvoyWidth_m,
                                                height, kConvoyLength_m * along)
                              : Eigen::Vector3d(kConvoyWidth_m * along, height,
                                                0.5 * sign * kConvoyLength_m);
  point.min_distance_m = 0.0;
  point.max_distance_m = kMaxConvoyDistance_m;
  point.strength = random->Uniform();
  return point;
}

}  // namespace

Vehicles::Vehicles(const SimulationOptions& options, const Road& road,
                   const Drive& drive, const WorldPlan* plan)
    : road_(road), drive_(drive) {
  if (plan != nullptr) {
    AddBodies(*plan, options.random_seed);
    return;
  }
  if (options.moving_feature_ratio > 0.0) AddTraffic(options.random_seed);
  if (options.convoy_ratio > 0.0) AddConvoys(options);
}

void Vehicles::AddTraffic(uint64_t seed) {
  uint64_t stream = 0;
  const auto with_stream = [&](const auto& add) {
    Random random = RandomOf(seed, Effect::kVehicles, stream++);
    add(&random);
  };
  with_stream([&](Random* r) { AddCompanions(8.0, 25.0, 0.0, 1.0, r); });
  with_stream([&](Random* r) { AddCompanions(-20.0, -9.0, 0.0, 4.0, r); });
  with_stream([&](Random* r) { AddCompanions(-4.0, 10.0, kLane_m, 10.0, r); });
  with_stream([&](Random* r) { AddCompanions(-4.0, 10.0, -kLane_m, 10.0, r); });
  with_stream([&](Random* r) { AddOncoming(r); });
}

// A sequence of vehicles in one lane and position relative to the rig.
void Vehicles::AddCompanions(double min_ahead_m, double max_ahead_m,
                             double left_m, double mean_pause_s,
                             Random* random) {
  double time_s = drive_.times_s.front() + Exponential(mean_pause_s, random);
  while (time_s < drive_.times_s.back() + 1.0) {
    const double duration_s = random->Uniform(6.0, 20.0);
    const double begin_m = random->Uniform(min_ahead_m, max_ahead_m);
    const double end_m = random->Uniform(min_ahead_m, max_ahead_m);
    // The relative speed is at most 0.5 m/s.
    const double speed = (end_m - begin_m) / std::max(duration_s, 40.0);
    Add({time_s, time_s + duration_s, false, begin_m, speed, left_m}, random);
    time_s += duration_s + Exponential(mean_pause_s, random);
  }
}

void Vehicles::AddOncoming(Random* random) {
  double time_s = drive_.times_s.front() - kSeenBefore_s;
  while (true) {
    time_s += Exponential(kMeanPassage_s, random);
    if (time_s > drive_.times_s.back() + kSeenBefore_s) break;
    const double arc_m = road_.ArcAt(drive_, time_s);
    Add({time_s - kSeenBefore_s, time_s + kSeenAfter_s, true,
         arc_m + kOncomingSpeed_m_s * kSeenBefore_s, -kOncomingSpeed_m_s,
         kLane_m},
        random);
  }
}

void Vehicles::Add(Vehicle vehicle, Random* random) {
  for (int i = 0; i < kNumPoints; ++i) {
    vehicle.points.push_back(RandomPoint(random));
  }
  vehicles_.push_back(std::move(vehicle));
}

void Vehicles::AddBodies(const WorldPlan& plan, uint64_t seed) {
  bodies_ = plan.bodies;
  for (const Body& body : bodies_) {
    Vehicle vehicle{drive_.times_s.front(), drive_.times_s.back()};
    vehicle.world_from_body = body.world_from_body;
    for (const WorldPoint& point : PointsOnBox(body.box, seed)) {
      vehicle.points.push_back({point.position, point.normal, 0.0,
                                point.max_distance_m, point.strength});
    }
    vehicles_.push_back(std::move(vehicle));
  }
}

// The mean pause between convoys follows from the required ratio.
void Vehicles::AddConvoys(const SimulationOptions& options) {
  const double duration_s = drive_.times_s.back() - drive_.times_s.front();
  if (drive_.num_frames() < 2 || options.repeatability == 0.0) return;
  const double frame_s = duration_s / (drive_.num_frames() - 1);
  const double mean_pause_s = 0.5 * (kMinConvoyFrames + kMaxConvoyFrames) *
                              frame_s * (1.0 / options.convoy_ratio - 1.0);
  const int points_per_side = static_cast<int>(
      std::ceil(kConvoyPointReserve * options.convoy_feature_ratio *
                options.max_num_features_per_image /
                (kConvoyRepeatability * options.repeatability)));
  Random random = RandomOf(options.random_seed, Effect::kConvoys);
  double time_s =
      drive_.times_s.front() + random.Uniform(0.0, 2.0) * mean_pause_s;
  while (time_s < drive_.times_s.back()) {
    const double end_s =
        time_s + frame_s * random.Uniform(kMinConvoyFrames, kMaxConvoyFrames);
    vehicles_.push_back(MakeConvoy(time_s, end_s, points_per_side, &random));
    time_s = end_s + random.Uniform(0.5, 1.5) * mean_pause_s;
  }
}

// Half of the vehicles are ahead, the others in the lanes to the left and
// right. Half stay at exactly a constant distance.
Vehicles::Vehicle Vehicles::MakeConvoy(double begin_s, double end_s,
                                       int points_per_side,
                                       Random* random) const {
  const double place = random->Uniform();
  const bool is_ahead = place < 0.5;
  const double gap_m = random->Uniform(kMinConvoyGap_m, kMaxConvoyGap_m);
  const double speed_m_s =
      random->Uniform() < 0.5
          ? 0.0
          : random->Uniform(-kMaxConvoySpeed_m_s, kMaxConvoySpeed_m_s);
  Vehicle vehicle{
      begin_s,   end_s,
      false,     is_ahead ? gap_m + 0.5 * kConvoyLength_m : gap_m,
      speed_m_s, is_ahead ? 0.0 : (place < 0.75 ? kLane_m : -kLane_m),
      {},        true};
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i < points_per_side; ++i) {
      vehicle.points.push_back(RandomConvoyPoint(side, random));
    }
  }
  return vehicle;
}

std::optional<int> Vehicles::ConvoyAt(double time_s) const {
  for (const int vehicle : Indices(vehicles_.size())) {
    if (IsInConvoy(vehicle) && IsThere(vehicle, time_s)) return vehicle;
  }
  return std::nullopt;
}

bool Vehicles::Hide(const Eigen::Vector3d& point_in_world,
                    const Eigen::Vector3d& camera_center, double time_s) const {
  const auto hides = [&](const Rigid3& world_from_box,
                         const Eigen::Vector3d& half_size) {
    const Rigid3 box_from_world = world_from_box.Inverse();
    return Crosses(half_size, box_from_world * camera_center,
                   box_from_world * point_in_world);
  };
  for (const Body& body : bodies_) {
    if (hides(body.world_from_body(time_s) * body.box.world_from_box,
              body.box.half_size_m)) {
      return true;
    }
  }
  const auto vehicle = ConvoyAt(time_s);
  if (!vehicle) return false;
  const Eigen::Vector3d half_size(0.5 * kConvoyWidth_m, 0.5 * kConvoyHeight_m,
                                  0.5 * kConvoyLength_m);
  const Rigid3 vehicle_from_box{Eigen::Quaterniond::Identity(),
                                {0.0, half_size.y(), 0.0}};
  return hides(WorldFromVehicle(*vehicle, time_s) * vehicle_from_box,
               half_size);
}

Rigid3 Vehicles::WorldFromVehicle(int vehicle, double time_s) const {
  const Vehicle& v = vehicles_[vehicle];
  if (v.world_from_body) return v.world_from_body(time_s);
  double arc_m = v.arc_m + v.speed_m_s * (time_s - v.begin_s);
  if (!v.is_oncoming) arc_m += road_.ArcAt(drive_, time_s);
  return road_.WorldFromPlace(arc_m, v.left_m);
}

namespace {

// The smallest cosine of the angle between viewing direction and normal at
// which features are detected.
constexpr double kMinCosToNormal = 0.06;
// Scale of the largest keypoints relative to the smallest.
constexpr double kMaxScale = 8.0;

// For one random number per image and point, independent of all other items.
uint64_t SeedOfImage(uint64_t seed, Effect effect, const Exposure& exposure) {
  return RandomOf(seed, effect, exposure.Key()).NextBits();
}

}  // namespace

Detector::Detector(const SimulationOptions& options,
                   const std::vector<SimulatedCamera>& rig,
                   const std::vector<SimulatedCamera>& assumed_rig,
                   const World& world, const Vehicles* vehicles)
    : options_(options),
      rig_(rig),
      assumed_rig_(assumed_rig),
      world_(world),
      vehicles_(vehicles) {
  int identity = static_cast<int>(world.points.size());
  for (const int i : Indices(vehicles == nullptr ? 0 : vehicles->size())) {
    vehicle_offsets_.push_back(identity);
    identity += static_cast<int>(vehicles->Points(i).size());
  }
}

int Detector::VehicleOf(int identity) const {
  if (identity == kClutter) return -1;
  const auto after = std::upper_bound(vehicle_offsets_.begin(),
                                      vehicle_offsets_.end(), identity);
  return static_cast<int>(after - vehicle_offsets_.begin()) - 1;
}

SimulatedFeatures Detector::Detect(const Exposure& exposure,
                                   bool detects_convoys) const {
  const auto share = [this](double ratio) {
    return static_cast<int>(
        std::lround(ratio * options_.max_num_features_per_image));
  };
  const int num_clutter = share(options_.clutter_ratio);
  const int num_free = options_.max_num_features_per_image - num_clutter;
  SimulatedFeatures moving;
  const auto append_moving = [&](double ratio, bool in_convoy) {
    const int num_left = num_free - static_cast<int>(moving.size());
    const int max_num = std::min(share(ratio), num_left);
    if (vehicles_ == nullptr || max_num <= 0) return;
    AppendStrongest(exposure, max_num, SeeVehicles(exposure, in_convoy),
                    &moving);
  };
  append_moving(options_.moving_feature_ratio, false);
  if (detects_convoys) append_moving(options_.convoy_feature_ratio, true);
  SimulatedFeatures features;
  AppendStrongest(exposure, num_free - moving.size(), SeePoints(exposure),
                  &features);
  const auto append = [](auto* all, const auto& more) {
    all->insert(all->end(), more.begin(), more.end());
  };
  append(&features.identities, moving.identities);
  append(&features.keypoints_px, moving.keypoints_px);
  append(&features.rays, moving.rays);
  AppendClutter(exposure, num_clutter, &features);
  return features;
}

double Detector::DistanceScale(int camera) const {
  if (!world_.distances_scale) return 1.0;
  return kReferenceFocal_px / PixelsPerRadian(rig_[camera]);
}

bool Detector::Project(const Exposure& exposure,
                       const Eigen::Vector3d& point_in_world,
                       Eigen::Vector2d* pixel) const {
  const SimulatedCamera& camera = rig_[exposure.camera];
  const auto project = [&](const Rigid3& cam_from_world) {
    return ProjectToPixel(camera, cam_from_world * point_in_world);
  };
  auto projected = project(exposure.cam_from_world);
  // The row depends on the pose at its time. Each repetition is more accurate
  // by the ratio of the motion in a readout time to the height of the image.
  for (int i = 0; i < 4 && projected && exposure.of_rows; ++i) {
    projected =
        project(exposure.of_rows->PoseAt(projected->y() / camera.height_px));
  }
  if (!projected || projected->x() < 0 || projected->y() < 0 ||
      projected->x() >= camera.width_px || projected->y() >= camera.height_px) {
    return false;
  }
  *pixel = *projected;
  return true;
}

std::vector<Detector::Candidate> Detector::SeePoints(
    const Exposure& exposure) const {
  const Eigen::Vector3d center = exposure.cam_from_world.Center();
  const Eigen::Vector3d center_in_level =
      world_.road.level_from_world() * center;
  const double scale = DistanceScale(exposure.camera);
  const uint64_t seed =
      SeedOfImage(options_.random_seed, Effect::kDetection, exposure);
  std::vector<Candidate> candidates;
  const auto look = [&](int identity) {
    const WorldPoint& point = world_.points[identity];
    const Eigen::Vector3d view = center - point.position;
    const double distance = view.norm();
    if (distance * scale < point.min_distance_m ||
        distance * scale > point.max_distance_m ||
        view.dot(point.best_view) < point.min_cos_turn * distance) {
      return;
    }
    if (point.normal != Eigen::Vector3d::Zero() &&
        view.dot(point.normal) < kMinCosToNormal * distance) {
      return;
    }
    if (point.repeatability < 1.0 &&
        Random(seed, identity).Uniform() > point.repeatability) {
      return;
    }
    Candidate candidate{identity, point.strength, {}};
    if (!Project(exposure, point.position, &candidate.pixel)) return;
    if (world_.IsHidden(point.position, center)) return;
    if (vehicles_ != nullptr &&
        vehicles_->Hide(point.position, center, exposure.time_s)) {
      return;
    }
    candidates.push_back(candidate);
  };
  world_.index.ForEachNear(center_in_level.head<2>(), scale, look);
  return candidates;
}

std::vector<Detector::Candidate> Detector::SeeVehicles(const Exposure& exposure,
                                                       bool in_convoy) const {
  const double scale = DistanceScale(exposure.camera);
  const Eigen::Vector3d center = exposure.cam_from_world.Center();
  const uint64_t seed =
      SeedOfImage(options_.random_seed, Effect::kVehicleDetection, exposure);
  const double repeatability =
      (in_convoy ? kConvoyRepeatability : 1.0) * options_.repeatability;
  std::vector<Candidate> candidates;
  for (const int vehicle : Indices(vehicles_->size())) {
    if (vehicles_->IsInConvoy(vehicle) != in_convoy ||
        !vehicles_->IsThere(vehicle, exposure.time_s)) {
      continue;
    }
    const Rigid3 world_from_vehicle =
        vehicles_->WorldFromVehicle(vehicle, exposure.time_s);
    int identity = vehicle_offsets_[vehicle] - 1;
    for (const VehiclePoint& point : vehicles_->Points(vehicle)) {
      ++identity;
      const Eigen::Vector3d position = world_from_vehicle * point.position;
      const Eigen::Vector3d view = center - position;
      const double distance = view.norm();
      if (distance * scale < point.min_distance_m ||
          distance * scale > point.max_distance_m ||
          view.dot(world_from_vehicle.rotation * point.normal) <
              kMinCosToNormal * distance ||
          Random(seed, identity).Uniform() > repeatability) {
        continue;
      }
      Candidate candidate{identity, point.strength, {}};
      if (Project(exposure, position, &candidate.pixel)) {
        candidates.push_back(candidate);
      }
    }
  }
  return candidates;
}

void Detector::AppendStrongest(const Exposure& exposure,
                               size_t max_num_features,
                               std::vector<Candidate> candidates,
                               SimulatedFeatures* features) const {
  if (candidates.size() > max_num_features) {
    std::nth_element(
        candidates.begin(), candidates.begin() + max_num_features,
        candidates.end(), [](const Candidate& a, const Candidate& b) {
          return a.strength != b.strength ? a.strength > b.strength
                                          : a.identity < b.identity;
        });
    candidates.resize(max_num_features);
  }
  SortBy(&candidates, &Candidate::identity);
  for (const Candidate& candidate : candidates) {
    Eigen::Vector2d pixel = candidate.pixel;
    if (options_.pixel_noise_px > 0.0) {
      pixel += Noise(exposure, candidate.identity);
    }
    Append(exposure.camera, candidate.identity, pixel, features);
  }
}

Eigen::Vector2d Detector::Noise(const Exposure& exposure, int identity) const {
  Random random(
      SeedOfImage(options_.random_seed, Effect::kPixelNoise, exposure),
      static_cast<uint64_t>(identity));
  Eigen::Vector2d noise;
  noise.x() = options_.pixel_noise_px * random.Normal();
  noise.y() = options_.pixel_noise_px * random.Normal();
  if (options_.keypoint_noise_tail == 0.0) return noise;
  const double num_degrees = std::round(1.0 / options_.keypoint_noise_tail);
  double sum_of_squares = 0.0;
  for (int i = 0; i < static_cast<int>(num_degrees); ++i) {
    const double deviate = random.Normal();
    sum_of_squares += deviate * deviate;
  }
  // Detectors find keypoints in inverse proportion to the square of their
  // scale; a point has about the same scale in all images that match.
  const double rank =
      RandomOf(options_.random_seed, Effect::kNoiseTails, identity).Uniform();
  const double scale = std::min(kMaxScale, 1.0 / std::sqrt(1.0 - rank));
  return scale * std::sqrt(num_degrees / sum_of_squares) * noise;
}

void Detector::AppendClutter(const Exposure& exposure, int num_features,
                             SimulatedFeatures* features) const {
  const SimulatedCamera& camera = rig_[exposure.camera];
  Random random =
      RandomOf(options_.random_seed, Effect::kClutter, exposure.Key());
  for (int i = 0; i < num_features; ++i) {
    const double x = random.Uniform(0.0, camera.width_px);
    const double y = random.Uniform(0.0, camera.height_px);
    Append(exposure.camera, kClutter, {x, y}, features);
  }
}

bool Detector::Append(int camera_number, int identity,
                      const Eigen::Vector2d& pixel,
                      SimulatedFeatures* features) const {
  const SimulatedCamera& camera = assumed_rig_[camera_number];
  const Eigen::Vector2f keypoint = pixel.cast<float>();
  const auto ray = RayFromPixel(camera, keypoint.cast<double>());
  if (!ray) return false;
  features->identities.push_back(identity);
  features->keypoints_px.push_back(keypoint);
  features->rays.push_back(*ray);
  return true;
}

}  // namespace mgsfm
