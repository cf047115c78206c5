// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "base/cpu_features.h"
#include "math/robust_loss.h"
#include "rig_solver/image_poses.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The residuals r of a point x in the camera frame. Each is a struct with
//   Observation  the type in the problem
//   Scalar       the type of the measured values
//   kDim         the dimension of r
//   kHasCamera   whether r depends on camera parameters
//   Measured()   the kDim measured values
//   Evaluate()   computes r; false if it is undefined
//   Linearize()  computes r, P = dr/dx (kDim x 3) and, if there are free
//                parameters, K = dr/d(parameters); row-major
struct PixelResidual {
  using Observation = PixelObservation;
  using Scalar = float;
  static constexpr int kDim = 2;
  static constexpr bool kHasCamera = true;

  static const Scalar* Measured(const Observation& o) { return o.pixel.data(); }

  // The projection of the most common camera model, inlined. As a call, it
  // takes a fifth of the time of a join with little memory, because its results
  // pass through memory (docs/results/constants.md).
  static MGSFM_ALWAYS_INLINE bool ProjectByPinhole(const double* params,
                                                   const double* x,
                                                   const Scalar* measured,
                                                   double* r, double* P) {
    if (!(x[2] > 0.0)) return false;
    const double inverse = 1.0 / x[2];
    for (int i = 0; i < 2; ++i) {
      const double focal_m = params[i] * x[i] * inverse;
      r[i] = focal_m + params[2 + i] - measured[i];
      if (P == nullptr) continue;
      P[3 * i + i] = params[i] * inverse;
      P[3 * i + 1 - i] = 0.0;
      P[3 * i + 2] = -focal_m * inverse;
    }
    return std::isfinite(r[0] + r[1]);
  }

  static MGSFM_ALWAYS_INLINE bool Evaluate(const ImagePose& pose,
                                           const double* x,
                                           const Scalar* measured, double* r) {
    if (pose.is_pinhole) {
      return ProjectByPinhole(pose.params, x, measured, r, nullptr);
    }
    if (!pose.projection.project(pose.params, x, r)) return false;
    r[0] -= measured[0];
    r[1] -= measured[1];
    return true;
  }

  static MGSFM_ALWAYS_INLINE bool Linearize(const ImagePose& pose,
                                            const double* x,
                                            const Scalar* measured, double* r,
                                            double* P, double* K) {
    if (pose.is_pinhole) {
      return ProjectByPinhole(pose.params, x, measured, r, P);
    }
    double all[2 * kMaxNumCameraParams];
    const int num_free = pose.num_free_params;
    if (!pose.projection.linearize(pose.params, x, r, P,
                                   num_free > 0 ? all : nullptr)) {
      return false;
    }
    r[0] -= measured[0];
    r[1] -= measured[1];
    for (int i = 0; i < num_free; ++i) {
      K[i] = all[pose.free_params[i]];
      K[num_free + i] = all[pose.num_params + pose.free_params[i]];
    }
    return true;
  }
};

struct RayResidual {
  using Observation = RayObservation;
  using Scalar = double;
  static constexpr int kDim = 3;
  static constexpr bool kHasCamera = false;

  static const Scalar* Measured(const Observation& o) { return o.ray.data(); }

  static MGSFM_ALWAYS_INLINE bool Evaluate(const ImagePose&, const double* x,
                                           const Scalar* measured, double* r) {
    const double norm = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    if (!(norm > 1e-150)) return false;
    for (int i = 0; i < 3; ++i) r[i] = x[i] / norm - measured[i];
    return true;
  }

  static MGSFM_ALWAYS_INLINE bool Linearize(const ImagePose&, const double* x,
                                            const Scalar* measured, double* r,
                                            double* P, double*) {
    const double norm = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    if (!(norm > 1e-150)) return false;
    const double inverse = 1.0 / norm;
    const double u[3] = {x[0] * inverse, x[1] * inverse, x[2] * inverse};
    for (int i = 0; i < 3; ++i) {
      r[i] = u[i] - measured[i];
      for (int j = 0; j < 3; ++j) {
        P[3 * i + j] = ((i == j ? 1.0 : 0.0) - u[i] * u[j]) * inverse;
      }
    }
    return true;
  }
};

// rho'(s), without evaluating rho for common losses.
MGSFM_ALWAYS_INLINE double LossWeight(const RobustLoss& loss, double s) {
  switch (loss.type) {
    case RobustLossType::kTrivial:
      return 1.0;
    case RobustLossType::kHuber:
      return s <= loss.scale * loss.scale ? 1.0 : loss.scale / std::sqrt(s);
    case RobustLossType::kCauchy:
      return 1.0 / (1.0 + s / (loss.scale * loss.scale));
    default:
      return loss.Weight(s);
  }
}

}  // namespace mgsfm
