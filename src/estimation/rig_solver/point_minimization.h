// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/cpu_features.h"
#include "rig_solver/schur_passes.h"

// Minimizes the cost of single points, with all other unknowns constant:
// embedded point iterations (Jeong et al., "Pushing the Envelope of Modern
// Methods for Bundle Adjustment", PAMI 2012). Points are independent of each
// other, so this costs linear time.
namespace mgsfm {

// The steps of one point within one step of all unknowns
// (docs/results/constants.md).
constexpr int kMaxNumPointSteps = 40;

// The cost of a point and its derivatives at a trial position. The Hessian of
// the cost without second derivatives of residuals is
//   sum_o rho' J^T J + 2 rho'' (J^T r) (J^T r)^T.
// `weighted` lacks the second term, so that it is positive semi-definite.
struct PointModel {
  double cost = 0.0;
  double g[3] = {0.0, 0.0, 0.0};
  PointHessian weighted;
  PointHessian exact;
  // From the closest camera.
  double squared_distance = std::numeric_limits<double>::infinity();
};

template <int kDim>
MGSFM_ALWAYS_INLINE void AddToModel(const RobustLoss& loss, const double* r,
                                    const double* J, PointModel* model) {
  double squared = 0.0;
  for (int d = 0; d < kDim; ++d) squared += r[d] * r[d];
  const LossValue value = loss.Evaluate(squared);
  model->cost += 0.5 * value.rho;
  double a[3] = {0.0, 0.0, 0.0};  // J^T r
  for (int d = 0; d < kDim; ++d) {
    for (int i = 0; i < 3; ++i) a[i] += J[3 * d + i] * r[d];
  }
  for (int i = 0, e = 0; i < 3; ++i) {
    model->g[i] += value.d1 * a[i];
    for (int j = 0; j <= i; ++j, ++e) {
      double square = 0.0;
      for (int d = 0; d < kDim; ++d) square += J[3 * d + i] * J[3 * d + j];
      model->weighted.values[e] += value.d1 * square;
      model->exact.values[e] +=
          value.d1 * square + 2.0 * value.d2 * a[i] * a[j];
    }
  }
}

// False if a residual is undefined at this position.
template <class R>
MGSFM_ALWAYS_INLINE bool ModelPoint(const PassInput<R>& in,
                                    const ChunkRanges& chunk, size_t p,
                                    const double* position, PointModel* model) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  const RobustLoss loss =
      in.problem.LossOfPoint(s.point_begin[p + 1] - s.point_begin[p]);
  *model = PointModel();
  for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
    const ImagePose& pose = in.poses[images[s.observation_image[k]].image];
    double y[3], x[3], r[kDim], P[3 * kDim], J[3 * kDim];
    double K[kDim * kMaxNumCameraParams];
    TransformPoint(pose, position, y, x);
    if (!R::Linearize(pose, x, in.measured.data() + kDim * k, r, P, K)) {
      return false;
    }
    MultiplyRows<kDim>(P, 3, pose.cam_from_world, 3, J);
    AddToModel<kDim>(loss, r, J, model);
    model->squared_distance = std::min(model->squared_distance,
                                       x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
  }
  return std::isfinite(model->cost);
}

// d = -H^-1 g. False if H is not positive definite to working precision.
MGSFM_ALWAYS_INLINE bool SolvePoint(const PointHessian& H, const double* g,
                                    double* d) {
  const double* v = H.values;
  PointFactor f;
  f.inverse0 = 1.0 / std::sqrt(v[0]);
  f.l10 = v[1] * f.inverse0;
  f.l20 = v[3] * f.inverse0;
  const double pivot1 = v[2] - f.l10 * f.l10;
  f.inverse1 = 1.0 / std::sqrt(pivot1);
  f.l21 = (v[4] - f.l20 * f.l10) * f.inverse1;
  const double pivot2 = v[5] - f.l20 * f.l20 - f.l21 * f.l21;
  f.inverse2 = 1.0 / std::sqrt(pivot2);
  // Also false if a value is not a number.
  if (!(v[0] > 0.0 && pivot1 > kMinPivot * v[2] && pivot2 > kMinPivot * v[5])) {
    return false;
  }
  for (int i = 0; i < 3; ++i) d[i] = -g[i];
  SolveLower(f, d);
  SolveUpper(f, d);
  return true;
}

// Moves a point by steps with the exact Hessian, or with the weighted one where
// the exact one is indefinite or its step is long or does not decrease the
// cost. Ends when a step predicts a decrease of at most `tolerance`, or when
// both steps fail: without parallax, points would move to infinity. Returns the
// cost.
template <class R>
MGSFM_ALWAYS_INLINE double MinimizePoint(const PassInput<R>& in,
                                         const ChunkRanges& chunk, size_t p,
                                         double tolerance, double* position) {
  PointModel model, next;
  if (!ModelPoint(in, chunk, p, position, &model)) {
    return CostOfPoint<R>(in.problem, in.structure, chunk, in.measured,
                          in.poses, p, position);
  }
  for (int step = 0; step < kMaxNumPointSteps; ++step) {
    bool is_lower = false;
    double moved[3];
    for (const PointHessian* H : {&model.exact, &model.weighted}) {
      double d[3];
      if (!SolvePoint(*H, model.g, d)) continue;
      double decrease = 0.0, squared_step = 0.0;
      for (int i = 0; i < 3; ++i) {
        moved[i] = position[i] + d[i];
        decrease -= 0.5 * d[i] * model.g[i];
        squared_step += d[i] * d[i];
      }
      if (decrease <= tolerance) return model.cost;
      if (squared_step > kLongStep * kLongStep * model.squared_distance) {
        continue;
      }
      is_lower =
          ModelPoint(in, chunk, p, moved, &next) && next.cost < model.cost;
      if (is_lower) break;
    }
    if (!is_lower) break;
    std::copy_n(moved, 3, position);
    model = next;
  }
  return model.cost;
}

template <class R>
MGSFM_ALWAYS_INLINE double MinimizePointsBody(
    const PassInput<R>& in, const ChunkRanges& chunk, double tolerance,
    std::vector<Eigen::Vector3d>* points) {
  double cost = 0.0;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    cost += MinimizePoint(in, chunk, p, tolerance, (*points)[p].data());
  }
  return cost;
}

template <class R>
double MinimizePointsAny(const PassInput<R>& in, const ChunkRanges& chunk,
                         double tolerance,
                         std::vector<Eigen::Vector3d>* points) {
  return MinimizePointsBody(in, chunk, tolerance, points);
}
template <class R>
MGSFM_TARGET_AVX2 double MinimizePointsAvx2(
    const PassInput<R>& in, const ChunkRanges& chunk, double tolerance,
    std::vector<Eigen::Vector3d>* points) {
  return MinimizePointsBody(in, chunk, tolerance, points);
}

}  // namespace mgsfm
