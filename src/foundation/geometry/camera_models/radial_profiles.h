// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
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

  // With scale = n / d, d(r scale)/dr = (n d + 2 s (n' d - n d')) / d^2. Its
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

}  // namespace mgsfm::internal
