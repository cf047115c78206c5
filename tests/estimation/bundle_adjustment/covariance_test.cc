// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"

namespace mgsfm {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

SimulationOptions Drive(RigPreset rig, PathPreset path) {
  SimulationOptions options = SmallScene(rig, path);
  options.num_frames = 6;
  options.pixel_noise_px = 0.5;
  return options;
}

Reconstruction Adjusted(const Simulation& simulation,
                        const BundleAdjustmentOptions& options) {
  return AdjustBundle(simulation.scene, simulation.ground_truth, options,
                      Threads(2))
      .estimate;
}

// For independent noise, the mean of d^T C^-1 d is the number of
// coordinates: 6. Its standard deviation over 40 draws is sqrt(12 / 40) = 0.55.
TEST(CovarianceTest, PredictsTheErrorsOfRepeatedAdjustments) {
  SimulationOptions simulated = Drive(RigPreset::kStereo, PathPreset::kCurve);
  simulated.pixel_noise_px = 0.0;
  simulated.extrinsics_are_known = false;
  Simulation simulation = Simulate(simulated);
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-9;
  options.loss_scale_px = 100.0;  // equal weights for all observations
  options.loss_sigma_factor = 100.0;
  const int sensor_idx = 1, frame_idx = 5;
  constexpr int kNumDraws = 40;
  constexpr double kSigmaPx = 0.5;
  Random random(5);
  double sensor_sum = 0.0, frame_sum = 0.0;
  for (int i = 0; i < kNumDraws; ++i) {
    DrawNoise(kSigmaPx, &random, &simulation);
    const Reconstruction model = Adjusted(simulation, options);
    const CovarianceResult covariances =
        ComputeCovariances(simulation.scene, model, options, Threads(2));
    ASSERT_TRUE(covariances.is_usable);
    // sigma_px is too small: it ignores the degrees of freedom of the poses.
    const double ratio = kSigmaPx / covariances.sigma_px;
    const Rigid3& sensor = *model.sensor_from_rig[sensor_idx];
    const Rigid3& true_sensor =
        *simulation.ground_truth.sensor_from_rig[sensor_idx];
    Vector6d error;
    error << LogSO3(sensor.rotation * true_sensor.rotation.conjugate()),
        sensor.translation - true_sensor.translation;
    const auto squared_distance = [&](const PoseMatrix& covariance) {
      // A coordinate can be fixed for the scale.
      const PoseMatrix scaled =
          ratio * ratio * covariance + 1e-14 * PoseMatrix::Identity();
      return error.dot(scaled.ldlt().solve(error));
    };
    sensor_sum += squared_distance(*covariances.sensors[sensor_idx]);
    const Rigid3& frame = *model.rig_from_world[frame_idx];
    const Rigid3& true_frame =
        *simulation.ground_truth.rig_from_world[frame_idx];
    error << LogSO3(frame.rotation * true_frame.rotation.conjugate()),
        frame.Center() - true_frame.Center();
    const auto& covariance = *covariances.frames[frame_idx];
    if (covariance.isZero(0.0)) continue;
    frame_sum += squared_distance(covariance);
  }
  EXPECT_NEAR(sensor_sum / kNumDraws, 6.0, 2.5);
  EXPECT_LT(frame_sum / kNumDraws, 8.5);
}

TEST(CovarianceTest, ReportsItsGauge) {
  SimulationOptions simulated = Drive(RigPreset::kStereo, PathPreset::kCurve);
  BundleAdjustmentOptions options;
  for (const bool is_metric : {false, true}) {
    simulated.extrinsics_are_known = is_metric;
    const Simulation simulation = Simulate(simulated);
    const CovarianceResult covariances = ComputeCovariances(
        simulation.scene, Adjusted(simulation, options), options, Threads(1));
    ASSERT_TRUE(covariances.is_usable);
    EXPECT_EQ(covariances.scale_is_fixed, !is_metric);
    ASSERT_TRUE(covariances.fixed_frame_idx.has_value());
    EXPECT_TRUE(covariances.frames[*covariances.fixed_frame_idx]->isZero(0.0));
    EXPECT_EQ(covariances.sensors[1]->isZero(0.0), is_metric);
    EXPECT_TRUE(covariances.unobservable.empty());
    EXPECT_NEAR(covariances.sigma_px, 0.5, 0.15);
  }
}

// A camera that shares no point with the others, on a drive without rotation:
// nothing determines its position in the rig.
TEST(CovarianceTest, UnobservableDirectionsAreListed) {
  SimulationOptions simulated =
      Drive(RigPreset::kKitti360, PathPreset::kStraight);
  simulated.match_different_sensors = false;
  Simulation simulation = Simulate(simulated);
  // No point joins two sensors.
  for (Point3D& point : simulation.ground_truth.points) {
    const int sensor =
        simulation.scene.images[point.track.front().image_idx].sensor_idx;
    auto& track = point.track;
    track.erase(std::remove_if(
                    track.begin(), track.end(),
                    [&](const Observation& o) {
                      return simulation.scene.images[o.image_idx].sensor_idx !=
                             sensor;
                    }),
                track.end());
  }
  BundleAdjustmentOptions options;
  const CovarianceResult covariances = ComputeCovariances(
      simulation.scene, simulation.ground_truth, options, Threads(2));
  ASSERT_TRUE(covariances.is_usable);
  int num_shifts = 0;
  for (const UnobservableDirection& direction : covariances.unobservable) {
    num_shifts += direction.is_sensor && !direction.is_rotation;
  }
  EXPECT_GE(num_shifts, 3);
}

}  // namespace
}  // namespace mgsfm
