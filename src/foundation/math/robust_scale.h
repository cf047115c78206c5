// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "math/statistics.h"

namespace mgsfm {

// Normal errors exceed this many standard deviations in 1 of 10,000 cases.
inline constexpr double kRareErrorInSigmas = 3.9;

// The scale of Cauchy's loss in standard deviations. It is 95 % efficient for
// normal errors at 2.4; in the pose graph, twice the value changes errors by
// less than 1 % (docs/results/constants.md).
inline constexpr double kCauchyScaleInSigmas = 3.0;

// The median of |e| for a standard normal vector e of dimension 1, 2 or 3: the
// value m at which the chi distribution with k degrees of freedom reaches 1/2,
//
//   k = 1   erf(m / sqrt 2) = 1/2                                m = 0.6745
//   k = 2   1 - exp(-m^2 / 2) = 1/2                m = sqrt(2 ln 2) = 1.1774
//   k = 3   erf(m / sqrt 2) - sqrt(2 / pi) m exp(-m^2 / 2) = 1/2 m = 1.5382
constexpr double kMediansOfStandardNormalNorm[] = {
    0.6744897501960817, 1.1774100225154747, 1.5381722544550522};

template <int kDimension>
constexpr double MedianOfStandardNormalNorm() {
  static_assert(kDimension >= 1 && kDimension <= 3);
  return kMediansOfStandardNormalNorm[kDimension - 1];
}

// The median of a chi-square variable with k >= 1 degrees of freedom; beyond
// three, within 0.4 % (Wilson and Hilferty 1931).
inline double MedianOfChiSquare(int k) {
  if (k <= 3) {
    const double norm = kMediansOfStandardNormalNorm[k - 1];
    return norm * norm;
  }
  const double cube_root = 1.0 - 2.0 / (9.0 * k);
  return k * cube_root * cube_root * cube_root;
}

// The standard deviation of each coordinate of residual vectors with isotropic
// normal noise and less than half outliers, from the median of their norms.
template <int kDimension>
double SigmaFromMedianNorm(double median_norm) {
  return median_norm / MedianOfStandardNormalNorm<kDimension>();
}
// `norms` must not be empty. O(n).
template <int kDimension>
double RobustSigma(std::vector<double> norms) {
  return SigmaFromMedianNorm<kDimension>(Median(std::move(norms)));
}

// The scale of a robust loss under graduated non-convexity (Black and
// Rangarajan 1996; Blake and Zisserman 1987). It starts at
// max(first_scale, 2 target), decays geometrically and stops at `target`, which
// may change between steps because it follows the estimated noise.
class AnnealedScale {
 public:
  AnnealedScale(double first_scale, double decay)
      : first_scale_(first_scale), decay_(decay) {}

  // The scale of the next step.
  double Next(double target) {
    const double next =
        scale_ ? decay_ * *scale_ : std::max(first_scale_, 2.0 * target);
    is_at_target_ = next <= target;
    scale_ = std::max(next, target);
    return *scale_;
  }
  // Whether the last step returned its target.
  bool IsAtTarget() const { return is_at_target_; }

 private:
  double first_scale_;
  double decay_;
  std::optional<double> scale_;
  bool is_at_target_ = false;
};

}  // namespace mgsfm
