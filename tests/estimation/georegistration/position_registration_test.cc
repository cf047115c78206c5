// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/position_registration.h"

#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/prior_measurement.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

SimulationOptions DriveOptions(PathPreset path) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = path;
  options.num_frames = 30;
  options.frame_spacing_m = 2.0;
  options.pixel_noise_px = 0.5;
  return options;
}

// The largest distance of camera centers, without alignment.
double MaxDistance(const Simulation& simulation, const Reconstruction& model) {
  double most = 0.0;
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const int idx = static_cast<int>(i);
    most = std::max(
        most,
        (model.CamFromWorld(simulation.scene, idx)->Center() -
         simulation.ground_truth.CamFromWorld(simulation.scene, idx)->Center())
            .norm());
  }
  return most;
}

// Positions of an antenna on a mast.
PositionPriors AntennaPositions(const Simulation& simulation, double sigma_m,
                                double outlier_ratio) {
  PositionPriors priors = MeasuredPositions(simulation, sigma_m, outlier_ratio);
  for (size_t i = 0; i < priors.images.size(); ++i) {
    if (!priors.images[i]) continue;
    PositionMeasurement& prior = *priors.images[i];
    prior.cam_from_antenna = {ExpSO3({0.1, 1.5, 0.0}), {0.5, -1.1, 3.0}};
    prior.position += prior.LeverInWorld(simulation.cam_from_world[i]);
  }
  return priors;
}

const Sim3 kModelFromWorld{0.3, ExpSO3({0.4, -2.0, 0.7}), {10.0, -5.0, 3.0}};

TEST(PositionRegistrationTest, RecoversTheWorldDespiteOutliers) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  Reconstruction model = simulation.ground_truth;
  TransformWorld(kModelFromWorld, &model);
  const PositionPriors priors = MeasuredPositions(simulation, 0.1, 0.3);
  auto [summary, used] = RegisterToPriors(simulation.scene, priors, {}, &model);
  EXPECT_TRUE(summary.is_registered);
  EXPECT_EQ(summary.message, "");
  EXPECT_EQ(summary.num_priors, 30);
  EXPECT_LT(MaxDistance(simulation, model), 0.15);
  EvaluatePositions(simulation.scene, priors, used, model, &summary);
  EXPECT_EQ(summary.num_used + static_cast<int>(summary.outliers.size()), 30);
  EXPECT_GE(summary.outliers.size(), 4u);
  for (const PositionPriorSummary::Outlier& outlier : summary.outliers) {
    EXPECT_GT(outlier.distance, 15.0);
  }
  EXPECT_NEAR(*summary.rms, 0.1 * std::sqrt(3.0), 0.06);
}

// The lever is in meters in a model of any scale.
TEST(PositionRegistrationTest, AntennasNeedNotBeAtTheCamera) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  PositionPriors priors = AntennaPositions(simulation, 1e-4, 0.3);
  Reconstruction model = simulation.ground_truth;
  TransformWorld(kModelFromWorld, &model);
  auto [summary, used] = RegisterToPriors(simulation.scene, priors, {}, &model);
  EXPECT_LT(MaxDistance(simulation, model), 1e-3);
  EvaluatePositions(simulation.scene, priors, used, model, &summary);
  EXPECT_LT(*summary.rms, 1e-3);
  // The same positions cannot be those of the camera.
  for (auto& prior : priors.images) {
    if (prior) prior->cam_from_antenna = Rigid3();
  }
  TransformWorld(kModelFromWorld, &model);
  RegisterToPriors(simulation.scene, priors, {}, &model);
  EXPECT_GT(MaxDistance(simulation, model), 0.5);
}

// The few positions within the bound outweigh the others.
TEST(PositionRegistrationTest, MostPositionsMayBeOutliers) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  const PositionPriors priors = MeasuredPositions(simulation, 0.1, 0.65);
  const auto distance = [&](OutlierRule rule) {
    Reconstruction model = simulation.ground_truth;
    TransformWorld(kModelFromWorld, &model);
    RegisterToPriors(simulation.scene, priors, {{}, false, 0, rule}, &model);
    return MaxDistance(simulation, model);
  };
  EXPECT_LT(distance(OutlierRule::kFixedBound), 0.3);
  EXPECT_GT(distance(OutlierRule::kNone), 1.0);
}

