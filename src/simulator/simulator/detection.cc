// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/detection.h"

#include <algorithm>
#include <cmath>

#include "simulator/random_streams.h"

namespace mgsfm {
namespace {

// The smallest cosine of the angle between viewing direction and normal at
// which features are detected.
constexpr double kMinCosToNormal = 0.06;
// Scale of the largest keypoints relative to the smallest.
constexpr double kMaxScale = 8.0;

// One random number per image and point, independent of all other items.
Random RandomOfFeature(uint64_t seed, Effect effect, const Exposure& exposure,
                       int identity) {
  const uint64_t of_image = RandomOf(seed, effect, exposure.Key()).NextBits();
  return Random(of_image, static_cast<uint64_t>(identity));
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
  const size_t num_vehicles = vehicles == nullptr ? 0 : vehicles->size();
  for (size_t i = 0; i < num_vehicles; ++i) {
    vehicle_offsets_.push_back(identity);
    identity += static_cast<int>(vehicles->Points(static_cast<int>(i)).size());
  }
}

int Detector::VehicleOf(int identity) const {
  if (identity == kClutter) return -1;
  const auto after = std::upper_bound(vehicle_offsets_.begin(),
                                      vehicle_offsets_.end(), identity);
  return static_cast<int>(after - vehicle_offsets_.begin()) - 1;
}

Features Detector::Detect(const Exposure& exposure,
                          bool detects_convoys) const {
  const auto share = [this](double ratio) {
    return static_cast<int>(
        std::lround(ratio * options_.max_num_features_per_image));
  };
  const int num_clutter = share(options_.clutter_ratio);
  const int num_free = options_.max_num_features_per_image - num_clutter;
  Features moving;
  const auto append_moving = [&](double ratio, bool in_convoy) {
    const int num_left = num_free - static_cast<int>(moving.size());
    const int max_num = std::min(share(ratio), num_left);
    if (vehicles_ == nullptr || max_num <= 0) return;
    AppendStrongest(exposure, max_num, SeeVehicles(exposure, in_convoy),
                    &moving);
  };
  append_moving(options_.moving_feature_ratio, false);
  if (detects_convoys) append_moving(options_.convoy_feature_ratio, true);
  Features features;
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
  return kReferenceFocal_px /
         PixelsPerRadian(rig_[camera].model, rig_[camera].params.data());
}

bool Detector::Project(const Exposure& exposure,
                       const Eigen::Vector3d& point_in_world,
                       Eigen::Vector2d* pixel) const {
  const SimulatedCamera& camera = rig_[exposure.camera];
  const auto projected =
      ProjectToPixel(camera.model, camera.params.data(),
                     exposure.cam_from_world * point_in_world);
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
      RandomOf(options_.random_seed, Effect::kDetection, exposure.Key())
          .NextBits();
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
      RandomOf(options_.random_seed, Effect::kVehicleDetection, exposure.Key())
          .NextBits();
  const double repeatability =
      (in_convoy ? kConvoyRepeatability : 1.0) * options_.repeatability;
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < vehicles_->size(); ++i) {
    const int vehicle = static_cast<int>(i);
    if (vehicles_->IsInConvoy(vehicle) != in_convoy ||
        !vehicles_->IsThere(vehicle, exposure.time_s)) {
      continue;
    }
    const Rigid3 world_from_vehicle =
        vehicles_->WorldFromVehicle(vehicle, exposure.time_s);
    int identity = vehicle_offsets_[i] - 1;
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
                               Features* features) const {
  if (candidates.size() > max_num_features) {
    std::nth_element(
        candidates.begin(), candidates.begin() + max_num_features,
        candidates.end(), [](const Candidate& a, const Candidate& b) {
          return a.strength != b.strength ? a.strength > b.strength
                                          : a.identity < b.identity;
        });
    candidates.resize(max_num_features);
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) {
              return a.identity < b.identity;
            });
  for (const Candidate& candidate : candidates) {
    Eigen::Vector2d pixel = candidate.pixel;
    if (options_.pixel_noise_px > 0.0) {
      pixel += Noise(exposure, candidate.identity);
    }
    Append(exposure.camera, candidate.identity, pixel, features);
  }
}

Eigen::Vector2d Detector::Noise(const Exposure& exposure, int identity) const {
  Random random = RandomOfFeature(options_.random_seed, Effect::kPixelNoise,
                                  exposure, identity);
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
                             Features* features) const {
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
                      const Eigen::Vector2d& pixel, Features* features) const {
  const SimulatedCamera& camera = assumed_rig_[camera_number];
  const Eigen::Vector2f keypoint = pixel.cast<float>();
  const auto ray =
      RayFromPixel(camera.model, camera.params.data(), keypoint.cast<double>());
  if (!ray) return false;
  features->identities.push_back(identity);
  features->keypoints_px.push_back(keypoint);
  features->rays.push_back(*ray);
  return true;
}

}  // namespace mgsfm
