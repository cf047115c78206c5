// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/random.h"
#include "simulator/road.h"
#include "simulator/world.h"
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
    bool is_oncoming = false;
    double arc_m = 0.0;      // at begin_s; relative to the rig unless oncoming
    double speed_m_s = 0.0;  // relative to the rig unless oncoming
    double left_m = 0.0;     // lateral offset from the path of the rig
    std::vector<VehiclePoint> points = {};
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

// One image of the simulation.
struct Exposure {
  int camera;  // index in the rig
  int frame;   // index in the drive
  double time_s;
  Rigid3 cam_from_world;
  // The poses of the camera at the times of its rows, with the height of a row
  // as time, from 0 to 1; nullopt if all rows are simultaneous.
  std::optional<Drive> of_rows = std::nullopt;

  // Identifies an image independently of the presence of other images.
  uint64_t Key() const { return static_cast<uint64_t>(frame) * 64 + camera; }
};

// The features of an image: world points in ascending order, then points on
// vehicles, then clutter. The ascending `identities` are indices of world
// points, larger numbers for points of vehicles, or kClutter.
constexpr int kClutter = std::numeric_limits<int>::max();

struct SimulatedFeatures {
  std::vector<int> identities;
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<Eigen::Vector3d> rays;  // of the keypoints rounded to float

  size_t size() const { return identities.size(); }
};

class Detector {
 public:
  // All arguments must outlive this object. `vehicles` may be null. The
  // intrinsics of `assumed_rig` turn keypoints into rays.
  Detector(const SimulationOptions& options,
           const std::vector<SimulatedCamera>& rig,
           const std::vector<SimulatedCamera>& assumed_rig, const World& world,
           const Vehicles* vehicles);

  // Vehicles in convoy occlude the street even if they are not detected.
  SimulatedFeatures Detect(const Exposure& exposure,
                           bool detects_convoys = true) const;

  // The vehicle of an identity; -1 for world points and clutter.
  int VehicleOf(int identity) const;

  // Appends a feature at a pixel if the camera model has a ray for it. Also
  // used to create the features of wrong pairs.
  bool Append(int camera, int identity, const Eigen::Vector2d& pixel,
              SimulatedFeatures* features) const;

 private:
  struct Candidate {
    int identity;
    double strength;
    Eigen::Vector2d pixel;
  };

  std::vector<Candidate> SeePoints(const Exposure& exposure) const;
  // Either the vehicles in convoy or the others.
  std::vector<Candidate> SeeVehicles(const Exposure& exposure,
                                     bool in_convoy) const;
  bool Project(const Exposure& exposure, const Eigen::Vector3d& point_in_world,
               Eigen::Vector2d* pixel) const;
  double DistanceScale(int camera) const;
  void AppendStrongest(const Exposure& exposure, size_t max_num_features,
                       std::vector<Candidate> candidates,
                       SimulatedFeatures* features) const;
  Eigen::Vector2d Noise(const Exposure& exposure, int identity) const;
  void AppendClutter(const Exposure& exposure, int num_features,
                     SimulatedFeatures* features) const;

  const SimulationOptions& options_;
  const std::vector<SimulatedCamera>& rig_;
  const std::vector<SimulatedCamera>& assumed_rig_;
  const World& world_;
  const Vehicles* vehicles_;
  std::vector<int> vehicle_offsets_;  // identities of their first points
};

}  // namespace mgsfm
