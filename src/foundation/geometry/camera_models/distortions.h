// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "geometry/camera_models/radial_profiles.h"

// Distortions of the image plane in units of the focal length. A distortion is
// a struct with
//   kNumParams
//   Distort(k, m, jacobians)  the distorted point; jacobians may be null
//   IsInjectiveTo(k, radius)  a sufficient condition for injectivity on the
//                             disc of this radius: the symmetric part of the
//                             Jacobian is positive definite on the whole disc
//   Undistort(k, m, max)      the preimage of m in the injective region, closer
//                             than max to the center
namespace mgsfm::internal {

template <int N>
struct DistortionJacobians {
  Eigen::Matrix2d point;
  Eigen::Matrix<double, 2, N> params;
};

// Damped Newton for Distort(m) = target. The Jacobian is regular and the
// solution unique where IsInjectiveTo holds, so steps are halved until they
// stay in this region and reduce the error.
template <class Distortion>
std::optional<Eigen::Vector2d> InvertDistortion(const double* k,
                                                const Eigen::Vector2d& target,
                                                double max_radius) {
  // Newton converges in a few steps; more halvings exhaust the precision. Steps
  // that creep to the end of the region share them: there is no solution.
  constexpr int kMaxHalvings = std::numeric_limits<double>::digits;
  const auto is_inside = [&](const Eigen::Vector2d& m) {
    return m.norm() < max_radius && Distortion::IsInjectiveTo(k, m.norm());
  };
  const double unit = std::max(1.0, target.norm());
  Eigen::Vector2d m = target;
  for (int i = 0; i < kMaxHalvings && !is_inside(m); ++i) m *= 0.5;
  if (!is_inside(m)) return std::nullopt;

  DistortionJacobians<Distortion::kNumParams> jacobians;
  Eigen::Vector2d error = Distortion::Distort(k, m, &jacobians) - target;
  int num_halvings = 0;
  for (int iteration = 0; iteration < 100; ++iteration) {
    if (error.norm() <= kInverseTolerance * unit) return m;
    Eigen::Vector2d step = jacobians.point.inverse() * error;
    const auto is_better = [&](const Eigen::Vector2d& next) {
      return is_inside(next) &&
             (Distortion::Distort(k, next, nullptr) - target).norm() <
                 error.norm();
    };
    while (num_halvings < kMaxHalvings && !is_better(m - step)) {
      step *= 0.5;
      ++num_halvings;
    }
    if (num_halvings == kMaxHalvings) break;
    m -= step;
    error = Distortion::Distort(k, m, &jacobians) - target;
  }
  if (!(error.norm() <= kMaxInverseError * unit)) return std::nullopt;
  return m;
}

// A purely radial distortion.
template <class Profile>
struct RadialDistortion {
  static constexpr int kNumParams = Profile::kNumParams;

  static Eigen::Vector2d Distort(const double* k, const Eigen::Vector2d& m,
                                 DistortionJacobians<kNumParams>* jacobians) {
    const auto scale = Profile::Evaluate(k, m.squaredNorm());
    if (jacobians != nullptr) {
      jacobians->point = scale.value * Eigen::Matrix2d::Identity() +
                         2.0 * scale.slope * m * m.transpose();
      jacobians->params = m * scale.params;
    }
    return scale.value * m;
  }

  static bool IsInjectiveTo(const double* k, double radius) {
    return Profile::IsIncreasing(k, radius * radius, 0.0);
  }

  static std::optional<Eigen::Vector2d> Undistort(const double* k,
                                                  const Eigen::Vector2d& m,
                                                  double max_radius) {
    const double distorted_radius = m.norm();
    if (distorted_radius == 0.0) return m;
    const std::optional<double> radius =
        Profile::Invert(k, distorted_radius, max_radius);
    if (!radius) return std::nullopt;
    return *radius / distorted_radius * m;
  }
};

// Non-radial offsets: 2 (q.m) m + r^2 q (decentering) and r^2 s + r^4 w (thin
// prism).
struct LateralTerms {
  Eigen::Vector2d q;
  Eigen::Vector2d s = Eigen::Vector2d::Zero();
  Eigen::Vector2d w = Eigen::Vector2d::Zero();

