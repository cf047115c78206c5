// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

#include "base/cpu_features.h"
#include "least_squares/damping.h"
#include "least_squares/rig_problem.h"

namespace mgsfm {

// A scale d, an unknown that only one observation or one baseline term knows,
// is eliminated from the damped equations before all others. With the weighted
// residual r, its derivatives P = dr/dx and a = dr/dd, n = |a|^2 and
// h = n + lambda D, what is left are the equations of
//
//   P^T (I - a a^T / h) P,   P^T (I - a a^T / h) r.
//
// They are those of a residual r' with derivative P' = (I - f a a^T) P, where
// (I - f a a^T)^2 = I - a a^T / h; so nothing that follows has to know of the
// scale. There may be a second residual r2 that only the scale changes, with
// a2 = dr2/dd; then n = |a|^2 + a2^2, and r' takes it in.
//
// d >= kMinScale, where steps end that lead across. A scale about there whose
// gradient does is held, so that a step promises what it can keep; or not: far
// from a solution many must leave the bound with what else moves.
struct EliminatedScale {
  double curvature = 0.0;            // n
  double gradient = 0.0;             // a . r + a2 r2
  double damping = 0.0;              // lambda D
  double by_x[3] = {0.0, 0.0, 0.0};  // a^T P
  bool is_held = false;
};

// P (3 x 3, row-major) and r become P' and r'.
MGSFM_ALWAYS_INLINE EliminatedScale EliminateScale(double scale, double lambda,
                                                   bool may_be_held,
                                                   const double* a, double a2,
                                                   double r2, double* P,
                                                   double* r) {
  // Else a scale a rounding error above the bound promises what it cannot hold.
  constexpr double kAtBound = 1.01 * kMinScale;
  EliminatedScale e;
  e.curvature = a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a2 * a2;
  e.gradient = a[0] * r[0] + a[1] * r[1] + a[2] * r[2] + a2 * r2;
  e.damping = lambda * ClampDiagonal(e.curvature);
  for (int j = 0; j < 3; ++j) {
    e.by_x[j] = a[0] * P[j] + a[1] * P[3 + j] + a[2] * P[6 + j];
  }
  e.is_held = may_be_held && scale < kAtBound && e.gradient > 0.0;
  if (e.is_held) return e;
  const double h = e.curvature + e.damping;
  // 1 - f |a|^2.
  const double rest = std::sqrt((a2 * a2 + e.damping) / h);
  const double f = 1.0 / (h * (1.0 + rest));
  const double k = f * (e.gradient + a2 * r2 / rest);
  for (int i = 0; i < 3; ++i) {
    r[i] -= k * a[i];
    for (int j = 0; j < 3; ++j) P[3 * i + j] -= f * a[i] * e.by_x[j];
  }
  return e;
}

// The scale after a part of the step that changes x by dx.
MGSFM_ALWAYS_INLINE double MoveScale(const EliminatedScale& e, double scale,
                                     double length, const double* dx,
                                     StepSums* sums) {
  double moved = kMinScale;
  if (!e.is_held) {
    const double h = e.curvature + e.damping;
    const double gradient =
        e.gradient + e.by_x[0] * dx[0] + e.by_x[1] * dx[1] + e.by_x[2] * dx[2];
    const double step = -gradient / h;
    moved = std::max(kMinScale, scale + length * step);
    sums->decrease += e.gradient * e.gradient / h + e.damping * step * step;
    if (scale + step < kMinScale) {
      // The model cost is n d^2 / 2 - h step d, but for a constant.
      const double change = moved - scale;
      sums->lost +=
          (change - step) * (e.curvature * (change + step) - 2.0 * h * step);
    }
  }
  const double change = moved - scale;
  sums->squared_step += change * change;
  sums->squared_position += scale * scale;
  return moved;
}

}  // namespace mgsfm
