// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <array>

namespace mgsfm {

// Residuals on directions, with analytic derivatives. Rotations are constant;
// parameter blocks are frame centres, internal translations and points.

// A baseline as a function of its parameter blocks x_b of size 3:
//   C = constant + sum_b coefficients[b] x_b.
struct LinearBaseline {
  static constexpr int kMaxNumBlocks = 4;
  Eigen::Vector3d constant = Eigen::Vector3d::Zero();
  std::array<Eigen::Matrix3d, kMaxNumBlocks> coefficients;
  int num_blocks = 0;
};

// weight * (direction - C / |C|): eq. (16) of MGSfM, not bilinear. |C| is
// smoothed to sqrt(|C|^2 + min_length^2), so the residual is defined everywhere
// and its derivative bounded.
class BaselineDirectionCost : public ceres::CostFunction {
 public:
  BaselineDirectionCost(const LinearBaseline& baseline,
                        const Eigen::Vector3d& direction, double weight,
                        double min_length);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const LinearBaseline baseline_;
  const Eigen::Vector3d direction_;
  const double weight_;
  const double min_length_;
};

// weight * log(|C| / length), with |C| smoothed as above.
class BaselineLengthCost : public ceres::CostFunction {
 public:
  BaselineLengthCost(const LinearBaseline& baseline, double length,
                     double weight, double min_length);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const LinearBaseline baseline_;
  const double length_;
  const double weight_;
  const double min_length_;
};

// weight * C, for pairs without parallax.
class ZeroBaselineCost : public ceres::CostFunction {
 public:
  ZeroBaselineCost(const LinearBaseline& baseline, double weight);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const LinearBaseline baseline_;
  const double weight_;
};

// weight * (sum_b row_b . x_b - value): holds one combination of blocks.
class LinearRowCost : public ceres::CostFunction {
 public:
  // `row` has three coefficients for each block.
  LinearRowCost(const Eigen::VectorXd& row, double value, double weight);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Eigen::VectorXd row_;
  const double value_;
  const double weight_;
};

// ray - v / |v| with v = p - (c - R t): eq. (18) of MGSfM for a sensor with
// free translation t; blocks c, t, p. R is world_from_cam and must outlive it.
class PointDirectionCost : public ceres::SizedCostFunction<3, 3, 3, 3> {
 public:
  PointDirectionCost(const Eigen::Vector3d& ray_in_world,
                     const Eigen::Matrix3d* world_from_cam)
      : ray_(ray_in_world), world_from_cam_(world_from_cam) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Eigen::Vector3d ray_;
  const Eigen::Matrix3d* world_from_cam_;
};

// The same for a fixed sensor, whose centre is c + offset; blocks c, p.
class PointDirectionFixedSensorCost : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  PointDirectionFixedSensorCost(const Eigen::Vector3d& ray_in_world,
                                const Eigen::Vector3d& offset)
      : ray_(ray_in_world), offset_(offset) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Eigen::Vector3d ray_;
  const Eigen::Vector3d offset_;
};

}  // namespace mgsfm
