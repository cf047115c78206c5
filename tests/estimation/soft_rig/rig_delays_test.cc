// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_delays.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "base/random.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "estimation/soft_rig/winding_drive.h"
#include "soft_rig/rig_scores.h"

namespace mgsfm {
namespace {

RigDelays EstimateOf(
    const Simulation& drive, const Reconstruction& rigid,
    const CaptureTimes& times,
    const std::vector<std::pair<int, int>>& known_distances = {}) {
  const auto delays =
      EstimateRigDelays(drive.scene, {times, known_distances},
                        FixedCandidates(GroupTracks(drive.ground_truth)), rigid,
                        BundleAdjustmentOptions(), Threads(2));
  EXPECT_TRUE(delays.has_value());
  return *delays;
}

TEST(RigDelaysTest, DelayIsFoundWithItsUncertainty) {
  for (const double offset_ms : {20.0, -30.0}) {
    SimulationOptions options = DriveOptions(RigPreset::kStereo);
    options.trigger_offset_ms = offset_ms;
    const Simulation drive = Simulate(options, WindingPath(40));
    const RigDelays delays =
        EstimateOf(drive, AdjustRigid(drive), TimesOf(drive.scene));
    ASSERT_EQ(delays.cameras.size(), 1u);
    const CameraDelay& camera = delays.cameras[0];
    EXPECT_TRUE(camera.is_certain);
    EXPECT_NEAR(camera.delay, 1e-3 * offset_ms, 4.0 * camera.sigma);
    EXPECT_LT(camera.sigma, 2e-3);
  }
}

// Twice as fine a unit of time doubles the delay, and nothing else.
TEST(RigDelaysTest, UnitOfTimeDoesNotMatter) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = 20.0;
  const Simulation drive = Simulate(options, WindingPath(30));
  const Reconstruction rigid = AdjustRigid(drive);
  CaptureTimes times = TimesOf(drive.scene);
  const RigDelays in_seconds = EstimateOf(drive, rigid, times);
  for (double& time : times.frames) time *= 2.0;
  for (double& time : times.images) time *= 2.0;
  const RigDelays in_halves = EstimateOf(drive, rigid, times);
  const CameraDelay& a = in_seconds.cameras[0];
  const CameraDelay& b = in_halves.cameras[0];
  EXPECT_NEAR(b.delay, 2.0 * a.delay, 0.05 * a.sigma);
  EXPECT_NEAR(b.sigma, 2.0 * a.sigma, 0.05 * a.sigma);
}

TEST(RigDelaysTest, SynchronousCamerasAreNotLate) {
  for (const RigPreset rig :
       {RigPreset::kStereo, RigPreset::kKitti360, RigPreset::kCube6}) {
    const Simulation drive = Simulate(DriveOptions(rig), WindingPath(30));
    const RigDelays delays =
        EstimateOf(drive, AdjustRigid(drive), TimesOf(drive.scene));
    EXPECT_FALSE(delays.AreCertain());
    for (const CameraDelay& camera : delays.cameras) {
      EXPECT_LT(std::abs(camera.delay), 5.0 * camera.sigma);
      EXPECT_LT(camera.overdispersion, 3.0);
      EXPECT_LT(camera.overdispersion_of_points, 1.5);
    }
  }
}

// Every point has an error of its own in one camera, in all frames alike, as
// the keypoints of a rig that hardly moves do.
TEST(RigDelaysTest, CovariancesContainErrorsThatFramesShare) {
  Simulation drive =
      Simulate(DriveOptions(RigPreset::kStereo), WindingPath(40));
  Random random(5);
  for (const Point3D& point : drive.ground_truth.points) {
    const Eigen::Vector2d error(random.Normal(), random.Normal());
    for (const Observation& o : point.track) {
      Image& image = drive.scene.images[o.image_idx];
      if (image.sensor_idx == 1)
        image.keypoints_px[o.keypoint_idx] += error.cast<float>();
    }
  }
  const Reconstruction rigid = AdjustRigid(drive);
  CovarianceResult covariances = ComputeCovariances(
      drive.scene, rigid, BundleAdjustmentOptions(), Threads(2));
  ASSERT_TRUE(covariances.is_usable);
  const PoseMatrix before = *covariances.sensors[1];
  const RigDelays delays = EstimateOf(drive, rigid, TimesOf(drive.scene));
  ASSERT_FALSE(delays.AreCertain());
  EXPECT_GT(delays.cameras[0].overdispersion_of_points, 2.0);
  AddRigErrors(drive.scene, rigid, delays, &covariances);
  EXPECT_GT(covariances.sensors[1]->trace(), 2.0 * before.trace());
}

// Images that deviate from their rig show no common delay, but vary more than
// independent residuals.
TEST(RigDelaysTest, JitterIsNoDelay) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_jitter_ms = 20.0;
  const Simulation drive = Simulate(options, WindingPath(40));
  const RigDelays delays =
      EstimateOf(drive, AdjustRigid(drive), TimesOf(drive.scene));
  EXPECT_FALSE(delays.AreCertain());
  EXPECT_GT(delays.cameras[0].overdispersion, 5.0);
}

