// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/deviations.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

PoseVector NormalVector(Random* random) {
  PoseVector v;
  for (int i = 0; i < 6; ++i) v[i] = random->Normal();
  return v;
}

// Frames of two images whose relative pose is measured with a known covariance.
struct Measured {
  std::vector<PoseVector> values;  // sensor 1 relative to sensor 0
  PoseMatrix covariance;
};

Measured Measure(const DeviationSigma& sigma, int num_frames, uint64_t seed) {
  Random random(seed);
  Measured measured;
  PoseVector noise;
  noise << 0.002, 0.001, 0.003, 0.02, 0.03, 0.01;
  measured.covariance = noise.cwiseAbs2().asDiagonal();
  const PoseVector sigmas = PriorVariances(sigma).cwiseSqrt();
  for (int i = 0; i < num_frames; ++i) {
    measured.values.push_back(
        sigmas.cwiseProduct(NormalVector(&random) - NormalVector(&random)) +
        noise.cwiseProduct(NormalVector(&random)));
  }
  return measured;
}

// The deviations of both images with their posterior covariance under the
// assumed sigmas.
std::vector<FrameDeviations> Posterior(
    const Measured& measured, const std::vector<DeviationSigma>& sigmas) {
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(12, 12);
  prior.topLeftCorner<6, 6>() = PriorVariances(sigmas[0]).asDiagonal();
  prior.bottomRightCorner<6, 6>() = PriorVariances(sigmas[1]).asDiagonal();
  Eigen::MatrixXd difference(6, 12);
  difference << -PoseMatrix::Identity(), PoseMatrix::Identity();
  const Eigen::MatrixXd gain =
      prior * difference.transpose() *
      (difference * prior * difference.transpose() + measured.covariance)
          .inverse();
  std::vector<FrameDeviations> frames;
  for (const PoseVector& value : measured.values) {
    const Eigen::VectorXd x = gain * value;
    FrameDeviations frame;
    frame.images = {{0, 0, x.head<6>()}, {1, 1, x.tail<6>()}};
    frame.covariance = prior - gain * difference * prior;
    frames.push_back(std::move(frame));
  }
  return frames;
}

TEST(DeviationsTest, SigmasAreEstimated) {
  const DeviationSigma truth = {0.004, 0.05};
  const Measured measured = Measure(truth, 400, 3);
  for (const DeviationSigma& start :
       {DeviationSigma{0.05, 0.005}, DeviationSigma{0.0005, 1.0}}) {
    std::vector<DeviationSigma> sigmas(2, start);
    std::vector<ObservedFraction> fractions;
    for (int round = 0; round < 15; ++round) {
      sigmas =
          UpdateSigmas(Posterior(measured, sigmas), {0, 0}, sigmas, &fractions);
    }
    for (const DeviationSigma& sigma : sigmas) {
      EXPECT_NEAR(sigma.rotation_rad / truth.rotation_rad, 1.0, 0.15);
      EXPECT_NEAR(sigma.position / truth.position, 1.0, 0.15);
    }
  }
}

TEST(DeviationsTest, SigmasOfARigidRigVanish) {
  const Measured measured = Measure({0.0, 0.0}, 400, 5);
  std::vector<DeviationSigma> sigmas(2, DeviationSigma{0.01, 0.1});
  std::vector<ObservedFraction> fractions;
  for (int round = 0; round < 10; ++round) {
    sigmas =
        UpdateSigmas(Posterior(measured, sigmas), {0, 0}, sigmas, &fractions);
  }
  // Noise can look like a small deviation.
  EXPECT_LT(sigmas[0].rotation_rad, 5e-4);
  EXPECT_LT(sigmas[0].position, 5e-3);
}

TEST(DeviationsTest, SensorsWithFewImagesUseTheSigmaOfTheirRig) {
  const Measured measured = Measure({0.004, 0.05}, 100, 7);
  const std::vector<DeviationSigma> sigmas(3, DeviationSigma{0.004, 0.05});
  std::vector<FrameDeviations> deviations = Posterior(measured, sigmas);
  deviations.back().images[1].sensor_idx = 2;
  std::vector<ObservedFraction> fractions;
  const std::vector<DeviationSigma> updated =
      UpdateSigmas(deviations, {0, 0, 0}, sigmas, &fractions);
  EXPECT_GT(updated[2].position, 0.8 * updated[1].position);
  EXPECT_LT(updated[2].position, 1.25 * updated[1].position);
}

