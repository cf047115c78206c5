// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <utility>
#include <vector>

namespace mgsfm {

// A difference of positions as a linear function of parameter blocks of three
// coordinates: offset + sum_k coefficients_k x_k.
struct LinearDifference {
  struct Term {
    double* block = nullptr;
    Eigen::Matrix3d coefficients;
  };
  std::vector<Term> terms;  // each block once
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();

  void Add(double* block, const Eigen::Matrix3d& coefficients) {
    for (Term& term : terms) {
      if (term.block != block) continue;
      term.coefficients += coefficients;
      return;
    }
    terms.push_back({block, coefficients});
  }
  Eigen::Vector3d Value() const {
    Eigen::Vector3d value = offset;
    for (const Term& term : terms) {
      value += term.coefficients * Eigen::Vector3d::Map(term.block);
    }
    return value;
  }
  std::vector<double*> Blocks() const {
    std::vector<double*> blocks;
    for (const Term& term : terms) blocks.push_back(term.block);
    return blocks;
  }
};

// The residual weight (direction - d C) over the blocks of C and the scale d,
// or weight C over the blocks of C if there is no direction.
class DifferenceCost : public ceres::CostFunction {
 public:
  DifferenceCost(LinearDifference difference, const Eigen::Vector3d& direction,
                 double weight)
      : DifferenceCost(std::move(difference), weight) {
    direction_ = direction;
    has_scale_ = true;
    mutable_parameter_block_sizes()->push_back(1);
  }
  DifferenceCost(LinearDifference difference, double weight)
      : difference_(std::move(difference)), weight_(weight) {
    set_num_residuals(3);
    mutable_parameter_block_sizes()->assign(difference_.terms.size(), 3);
  }

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const size_t num_terms = difference_.terms.size();
    Eigen::Vector3d C = difference_.offset;
    for (size_t k = 0; k < num_terms; ++k) {
      C += difference_.terms[k].coefficients * Eigen::Vector3d::Map(blocks[k]);
    }
    const double d = has_scale_ ? blocks[num_terms][0] : -1.0;
    Eigen::Vector3d::Map(residuals) = weight_ * (direction_ - d * C);
    if (jacobians == nullptr) return true;
    for (size_t k = 0; k < num_terms; ++k) {
      if (jacobians[k] == nullptr) continue;
      Rows::Map(jacobians[k]) =
          -weight_ * d * difference_.terms[k].coefficients;
    }
    if (has_scale_ && jacobians[num_terms] != nullptr) {
      Eigen::Vector3d::Map(jacobians[num_terms]) = -weight_ * C;
    }
    return true;
  }

 private:
  const LinearDifference difference_;
  const double weight_;
  Eigen::Vector3d direction_ = Eigen::Vector3d::Zero();
  bool has_scale_ = false;
};

// weight (d length - 1). Block: the scale d.
class LengthCost : public ceres::SizedCostFunction<1, 1> {
 public:
  LengthCost(double length, double weight) : length_(length), weight_(weight) {}
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = weight_ * (blocks[0][0] * length_ - 1.0);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = weight_ * length_;
    }
    return true;
  }

 private:
  const double length_;
  const double weight_;
};

// weight sum_k row_k . x_k over the blocks.
class RowCost : public ceres::CostFunction {
 public:
  RowCost(std::vector<Eigen::Vector3d> row, double weight)
      : row_(std::move(row)), weight_(weight) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->assign(row_.size(), 3);
  }
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = 0.0;
    for (size_t k = 0; k < row_.size(); ++k) {
      residuals[0] += weight_ * row_[k].dot(Eigen::Vector3d::Map(blocks[k]));
      if (jacobians == nullptr || jacobians[k] == nullptr) continue;
      Eigen::Vector3d::Map(jacobians[k]) = weight_ * row_[k];
    }
    return true;
  }

 private:
  const std::vector<Eigen::Vector3d> row_;
  const double weight_;
};

}  // namespace mgsfm
