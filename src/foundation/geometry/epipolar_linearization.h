// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "geometry/epipolar.h"
#include "geometry/epipolar_terms.h"

namespace mgsfm::internal {

// sum of log(x_i) for x_i >= 1, with few logarithms.
class LogSum {
 public:
  void Add(double x) {
    product_ *= x;
    if (product_ > 1e100) Fold();
  }
  double Total() {
    Fold();
    return sum_;
  }

 private:
  void Fold() {
    sum_ += std::log(product_);
    product_ = 1.0;
  }
  double product_ = 1.0;
  double sum_ = 0.0;
};

// The normal equations of the Cauchy-weighted Sampson errors of all matches
// over the five degrees of freedom of a pose.
struct PoseSums {
  Eigen::Matrix<double, 5, 5> hessian;
  Eigen::Matrix<double, 5, 1> gradient;
  double cost;
};

// Processes four matches at a time. Compiled with and without AVX2 and FMA, so
// results on different processors may differ by rounding. The columns of
// `basis` are normal to the direction of the pose.
PoseSums SumSampsonTerms(const RayMatches& matches, const EpipolarPose& pose,
                         const Eigen::Matrix<double, 3, 2>& basis,
                         double loss_scale);

}  // namespace mgsfm::internal