// The mean is found in one step, however much the prior shrinks deviations.
TEST(DeviationsTest, OneStepFindsTheMean) {
  const DeviationSigma truth = {0.004, 0.05};
  Measured measured = Measure(truth, 400, 9);
  PoseVector shift;
  shift << 0.01, -0.02, 0.03, 0.1, 0.2, -0.3;
  for (PoseVector& value : measured.values) value += shift;
  const PoseMatrix jacobian = PoseMatrix::Identity();
  Eigen::VectorXd mask = Eigen::VectorXd::Zero(12);
  mask.tail<6>().setOnes();
  for (const double factor : {0.1, 1.0, 10.0}) {
    const std::vector<DeviationSigma> assumed(
        2, {factor * truth.rotation_rad, factor * truth.position});
    CalibrationEquations equations(2);
    for (const FrameDeviations& frame : Posterior(measured, assumed)) {
      equations.AddFrame(
          frame, {0, 1},
          {PriorVariances(assumed[0]), PriorVariances(assumed[1])},
          {jacobian, jacobian});
    }
    const Eigen::VectorXd step = equations.Solve(mask);
    EXPECT_TRUE(step.head<6>().isZero(0.0));
    const PoseVector error = step.tail<6>() - shift;
    EXPECT_LT(error.head<3>().norm(), 5.0 * 0.011 / 20.0) << factor;
    EXPECT_LT(error.tail<3>().norm(), 5.0 * 0.13 / 20.0) << factor;
  }
}

TEST(DeviationsTest, PriorsDetermineTheMean) {
  CalibrationEquations equations(1);
  const PoseVector change = PoseVector::LinSpaced(0.1, 0.6);
  equations.AddPrior(0, change, PoseVector::Constant(0.01));
  Eigen::VectorXd mask = Eigen::VectorXd::Ones(6);
  mask[2] = 0.0;
  const Eigen::VectorXd step = equations.Solve(mask);
  EXPECT_NEAR(step[1], 0.2, 1e-8);
  EXPECT_EQ(step[2], 0.0);
}

// Against differences of expected poses.
TEST(RigCalibrationTest, JacobianIsThatOfExpectedPoses) {
  SimulationOptions simulated;
  simulated.num_frames = 12;
  const Simulation simulation = Simulate(simulated);
  const Scene& scene = simulation.scene;
  Reconstruction rig = simulation.ground_truth;
  const RigMotion motion{ExpSO3(Eigen::Vector3d(0.01, 0.02, -0.01)),
                         {0.1, -0.2, 0.3}};
  rig.motions.assign(scene.images.size(), motion);
  const int image_idx = scene.frames[5].image_idxs[1];
  const int sensor_idx = scene.images[image_idx].sensor_idx;
  ASSERT_FALSE(scene.IsReference(sensor_idx));
  Rigid3& sensor = *rig.sensor_from_rig[sensor_idx];
  const Rigid3 expected = *ExpectedPoses(scene, rig)[image_idx];
  const PoseMatrix jacobian = ExpectedPoseJacobian(scene, rig, image_idx);
  constexpr double kStep = 1e-6;
  const Rigid3 kept = sensor;
  for (int k = 0; k < 6; ++k) {
    sensor = kept;
    if (k < 3) {
      sensor.rotation =
          ExpSO3(kStep * Eigen::Vector3d::Unit(k)) * kept.rotation;
    } else {
      sensor.translation[k - 3] += kStep;
    }
    const PoseVector difference =
        UpdateBetween(expected, *ExpectedPoses(scene, rig)[image_idx]) / kStep;
    EXPECT_LT((difference - jacobian.col(k)).norm(),
              1e-3 * (1.0 + difference.norm()))
        << k;
  }
}

}  // namespace
}  // namespace mgsfm