// The errors of a rigid model of delayed cameras lie within the stated standard
// deviations once these contain what the residuals show.
TEST(RigDelaysTest, CovariancesContainTheErrorsByDelays) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = 30.0;
  const Simulation drive = Simulate(options, WindingPath(40));
  const Reconstruction rigid = AdjustRigid(drive);
  CovarianceResult covariances = ComputeCovariances(
      drive.scene, rigid, BundleAdjustmentOptions(), Threads(2));
  ASSERT_TRUE(covariances.is_usable);
  const Eigen::Vector3d error =
      LogSO3(rigid.sensor_from_rig[1]->rotation *
             drive.ground_truth.sensor_from_rig[1]->rotation.conjugate());
  const auto mahalanobis = [&] {
    const Eigen::Matrix3d covariance =
        covariances.sensors[1]->topLeftCorner<3, 3>();
    return std::sqrt(error.dot(covariance.ldlt().solve(error)));
  };
  EXPECT_GT(mahalanobis(), 5.0);
  AddRigErrors(drive.scene, rigid,
               EstimateOf(drive, rigid, TimesOf(drive.scene)), &covariances);
  EXPECT_LT(mahalanobis(), 3.5);
}

// The error of the unit in stated standard deviations.
double ErrorOfUnit(const Simulation& drive, const Reconstruction& rigid,
                   const RigDelays& delays) {
  EXPECT_TRUE(delays.unit.has_value());
  return std::abs(
             std::log(PathLength(drive.ground_truth) / PathLength(rigid))) /
         delays.unit->RelativeSigma();
}

// The poses of sensors are known with errors of the order of their priors, or
// larger ones; the cameras trigger together or not.
TEST(RigDelaysTest, UnitOfKnownRigIsWithinItsDeviation) {
  double sum_of_squares = 0.0;
  int count = 0;
  for (const double error_deg : {0.0, 0.1, 0.5}) {
    for (const double offset_ms : {0.0, 15.0}) {
      SimulationOptions options = DriveOptions(RigPreset::kStereo);
      options.trigger_offset_ms = offset_ms;
      options.extrinsics_are_known = true;
      Simulation drive = Simulate(options, WindingPath(40));
      Rigid3& known = *drive.scene.sensors[1].sensor_from_rig;
      known.rotation =
          ExpSO3(DegToRad(error_deg) * Eigen::Vector3d(0.6, -0.8, 0.0)) *
          known.rotation;
      Simulation start = drive;
      start.ground_truth.sensor_from_rig[1] = known;
      const Reconstruction rigid = AdjustRigid(start);
      const RigDelays delays = EstimateOf(drive, rigid, TimesOf(drive.scene));
      const double error = ErrorOfUnit(drive, rigid, delays);
      EXPECT_LT(error, 3.0) << error_deg << " deg, " << offset_ms << " ms";
      sum_of_squares += error * error;
      ++count;
    }
  }
  EXPECT_LT(sum_of_squares, 2.0 * count);
}

TEST(RigDelaysTest, UnitOfKnownDistanceIsWithinItsDeviation) {
  for (const double offset_ms : {0.0, 15.0}) {
    SimulationOptions options = DriveOptions(RigPreset::kStereo);
    options.trigger_offset_ms = offset_ms;
    const Simulation drive = Simulate(options, WindingPath(40));
    Reconstruction rigid = AdjustRigid(drive);
    Sim3 metric;
    metric.scale = drive.ground_truth.sensor_from_rig[1]->translation.norm() /
                   rigid.sensor_from_rig[1]->translation.norm();
    TransformWorld(metric, &rigid);
    const CaptureTimes times = TimesOf(drive.scene);
    EXPECT_FALSE(EstimateOf(drive, rigid, times).unit.has_value());
    const RigDelays delays = EstimateOf(drive, rigid, times, {{0, 1}});
    EXPECT_LT(ErrorOfUnit(drive, rigid, delays), 3.0);
    EXPECT_LT(delays.unit->RelativeSigma(), 0.2);
  }
}

}  // namespace
}  // namespace mgsfm
