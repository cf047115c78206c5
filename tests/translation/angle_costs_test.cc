// SPDX-License-Identifier: BSD-3-Clause
#include "translation/angle_costs.h"

#include <gtest/gtest.h>

#include "mgsfm/base/random.h"
#include "mgsfm/geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d RandomVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

// Compares all Jacobians with central differences.
void CheckJacobians(const ceres::CostFunction& cost, uint64_t seed) {
  Random random(seed);
  const int num_blocks = static_cast<int>(cost.parameter_block_sizes().size());
  const int num_residuals = cost.num_residuals();
  std::vector<Vector3d> x(num_blocks);
  std::vector<std::vector<double>> jacobians(num_blocks);
  std::vector<double*> parameters, outputs;
  for (int b = 0; b < num_blocks; ++b) {
    x[b] = 2.0 * RandomVector(&random);
    jacobians[b].resize(3 * num_residuals);
    parameters.push_back(x[b].data());
    outputs.push_back(jacobians[b].data());
  }
  Eigen::VectorXd residuals(num_residuals), plus(num_residuals),
      minus(num_residuals);
  ASSERT_TRUE(
      cost.Evaluate(parameters.data(), residuals.data(), outputs.data()));
  ASSERT_TRUE(cost.Evaluate(parameters.data(), plus.data(), nullptr));
  EXPECT_EQ(residuals, plus);
  constexpr double kStep = 1e-5;
  for (int b = 0; b < num_blocks; ++b) {
    for (int c = 0; c < 3; ++c) {
      const double value = x[b][c];
      x[b][c] = value + kStep;
      ASSERT_TRUE(cost.Evaluate(parameters.data(), plus.data(), nullptr));
      x[b][c] = value - kStep;
      ASSERT_TRUE(cost.Evaluate(parameters.data(), minus.data(), nullptr));
      x[b][c] = value;
      for (int r = 0; r < num_residuals; ++r) {
        EXPECT_NEAR(jacobians[b][3 * r + c],
                    (plus[r] - minus[r]) / (2.0 * kStep), 1e-8);
      }
    }
  }
}

LinearBaseline RandomBaseline(int num_blocks, Random* random) {
  LinearBaseline baseline;
  baseline.constant = RandomVector(random);
  baseline.num_blocks = num_blocks;
  for (int b = 0; b < num_blocks; ++b) {
    baseline.coefficients[b] = (b % 2 == 0 ? 1.0 : -1.0) *
                               ExpSO3(RandomVector(random)).toRotationMatrix();
  }
  return baseline;
}

TEST(AngleCostsTest, JacobiansMatchDifferences) {
  for (uint64_t seed = 0; seed < 5; ++seed) {
    Random random(seed);
    const Vector3d direction = RandomVector(&random).normalized();
    for (int num_blocks = 1; num_blocks <= 4; ++num_blocks) {
      const LinearBaseline baseline = RandomBaseline(num_blocks, &random);
      CheckJacobians(BaselineDirectionCost(baseline, direction, 0.7, 0.1),
                     seed);
      CheckJacobians(BaselineLengthCost(baseline, 1.3, 0.7, 0.1), seed);
      CheckJacobians(ZeroBaselineCost(baseline, 0.7), seed);
      CheckJacobians(
          LinearRowCost(Eigen::VectorXd::LinSpaced(3 * num_blocks, -1, 2), 0.4,
                        0.7),
          seed);
    }
    const Matrix3d world_from_cam =
        ExpSO3(RandomVector(&random)).toRotationMatrix();
    CheckJacobians(PointDirectionCost(direction, &world_from_cam), seed);
    CheckJacobians(
        PointDirectionFixedSensorCost(direction, RandomVector(&random)), seed);
  }
}

TEST(AngleCostsTest, ZeroBaselineIsHarmless) {
  LinearBaseline baseline;
  baseline.num_blocks = 1;
  baseline.coefficients[0] = Matrix3d::Identity();
  const BaselineDirectionCost cost(baseline, Vector3d::UnitX(), 1.0, 1e-4);
  const Vector3d zero = Vector3d::Zero();
  const double* parameters[] = {zero.data()};
  Vector3d residual;
  Eigen::Matrix3d jacobian;
  double* jacobians[] = {jacobian.data()};
  ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));
  EXPECT_TRUE(residual.allFinite());
  EXPECT_TRUE(jacobian.allFinite());
}

TEST(AngleCostsTest, PointInTheCentreIsRejected) {
  const Vector3d center(1.0, 2.0, 3.0);
  const double* parameters[] = {center.data(), center.data()};
  Vector3d residual;
  const PointDirectionFixedSensorCost cost(Vector3d::UnitX(), Vector3d::Zero());
  EXPECT_FALSE(cost.Evaluate(parameters, residual.data(), nullptr));
}

}  // namespace
}  // namespace mgsfm