TEST(PositionRegistrationTest, LeastSquaresUsesAllPositions) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  Reconstruction model = simulation.ground_truth;
  TransformWorld(kModelFromWorld, &model);
  const PositionRegistration registration = RegisterToPriors(
      simulation.scene, MeasuredPositions(simulation, 0.1, 0.0),
      {{}, false, 0, OutlierRule::kNone}, &model);
  int num_used = 0;
  for (const auto& prior : registration.used.images) num_used += prior ? 1 : 0;
  EXPECT_EQ(num_used, 30);
  EXPECT_LT(MaxDistance(simulation, model), 0.15);
}

TEST(PositionRegistrationTest, MetricModelKeepsItsUnit) {
  Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  Reconstruction model = simulation.ground_truth;
  TransformWorld({1.0, kModelFromWorld.rotation, {1.0, 2.0, 3.0}}, &model);
  PositionPriors priors = MeasuredPositions(simulation, 0.1, 0.0);
  for (auto& prior : priors.images) {
    if (prior) prior->position *= 1.01;
  }
  RegisterToPriors(simulation.scene, priors, {{}, /*is_metric=*/true}, &model);
  EXPECT_NEAR(model.sensor_from_rig[1]->translation.norm(),
              simulation.ground_truth.sensor_from_rig[1]->translation.norm(),
              1e-9);
}

// Upright cameras determine the rotation about a straight path. The simulated
// world has y down, so it is rotated to z up.
TEST(PositionRegistrationTest, CamerasOnALineAreUpright) {
  Simulation simulation = Simulate(DriveOptions(PathPreset::kStraight));
  const Sim3 earth_from_world{
      1.0, Eigen::Quaterniond(Eigen::AngleAxisd(-0.5 * kPi, Vector3d::UnitX())),
      Vector3d::Zero()};
  ASSERT_LT(
      (earth_from_world * Vector3d(0.0, -1.0, 0.0) - Vector3d::UnitZ()).norm(),
      1e-12);
  PositionPriors priors = MeasuredPositions(simulation, 0.01, 0.0);
  for (auto& prior : priors.images) {
    if (prior) prior->position = earth_from_world * prior->position;
  }
  priors.origin_wgs84 = Vector3d(49.0, 8.4, 0.0);
  TransformWorld(earth_from_world, &simulation.ground_truth);
  Reconstruction model = simulation.ground_truth;
  TransformWorld(kModelFromWorld, &model);
  const PositionPriorSummary summary =
      RegisterToPriors(simulation.scene, priors, {}, &model).summary;
  EXPECT_NE(summary.message.find("upright"), std::string::npos);
  EXPECT_LT(AngleBetween(model.rig_from_world[0]->rotation,
                         simulation.ground_truth.rig_from_world[0]->rotation),
            DegToRad(1.0));
}

TEST(PositionRegistrationTest, WithoutExtentTheModelKeepsItsWorld) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kStanding));
  Reconstruction model = simulation.ground_truth;
  const PositionRegistration registration = RegisterToPriors(
      simulation.scene, MeasuredPositions(simulation, 0.5, 0.0), {}, &model);
  EXPECT_FALSE(registration.summary.is_registered);
  EXPECT_NE(registration.summary.message, "");
  EXPECT_TRUE(registration.used.IsEmpty());
  EXPECT_EQ(MaxDistance(simulation, model), 0.0);
}

TEST(PositionRegistrationTest, MapperPlacesTheModel) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph,
                 MeasuredPositions(simulation, 0.3, 0.1)},
                MapperOptions(), Context());
  ASSERT_EQ(result.models.size(), 1u);
  const MapperModel& model = result.models[0];
  ASSERT_TRUE(model.position_priors.has_value());
  EXPECT_TRUE(model.position_priors->is_registered);
  // The mean of 30 positions with 0.3 m is more accurate than each of them.
  EXPECT_LT(MaxDistance(simulation, model.reconstruction), 0.3);
  EXPECT_LT(model.position_priors->outliers.size(), 8u);
}

TEST(PositionRegistrationTest, MapperPlacesTheModelByItsAntenna) {
  const Simulation simulation = Simulate(DriveOptions(PathPreset::kLoop));
  const auto error_of = [&](const PositionPriors& priors) {
    const MapperResult result =
        RunMapper({simulation.scene, simulation.view_graph, priors},
                  MapperOptions(), Context());
    return MaxDistance(simulation, result.models.at(0).reconstruction);
  };
  EXPECT_LT(error_of(AntennaPositions(simulation, 0.05, 0.1)),
            1.5 * error_of(MeasuredPositions(simulation, 0.05, 0.1)));
}

}  // namespace
}  // namespace mgsfm
