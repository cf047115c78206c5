// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "geometry/so3.h"

// Radial profiles map a point at radius r of the image plane to radius
// r * scale(s) with s = r^2. A profile is a struct with
//   kNumParams
//   Evaluate(k, s)             scale and its derivatives
//   IsIncreasing(k, s, margin) whether d(r scale)/dr > margin for all radii up
//                              to sqrt(s)
//   Invert(k, target, max)     the r in [0, max) with r * scale(r^2) = target
namespace mgsfm::internal {

// Inverses iterate until the reprojection error is at most kInverseTolerance.
// If rounding prevents this, they accept the best iterate up to
// kMaxInverseError. Both are in focal lengths, and relative to the radius if
// that exceeds one.
constexpr double kInverseTolerance = 1e-13;
constexpr double kMaxInverseError = 1e-10;

template <int N>
struct RadialScale {
  double value;
  double slope;                        // d value / d s
  Eigen::Matrix<double, 1, N> params;  // d value / d k
};

// A test for sum_i c[i] s^i > 0 on [0, end]. It may return false if the sum is
// not positive within 1e-6 end of the interval.
template <std::size_t N>
bool IsPositiveOn(const std::array<double, N>& c, double end) {
  if (!(c[0] > 0.0) || !std::isfinite(end)) return false;
  // On [a, b] with a >= 0, positive terms are bounded below by their values at
  // a and negative terms by their values at b.
  const auto lower_bound = [&c](double a, double b) {
    double positive = 0.0, negative = 0.0;
    for (std::size_t i = N; i-- > 0;) {
      positive = positive * a + (c[i] > 0.0 ? c[i] : 0.0);
      negative = negative * b + (c[i] < 0.0 ? c[i] : 0.0);
    }
    return positive + negative;
  };
  double begin = 0.0;
  double width = end;
  while (begin < end) {
    const double stop = std::min(begin + width, end);
    if (lower_bound(begin, stop) > 0.0) {
      begin = stop;
      width *= 2.0;
    } else {
      width *= 0.5;
      if (width < 1e-6 * end) return false;
    }
  }
  return true;
}

// Bracketed Newton method for r * scale(r^2) = target. Radii beyond the root or
// beyond the increasing range are too large, all others too small.
template <class Profile>
std::optional<double> InvertProfile(const double* k, double target,
                                    double max_radius) {
  const double unit = std::max(1.0, target);
  double low = 0.0;
  double high = max_radius;
  double r = target < max_radius ? target : 0.5 * max_radius;
  bool is_solution = false;
  // Newton converges in a few steps; 53 halvings exhaust the double precision.
  for (int i = 0; i < 100; ++i) {
    const double s = r * r;
    const auto scale = Profile::Evaluate(k, s);
    const double error = r * scale.value - target;
    const bool inside = Profile::IsIncreasing(k, s, 0.0);
    if (inside && std::abs(error) <= kInverseTolerance * unit) return r;
    is_solution = inside && std::abs(error) <= kMaxInverseError * unit;
    const bool too_large = !inside || error > 0.0;
    (too_large ? high : low) = r;
    double next = r - error / (scale.value + 2.0 * s * scale.slope);
    if (!inside || !(next > low && next < high)) {
      next = std::isfinite(high) ? 0.5 * (low + high) : 2.0 * r;
    }
    if (next == low || next == high) break;
    r = next;
  }
  if (!is_solution) return std::nullopt;
  return r;
}

// scale = (1 + sum_i k_i s^i) / (1 + sum_j k_(kNum + j) s^j).
template <int kNum, int kDen = 0>
struct RationalProfile {
  static constexpr int kNumParams = kNum + kDen;

  static RadialScale<kNumParams> Evaluate(const double* k, double s) {
    double n = 0.0, n_slope = 0.0, d = 0.0, d_slope = 0.0;
    for (int i = kNum; i > 0; --i) {
      n_slope = n_slope * s + i * k[i - 1];
      n = (n + k[i - 1]) * s;
    }
    for (int j = kDen; j > 0; --j) {
      d_slope = d_slope * s + j * k[kNum + j - 1];
      d = (d + k[kNum + j - 1]) * s;
    }
    n += 1.0;
    d += 1.0;
    RadialScale<kNumParams> scale;
    scale.value = n / d;
    scale.slope = (n_slope - scale.value * d_slope) / d;
    double power = 1.0 / d;
    for (int i = 0; i < kNum; ++i) scale.params[i] = power *= s;
    power = -scale.value / d;
    for (int j = 0; j < kDen; ++j) scale.params[kNum + j] = power *= s;
    return scale;
  }

