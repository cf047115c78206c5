// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "simulator/vehicles.h"
#include "simulator/world.h"

namespace mgsfm {

// One image of the simulation.
struct Exposure {
  int camera;  // index in the rig
  int frame;   // index in the drive
  double time_s;
  Rigid3 cam_from_world;

  // Identifies an image independently of the presence of other images.
  uint64_t Key() const { return static_cast<uint64_t>(frame) * 64 + camera; }
};

// The features of an image: world points in ascending order, then points on
// vehicles, then clutter. The ascending `identities` are indices of world
// points, larger numbers for points of vehicles, or kClutter.
constexpr int kClutter = std::numeric_limits<int>::max();

struct Features {
  std::vector<int> identities;
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<Eigen::Vector3d>
      rays;  // of the keypoints after rounding to float

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
  Features Detect(const Exposure& exposure, bool detects_convoys = true) const;

  // The vehicle of an identity; -1 for world points and clutter.
  int VehicleOf(int identity) const;

  // Appends a feature at a pixel if the camera model has a ray for it. Also
  // used to create the features of wrong pairs.
  bool Append(int camera, int identity, const Eigen::Vector2d& pixel,
              Features* features) const;

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
                       Features* features) const;
  Eigen::Vector2d Noise(const Exposure& exposure, int identity) const;
  void AppendClutter(const Exposure& exposure, int num_features,
                     Features* features) const;

  const SimulationOptions& options_;
  const std::vector<SimulatedCamera>& rig_;
  const std::vector<SimulatedCamera>& assumed_rig_;
  const World& world_;
  const Vehicles* vehicles_;
  std::vector<int>
      vehicle_offsets_;  // identity of the first point of each vehicle
};

}  // namespace mgsfm
