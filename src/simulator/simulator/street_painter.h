// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "simulator/ground.h"
#include "simulator/street_surfaces.h"

namespace mgsfm {

// Display colors: red, green and blue in [0, 1].
using Color = Eigen::Vector3f;

// The appearance of a street: a color for each point of its surfaces. Houses,
// cars and trees have individual seeds. The camera affects only the footprint
// of its pixels.
class StreetPainter {
 public:
  // `surfaces` and `ground` must outlive this object.
  StreetPainter(const std::vector<Surface>& surfaces, const Ground& ground,
                uint64_t seed);

  Color PaintSurface(const SurfaceHit& hit, const Eigen::Vector3d& point,
                     double footprint_m) const;
  Color PaintGround(const Eigen::Vector3d& point, double footprint_m) const;
  // Sky and hills at infinity.
  Color PaintBackdrop(const Eigen::Vector3d& direction,
                      double footprint_rad) const;

 private:
  enum class Look { kHouse, kCar, kPole, kTrunk, kCrown };

  // Consecutive segments of a wall share one coat of paint.
  struct Coat {
    Look look;
    uint32_t seed;
    double begin_m;   // start of the segment along the wall
    double ground_m;  // reference level of heights
  };

  Coat FirstCoat(const Surface& surface, uint32_t number) const;
  Color PaintHouse(const Coat& coat, double u, double v,
                   double footprint_m) const;
  Color PaintCar(const Coat& coat, double length_m, double piece_u, double v,
                 double footprint_m) const;
  Color PaintPlant(const Coat& coat, double u, double v,
                   double footprint_m) const;

  const std::vector<Surface>& surfaces_;
  const Ground& ground_;
  const uint32_t seed_;
  std::vector<Coat> coats_;  // per surface
};

}  // namespace mgsfm
