// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/random.h"
#include "simulator/road.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {

// Points of vehicles in convoy are less repeatable than the street, relatively,
// because many of them are reflections.
constexpr double kConvoyRepeatability = 0.6;

// A point in the frame of a vehicle: x left, y up, z forward, origin on the
// ground below its center.
struct VehiclePoint {
  Eigen::Vector3d position;
  Eigen::Vector3d normal;
  // The limits of WorldPoint.
  double min_distance_m;
  double max_distance_m;
  double strength;
};

// Other vehicles on the road of a drive: some accompany the rig at almost the
// same speed for a while, others are oncoming. Those in convoy are large,
// close, and stay at a constant distance for tens of frames.
class Vehicles {
 public:
  // `road` and `drive` must outlive this object; `plan` may be null.
  Vehicles(const SimulationOptions& options, const Road& road,
           const Drive& drive, const WorldPlan* plan = nullptr);

  size_t size() const { return vehicles_.size(); }
  const std::vector<VehiclePoint>& Points(int vehicle) const {
    return vehicles_[vehicle].points;
  }
  bool IsThere(int vehicle, double time_s) const {
    return vehicles_[vehicle].begin_s <= time_s &&
           time_s <= vehicles_[vehicle].end_s;
  }
  bool IsInConvoy(int vehicle) const { return vehicles_[vehicle].is_in_convoy; }
  Rigid3 WorldFromVehicle(int vehicle, double time_s) const;
  // The vehicle in convoy at a time, if any.
  std::optional<int> ConvoyAt(double time_s) const;
  // Whether a vehicle in convoy occludes a point.
  bool Hide(const Eigen::Vector3d& point_in_world,
            const Eigen::Vector3d& camera_center, double time_s) const;

 private:
  struct Vehicle {
    double begin_s;
    double end_s;
    bool is_oncoming;
    double arc_m;      // at begin_s; relative to the rig unless oncoming
    double speed_m_s;  // relative to the rig unless oncoming
    double left_m;     // lateral offset from the path of the rig
    std::vector<VehiclePoint> points;
    bool is_in_convoy = false;
    // Of the moving bodies of a world.
    Path world_from_body = nullptr;
  };

  void AddTraffic(uint64_t seed);
  void AddCompanions(double min_ahead_m, double max_ahead_m, double left_m,
                     double mean_pause_s, Random* random);
  void AddOncoming(Random* random);
  void Add(Vehicle vehicle, Random* random);
  void AddBodies(const WorldPlan& plan, uint64_t seed);
  void AddConvoys(const SimulationOptions& options);
  Vehicle MakeConvoy(double begin_s, double end_s, int points_per_side,
                     Random* random) const;

  const Road& road_;
  const Drive& drive_;
  std::vector<Vehicle> vehicles_;
  std::vector<Body> bodies_;
};

}  // namespace mgsfm
