// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_surfaces.h"

#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "simulator/road.h"
#include "simulator/world.h"

namespace mgsfm {
namespace {

// Parallel streets, 22 m apart, driven in alternating directions.
SimulationInput Meander() {
  constexpr double kStreetLength_m = 150.0;
  constexpr double kDistance_m = 22.0;
  SimulationInput input;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double yaw = 0.0;
  const auto drive = [&](double length_m, double turn_rad) {
    for (double done = 0.0; done < length_m; done += 1.0) {
      yaw += turn_rad / length_m;
      center += Eigen::Vector3d(std::sin(yaw), 0.0, std::cos(yaw));
      const Eigen::Quaterniond world_from_rig =
          ExpSO3(yaw * Eigen::Vector3d::UnitY());
      input.rig_from_world_path.push_back(
          Rigid3{world_from_rig, center}.Inverse());
    }
  };
  for (int street = 0; street < 6; ++street) {
    const double turn_rad = (street % 2 == 0 ? 1.0 : -1.0) * M_PI;
    drive(kStreetLength_m, 0.0);
    drive(0.5 * M_PI * kDistance_m, turn_rad);
  }
  return input;
}

TEST(StreetSurfacesTest, CopiesOfFacadesLeaveAllWaysFree) {
  const SimulationInput input = Meander();
  const Road road(MakeDrive(SimulationOptions(), input), kRoadExtension_m);
  int num_copies = 0;
  for (uint64_t seed = 0; seed < 5; ++seed) {
    const StreetSurfaces street(road, 10, seed);
    for (const Surface& surface : street.surfaces()) {
      if (surface.copy_of < 0) continue;
      ++num_copies;
      EXPECT_FALSE(road.IsNear(0.5 * (surface.a + surface.b), 4.0));
    }
  }
  EXPECT_GT(num_copies, 100);
}

}  // namespace
}  // namespace mgsfm
