// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <set>

#include "bundle_adjustment/problem_builder.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

std::set<int> SensorsOf(const Scene& scene, const Point3D& point) {
  std::set<int> sensors;
  for (const Observation& o : point.track) {
    sensors.insert(scene.images[o.image_idx].sensor_idx);
  }
  return sensors;
}

// The points that one sensor observes, and some that several do.
Simulation DriveWithSharedPoints(int num_shared) {
  Simulation simulation = Simulate({});
  std::vector<Point3D> points;
  for (const Point3D& point : simulation.ground_truth.points) {
    if (point.track.size() < 2) continue;
    if (SensorsOf(simulation.scene, point).size() > 1 && num_shared-- <= 0) {
      continue;
    }
    points.push_back(point);
  }
  simulation.ground_truth.points = points;
  return simulation;
}

int NumShared(const Simulation& simulation) {
  int number = 0;
  for (const Point3D& point : simulation.ground_truth.points) {
    if (SensorsOf(simulation.scene, point).size() > 1) ++number;
  }
  return number;
}

TEST(SensorTies, OfFewPointsAreCut) {
  Simulation simulation = DriveWithSharedPoints(kMinNumSensorTies - 1);
  const size_t num_points = simulation.ground_truth.points.size();
  ASSERT_GT(NumShared(simulation), 0);
  SeparateUntiedSensors(simulation.scene, &simulation.ground_truth);
  EXPECT_EQ(NumShared(simulation), 0);
  for (const Point3D& point : simulation.ground_truth.points) {
    EXPECT_GE(point.track.size(), 2u);
  }
  EXPECT_GE(simulation.ground_truth.points.size() + kMinNumSensorTies - 1,
            num_points);
}

TEST(SensorTies, OfManyPointsAreKept) {
  Simulation simulation = Simulate({});
  const int num_shared = NumShared(simulation);
  ASSERT_GE(num_shared, kMinNumSensorTies);
  SeparateUntiedSensors(simulation.scene, &simulation.ground_truth);
  EXPECT_EQ(NumShared(simulation), num_shared);
}

}  // namespace
}  // namespace mgsfm
