// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "mgsfm/base/random.h"
#include "synthetic/drive.h"
#include "synthetic/road.h"

namespace mgsfm {

// A point on a vehicle, in the frame of the vehicle: x left, y up, z ahead,
// origin on the ground below its middle.
struct VehiclePoint {
  Eigen::Vector3d position;
  Eigen::Vector3d normal;
  // As for WorldPoint.
  double min_distance_m;
  double max_distance_m;
  double strength;
};

// Other vehicles on the road of a drive: ahead, behind and alongside at almost
// the same speed for a while, and oncoming.
class Vehicles {
 public:
  // `road` and `drive` must stay alive.
  Vehicles(const Road& road, const Drive& drive, uint64_t seed);

  size_t size() const { return vehicles_.size(); }
  const std::vector<VehiclePoint>& Points(int vehicle) const {
    return vehicles_[vehicle].points;
  }
  bool IsThere(int vehicle, double time_s) const {
    return vehicles_[vehicle].begin_s <= time_s &&
           time_s <= vehicles_[vehicle].end_s;
  }
  Rigid3 WorldFromVehicle(int vehicle, double time_s) const;

 private:
  struct Vehicle {
    double begin_s;
    double end_s;
    bool is_oncoming;
    double arc_m;      // at begin_s: oncoming along the road, else ahead of rig
    double speed_m_s;  // likewise
    double left_m;     // of the way of the rig
    std::vector<VehiclePoint> points;
  };

  void AddCompanions(double min_ahead_m, double max_ahead_m, double left_m,
                     double mean_pause_s, Random* random);
  void AddOncoming(Random* random);
  void Add(Vehicle vehicle, Random* random);

  const Road& road_;
  const Drive& drive_;
  std::vector<Vehicle> vehicles_;
};

}  // namespace mgsfm
