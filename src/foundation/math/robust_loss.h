// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

namespace mgsfm {

// Robust loss functions rho(s) of a squared residual norm s = |r|^2 with
// rho(0) = 0 and rho'(0) = 1. The cost is sum_k rho(|r_k|^2) / 2, and
// iteratively reweighted least squares uses the weights rho'(|r_k|^2). The
// scale a is the residual norm around which rho(s) departs from s.
enum class RobustLossType {
  kTrivial,      // s
  kHuber,        // s up to a^2, then 2 a sqrt(s) - a^2
  kCauchy,       // a^2 log(1 + s / a^2)
  kGemanMcClure  // s / (1 + s / a^2): bounded by a^2
};

// rho and its first two derivatives with respect to s.
struct LossValue {
  double rho;
  double d1;
  double d2;
};

struct RobustLoss {
  RobustLossType type = RobustLossType::kTrivial;
  double scale = 1.0;

  LossValue Evaluate(double s) const;
  double Cost(double s) const { return Evaluate(s).rho; }
  double Weight(double s) const { return Evaluate(s).d1; }
};

inline LossValue RobustLoss::Evaluate(double s) const {
  const double a2 = scale * scale;
  const double t = 1.0 + s / a2;
  switch (type) {
    case RobustLossType::kTrivial:
      break;
    case RobustLossType::kHuber: {
      if (s <= a2) break;
      const double r = std::sqrt(s);
      return {2.0 * scale * r - a2, scale / r, -0.5 * scale / (s * r)};
    }
    case RobustLossType::kCauchy:
      return {a2 * std::log1p(s / a2), 1.0 / t, -1.0 / (a2 * t * t)};
    case RobustLossType::kGemanMcClure:
      return {s / t, 1.0 / (t * t), -2.0 / (a2 * t * t * t)};
  }
  return {s, 1.0, 0.0};
}

}  // namespace mgsfm