  Eigen::Vector2d Offset(const Eigen::Vector2d& m) const {
    const double r2 = m.squaredNorm();
    return 2.0 * q.dot(m) * m + r2 * (q + s + r2 * w);
  }
  // d Offset / d m.
  Eigen::Matrix2d Jacobian(const Eigen::Vector2d& m) const {
    const Eigen::Vector2d prism = 2.0 * (q + s) + 4.0 * m.squaredNorm() * w;
    return 2.0 * q.dot(m) * Eigen::Matrix2d::Identity() +
           2.0 * m * q.transpose() + prism * m.transpose();
  }
  // d Offset / d q. The derivatives w.r.t. s and w are r^2 I and r^4 I.
  static Eigen::Matrix2d JacobianQ(const Eigen::Vector2d& m) {
    return 2.0 * m * m.transpose() +
           m.squaredNorm() * Eigen::Matrix2d::Identity();
  }
  // Upper bound on how much the offset contracts any direction on this disc.
  double MaxShrink(double r) const {
    return r * (6.0 * q.norm() + 2.0 * s.norm() + 4.0 * r * r * w.norm());
  }
};

// Radial profile plus lateral terms, both functions of the undistorted point,
// with the parameters k1 k2 p1 p2 k3 k4 ... [sx1 sy1] and q = (p2, p1), s =
// (sx1, sy1).
template <class Profile, bool kHasPrism>
struct BrownDistortion {
  static constexpr int kNumRadial = Profile::kNumParams;
  static constexpr int kNumParams = kNumRadial + (kHasPrism ? 4 : 2);

  static Eigen::Vector2d Distort(const double* k, const Eigen::Vector2d& m,
                                 DistortionJacobians<kNumParams>* jacobians) {
    const LateralTerms lateral = Lateral(k);
    const double r2 = m.squaredNorm();
    const auto scale = Profile::Evaluate(RadialParams(k).data(), r2);
    if (jacobians != nullptr) {
      jacobians->point = scale.value * Eigen::Matrix2d::Identity() +
                         2.0 * scale.slope * m * m.transpose() +
                         lateral.Jacobian(m);
      for (int i = 0; i < kNumRadial; ++i) {
        jacobians->params.col(RadialIdx(i)) = scale.params[i] * m;
      }
      jacobians->params.template middleCols<2>(2) =
          LateralTerms::JacobianQ(m).rowwise().reverse();
      if constexpr (kHasPrism) {
        jacobians->params.template rightCols<2>() =
            r2 * Eigen::Matrix2d::Identity();
      }
    }
    return scale.value * m + lateral.Offset(m);
  }

  static bool IsInjectiveTo(const double* k, double radius) {
    return Profile::IsIncreasing(RadialParams(k).data(), radius * radius,
                                 Lateral(k).MaxShrink(radius));
  }

  static std::optional<Eigen::Vector2d> Undistort(const double* k,
                                                  const Eigen::Vector2d& m,
                                                  double max_radius) {
    return InvertDistortion<BrownDistortion>(k, m, max_radius);
  }

 private:
  static constexpr int RadialIdx(int i) { return i < 2 ? i : i + 2; }
  static std::array<double, kNumRadial> RadialParams(const double* k) {
    std::array<double, kNumRadial> radial;
    for (int i = 0; i < kNumRadial; ++i) radial[i] = k[RadialIdx(i)];
    return radial;
  }
  static LateralTerms Lateral(const double* k) {
    LateralTerms lateral{{k[3], k[2]}};
    if constexpr (kHasPrism) {
      lateral.s << k[kNumParams - 2], k[kNumParams - 1];
    }
    return lateral;
  }
};

// Lateral terms of the radially distorted point, as in the calibrations of
// Project Aria, with the parameters k0 ... k5 p0 p1 s0 s1 s2 s3 and
// q = (p0, p1), s = (s0, s2), w = (s1, s3).
struct RadTanThinPrismDistortion {
  using Profile = RationalProfile<6>;
  static constexpr int kNumParams = 12;

  static Eigen::Vector2d Distort(const double* k, const Eigen::Vector2d& m,
                                 DistortionJacobians<kNumParams>* jacobians) {
    const LateralTerms lateral = Lateral(k);
    DistortionJacobians<6> radial;
    const Eigen::Vector2d n = RadialDistortion<Profile>::Distort(
        k, m, jacobians != nullptr ? &radial : nullptr);
    if (jacobians != nullptr) {
      const Eigen::Matrix2d of_n =
          Eigen::Matrix2d::Identity() + lateral.Jacobian(n);
      const double r2 = n.squaredNorm();
      jacobians->point = of_n * radial.point;
      jacobians->params.leftCols<6>() = of_n * radial.params;
      jacobians->params.middleCols<2>(6) = LateralTerms::JacobianQ(n);
      jacobians->params.rightCols<4>() << r2, r2 * r2, 0.0, 0.0,  //
          0.0, 0.0, r2, r2 * r2;
    }
    return n + lateral.Offset(n);
  }

  // Both steps are injective.
  static bool IsInjectiveTo(const double* k, double radius) {
    const double s = radius * radius;
    return Profile::IsIncreasing(k, s, 0.0) &&
           Lateral(k).MaxShrink(radius * Profile::Evaluate(k, s).value) < 1.0;
  }

  static std::optional<Eigen::Vector2d> Undistort(const double* k,
                                                  const Eigen::Vector2d& m,
                                                  double max_radius) {
    return InvertDistortion<RadTanThinPrismDistortion>(k, m, max_radius);
  }

 private:
  static LateralTerms Lateral(const double* k) {
    return {{k[6], k[7]}, {k[8], k[10]}, {k[9], k[11]}};
  }
};

}  // namespace mgsfm::internal
