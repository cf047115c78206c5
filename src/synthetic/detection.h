// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "synthetic/vehicles.h"
#include "synthetic/world.h"

namespace mgsfm {

// An image to be taken.
struct Exposure {
  int camera;  // of the rig
  int frame;   // of the drive
  double time_s;
  Rigid3 cam_from_world;

  // Tells images apart independently of which others there are.
  uint64_t Key() const { return static_cast<uint64_t>(frame) * 64 + camera; }
};

// The features of an image: first those of points, by point, then those on
// vehicles, then clutter. `identities` is ascending: the index of a world
// point; beyond these, a point of a vehicle; or kClutter.
constexpr int kClutter = std::numeric_limits<int>::max();

struct Features {
  std::vector<int> identities;
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<Eigen::Vector3d> rays;  // of the keypoints as they are written

  size_t size() const { return identities.size(); }
};

class Detector {
 public:
  // All arguments must stay alive. Without `vehicles` there are none.
  Detector(const SimulationOptions& options,
           const std::vector<SimulatedCamera>& rig, const World& world,
           const Vehicles* vehicles);

  Features Detect(const Exposure& exposure) const;

  // The vehicle of an identity; -1 if it is none of a vehicle.
  int VehicleOf(int identity) const;

  // The feature at a pixel, as far as it can be seen there. Also how wrong
  // pairs get features of their own.
  bool Append(int camera, int identity, const Eigen::Vector2d& pixel,
              Features* features) const;

 private:
  struct Candidate {
    int identity;
    double strength;
    Eigen::Vector2d pixel;
  };

  std::vector<Candidate> SeePoints(const Exposure& exposure) const;
  std::vector<Candidate> SeeVehicles(const Exposure& exposure) const;
  bool Project(const Exposure& exposure, const Eigen::Vector3d& point_in_world,
               Eigen::Vector2d* pixel) const;
  double DistanceScale(int camera) const;
  void AppendStrongest(const Exposure& exposure, size_t max_num_features,
                       std::vector<Candidate> candidates,
                       Features* features) const;
  void AppendClutter(const Exposure& exposure, int num_features,
                     Features* features) const;

  const SimulationOptions& options_;
  const std::vector<SimulatedCamera>& rig_;
  const World& world_;
  const Vehicles* vehicles_;
  std::vector<int> vehicle_offsets_;  // identity of the first point of each
};

}  // namespace mgsfm
