// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/vehicles.h"

#include <cmath>
#include <utility>

#include "synthetic/random_streams.h"

namespace mgsfm {
namespace {

constexpr int kNumPoints = 300;  // per vehicle
// Plausible dimensions of a car and of traffic.
constexpr double kWidth_m = 1.8, kHeight_m = 1.5, kLength_m = 4.4;
constexpr double kLane_m = 3.5;
constexpr double kOncomingSpeed_m_s = 10.0;
constexpr double kMeanPassage_s = 8.0;
constexpr double kSeenBefore_s = 6.0, kSeenAfter_s = 3.0;

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

}  // namespace

Vehicles::Vehicles(const Road& road, const Drive& drive, uint64_t seed)
    : road_(road), drive_(drive) {
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
    Add({time_s, time_s + duration_s, false, begin_m, speed, left_m, {}},
        random);
    time_s += duration_s + Exponential(mean_pause_s, random);
  }
}

void Vehicles::AddOncoming(Random* random) {
  double time_s = drive_.times_s.front() - kSeenBefore_s;
  while (true) {
    time_s += Exponential(kMeanPassage_s, random);
    if (time_s > drive_.times_s.back() + kSeenBefore_s) break;
    const double arc_m = road_.ArcAt(drive_, time_s);
    Add({time_s - kSeenBefore_s,
         time_s + kSeenAfter_s,
         true,
         arc_m + kOncomingSpeed_m_s * kSeenBefore_s,
         -kOncomingSpeed_m_s,
         kLane_m,
         {}},
        random);
  }
}

void Vehicles::Add(Vehicle vehicle, Random* random) {
  for (int i = 0; i < kNumPoints; ++i) {
    vehicle.points.push_back(RandomPoint(random));
  }
  vehicles_.push_back(std::move(vehicle));
}

Rigid3 Vehicles::WorldFromVehicle(int vehicle, double time_s) const {
  const Vehicle& v = vehicles_[vehicle];
  double arc_m = v.arc_m + v.speed_m_s * (time_s - v.begin_s);
  if (!v.is_oncoming) arc_m += road_.ArcAt(drive_, time_s);
  return road_.WorldFromPlace(arc_m, v.left_m);
}

}  // namespace mgsfm
