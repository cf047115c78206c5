// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "geometry/epipolar.h"

namespace mgsfm::internal {

// A relative pose in the form used by loops over matches.
struct EpipolarPose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d direction;  // unit
};

// Intermediate quantities of one match, named as in geometry/epipolar.h.
struct EpipolarTerms {
  Eigen::Vector3d a;  // R f1
  double ta;          // t . a
  double tf;          // t . f2
  double e;           // f2 . (t x a)
  double s;           // squared norm of the gradient of e w.r.t. both rays

  EpipolarTerms(const EpipolarPose& pose, const Eigen::Vector3d& ray1,
                const Eigen::Vector3d& ray2)
      : a(pose.rotation * ray1),
        ta(pose.direction.dot(a)),
        tf(pose.direction.dot(ray2)),
        e(pose.direction.dot(a.cross(ray2))),
        s(2.0 - ta * ta - tf * tf - 2.0 * e * e) {}

  // For smaller values both rays lie on the baseline to 1e-7 rad, and the error
  // is undefined.
  static constexpr double kMinSquaredGradient = 1e-14;
  bool IsDefined() const { return s > kMinSquaredGradient; }

  // r^2 <= max_squared_error, without a division.
  bool IsWithin(double max_squared_error) const {
    return e * e <= max_squared_error * s || !IsDefined();
  }
  double SquaredError() const { return IsDefined() ? e * e / s : 0.0; }

  bool IsInFront(const Eigen::Vector3d& ray2, double tolerance) const {
    const double sin_a = std::sqrt(std::max(0.0, 1.0 - ta * ta));
    const double sin_f = std::sqrt(std::max(0.0, 1.0 - tf * tf));
    // Near the epipoles noise can move a ray across the baseline.
    const bool same_side =
        a.dot(ray2) > ta * tf || std::min(sin_a, sin_f) < tolerance;
    return same_side && sin_a * tf - ta * sin_f >= -tolerance;
  }
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