  // If scale = n / d, then d(r scale)/dr = (n d + 2 s (n' d - n d')) / d^2. Its
  // numerator has the coefficients sum_(i+j=m) n_i d_j (1 + 2 (i - j)).
  static bool IsIncreasing(const double* k, double s, double margin) {
    std::array<double, kDen + 1> d{1.0};
    for (int j = 0; j < kDen; ++j) d[j + 1] = k[kNum + j];
    if (kDen > 0 && !IsPositiveOn(d, s)) return false;
    constexpr int kDegree = kDen + (kNum > kDen ? kNum : kDen);
    std::array<double, kDegree + 1> c{};
    for (int j = 0; j <= kDen; ++j) {
      for (int i = 0; i <= kNum; ++i) {
        const double n = i == 0 ? 1.0 : k[i - 1];
        c[i + j] += n * d[j] * (1 + 2 * (i - j));
      }
      for (int i = 0; i <= kDen; ++i) c[i + j] -= margin * d[i] * d[j];
    }
    return IsPositiveOn(c, s);
  }

  static std::optional<double> Invert(const double* k, double target,
                                      double max_radius) {
    return InvertProfile<RationalProfile>(k, target, max_radius);
  }
};

// atan(x) / x as a function of y = x^2, and its derivative.
inline void AtanRatio(double y, double* value, double* slope) {
  // Above this limit, cancellation in the slope amplifies rounding errors by at
  // most 1.5 / y = 150.
  constexpr double kSeriesLimit = 1e-2;
  if (y > kSeriesLimit) {
    const double x = std::sqrt(y);
    *value = std::atan(x) / x;
    *slope = (1.0 / (1.0 + y) - *value) / (2.0 * y);
    return;
  }
  *value = 0.0;
  *slope = 0.0;
  // The omitted terms are below 10 y^9 / 21 = 5e-19.
  for (int i = 9; i > 0; --i) {
    const double coefficient = (i % 2 == 0 ? 1.0 : -1.0) / (2 * i + 1);
    *slope = *slope * y + i * coefficient;
    *value = (*value + coefficient) * y;
  }
  *value += 1.0;
}

// The field-of-view model (Devernay and Faugeras 2001): r scale =
// atan(c r) / omega with c = 2 tan(omega / 2), |omega| < pi. Accurate for small
// omega and r, too; omega = 0 means no distortion.
struct FovProfile {
  static constexpr int kNumParams = 1;

  static RadialScale<1> Evaluate(const double* k, double s) {
    const double c = 2.0 * std::tan(0.5 * k[0]);
    double c_ratio, c_ratio_slope;
    TangentRatio(k[0], &c_ratio, &c_ratio_slope);
    double atan_ratio, atan_ratio_slope;
    AtanRatio(c * c * s, &atan_ratio, &atan_ratio_slope);
    const double c_slope = 1.0 + 0.25 * c * c;  // dc / d omega
    RadialScale<1> scale;
    scale.value = c_ratio * atan_ratio;
    scale.slope = c_ratio * atan_ratio_slope * c * c;
    scale.params[0] = c_ratio_slope * atan_ratio +
                      c_ratio * atan_ratio_slope * 2.0 * c * c_slope * s;
    return scale;
  }

  // d(r scale)/dr = (c / omega) / (1 + c^2 s) decreases to 0 at infinity.
  static bool IsIncreasing(const double* k, double s, double margin) {
    if (!(std::abs(k[0]) < kPi)) return false;
    const double c = 2.0 * std::tan(0.5 * k[0]);
    double c_ratio, c_ratio_slope;
    TangentRatio(k[0], &c_ratio, &c_ratio_slope);
    return c_ratio / (1.0 + c * c * s) > margin;
  }

  static std::optional<double> Invert(const double* k, double target,
                                      double max_radius) {
    const double omega = std::abs(k[0]);
    if (!(omega < kPi) || target * omega >= 0.5 * kPi) {
      return std::nullopt;
    }
    const double r =
        omega > 0.0 ? std::tan(target * omega) / (2.0 * std::tan(0.5 * omega))
                    : target;
    if (!(r < max_radius)) return std::nullopt;
    return r;
  }

 private:
  // c / omega = tan(omega / 2) / (omega / 2), and its derivative.
  static void TangentRatio(double omega, double* value, double* slope) {
    // The next terms of the series below are less than 1e-14 at this limit.
    constexpr double kSeriesLimit = 0.05;
    if (std::abs(omega) > kSeriesLimit) {
      const double c = 2.0 * std::tan(0.5 * omega);
      *value = c / omega;
      *slope = (1.0 + 0.25 * c * c - *value) / omega;
      return;
    }
    const double y = 0.25 * omega * omega;
    *value = 1.0 + y * (1.0 / 3 +
                        y * (2.0 / 15 + y * (17.0 / 315 + y * (62.0 / 2835))));
    *slope = 0.5 * omega *
             (1.0 / 3 + y * (4.0 / 15 + y * (51.0 / 315 + y * 248.0 / 2835)));
  }
};

// Distortions of the image plane in units of the focal length. A distortion is
// a struct with
//   kNumParams
//   Distort(k, m, jacobians)  the distorted point; jacobians may be null
//   IsInjectiveTo(k, radius)  a sufficient condition for injectivity on the
//                             disc of this radius: the symmetric part of the
//                             Jacobian is positive definite on the whole disc
//   Undistort(k, m, max)      the preimage of m in the injective region, closer
//                             than max to the center

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
