// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/cpu_features.h"
#include "rig_solver/schur_kernels.h"

// Passes over the points of a chunk. Each is compiled for generic x86-64 and
// for AVX2 with FMA; the choice is made at run time.

namespace mgsfm {

// The data that a linearization keeps for MultiplyChunk. The workspace receives
// the local system of the chunk after elimination of its points (images are
// still separate).
struct KeptDerivatives {
  size_t num_values = 0;  // of an observation: P and K
  // Empty if products recompute the derivatives, or if there are none.
  std::vector<double> observations;

  double* Find(size_t observation) {
    return observations.empty()
               ? nullptr
               : observations.data() + num_values * observation;
  }
};

// The end of the part of a point that begins at an observation.
inline size_t EndOfPart(const RigStructure& s, size_t begin, size_t end) {
  if (s.observation_starts_part.empty()) return end;
  size_t k = begin + 1;
  while (k < end && !s.observation_starts_part[k]) ++k;
  return k;
}

template <class R, int N>
MGSFM_ALWAYS_INLINE bool LinearizeChunkBody(const PassInput<R>& in,
                                            const ChunkRanges& chunk,
                                            KeptDerivatives* kept,
                                            SchurWorkspace* w) {
  const RigStructure& s = in.structure;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    const size_t end = s.point_begin[p + 1];
    size_t end_of_part = EndOfPart(s, s.point_begin[p], end);
    const bool is_cut = end_of_part < end;
    PointHessian V;
    double g[3];
    if (!LinearizePoint<R, N>(in, chunk, p, is_cut, &V, g,
                              kept->Find(s.point_begin[p]), kept->num_values,
                              w)) {
      return false;
    }
    if (!in.problem.points_are_free) continue;
    EliminatePoint<N>(FactorPoint(in, V), g, is_cut, w);
    if (!is_cut) continue;
    for (size_t k = s.point_begin[p]; k < end; k = end_of_part) {
      end_of_part = EndOfPart(s, k, end);
      EliminatePart<R, N>(in, chunk, p, k, end_of_part, w);
    }
  }
  return true;
}

template <class R, int N>
bool LinearizeChunkAny(const PassInput<R>& in, const ChunkRanges& chunk,
                       KeptDerivatives* kept, SchurWorkspace* w) {
  return LinearizeChunkBody<R, N>(in, chunk, kept, w);
}
template <class R, int N>
MGSFM_TARGET_AVX2 bool LinearizeChunkAvx2(const PassInput<R>& in,
                                          const ChunkRanges& chunk,
                                          KeptDerivatives* kept,
                                          SchurWorkspace* w) {
  return LinearizeChunkBody<R, N>(in, chunk, kept, w);
}

// A step of all unknowns except points, per image.
struct ImageSteps {
  std::vector<ImageTwist> twists;
  // Changes of the free parameters, per camera.
  std::vector<std::array<double, kMaxNumCameraParams>> params;
};

// x moves in the camera frame by cross(rotation, y) + shift.
MGSFM_ALWAYS_INLINE void ApplyTwist(const double* y, const ImageTwist& twist,
                                    double* dx) {
  const double* w = twist.rotation;
  dx[0] = w[1] * y[2] - w[2] * y[1] + twist.shift[0];
  dx[1] = w[2] * y[0] - w[0] * y[2] + twist.shift[1];
  dx[2] = w[0] * y[1] - w[1] * y[0] + twist.shift[2];
}

// u (kDim) = [rotation, shift, free parameters] step.
template <int kDim>
MGSFM_ALWAYS_INLINE void ApplyStep(const double* y, const double* P,
                                   const double* K, int num_free,
                                   const ImageTwist& twist,
                                   const double* params, double* u) {
  double dx[3];
  ApplyTwist(y, twist, dx);
  for (int k = 0; k < kDim; ++k) {
    u[k] = P[3 * k] * dx[0] + P[3 * k + 1] * dx[1] + P[3 * k + 2] * dx[2];
    for (int i = 0; i < num_free; ++i) u[k] += K[k * num_free + i] * params[i];
  }
}

// The cost of the observations of a point; infinite if one is undefined.
template <class R>
MGSFM_ALWAYS_INLINE double CostOfPoint(
    const RigProblemBase& problem, const RigStructure& s,
    const ChunkRanges& chunk, const std::vector<typename R::Scalar>& measured,
    const std::vector<ImagePose>& poses, size_t p, const double* point) {
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  const RobustLoss loss =
      problem.LossOfPoint(s.point_begin[p + 1] - s.point_begin[p]);
  double cost = 0.0;
  for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
    const ImagePose& pose = poses[images[s.observation_image[k]].image];
    double y[3], x[3], r[R::kDim];
    TransformPoint(pose, point, y, x);
    if (!R::Evaluate(pose, x, measured.data() + R::kDim * k, r)) {
      return std::numeric_limits<double>::infinity();
    }
    double squared = 0.0;
    for (int i = 0; i < R::kDim; ++i) squared += r[i] * r[i];
    cost += 0.5 * loss.Cost(squared);
  }
  return cost;
}

struct StepInput {
  const ImageSteps& steps;
  const std::vector<ImagePose>& new_poses;
};

// The step d = -(V + lambda D)^-1 (g + W z) of a point.
struct PointStep {
  double d[3] = {0.0, 0.0, 0.0};
  double g[3] = {0.0, 0.0, 0.0};
  PointHessian V;
  // The squared distance from the point to the closest camera that observes it.
  double squared_distance = std::numeric_limits<double>::infinity();
};

template <class R>
MGSFM_ALWAYS_INLINE PointStep StepOfPoint(const PassInput<R>& in,
                                          const ImageSteps& steps,
                                          const ChunkRanges& chunk, size_t p) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  PointStep step;
  double b[3] = {0.0, 0.0, 0.0};  // g + W z
  double squared_distance = std::numeric_limits<double>::infinity();
  const RobustLoss loss =
      in.problem.LossOfPoint(s.point_begin[p + 1] - s.point_begin[p]);
  ObservationTerms<kDim> o;
  for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
    const int image = images[s.observation_image[k]].image;
    const ImagePose& pose = in.poses[image];
    if (!LinearizeObservation<R>(loss, pose, in.points[p].data(),
                                 in.measured.data() + kDim * k, &o)) {
      continue;
    }
    const double* t = pose.translation;
    const double x[3] = {o.y[0] + t[0], o.y[1] + t[1], o.y[2] + t[2]};
    squared_distance =
        std::min(squared_distance, x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    const int num_free = R::kHasCamera ? pose.num_free_params : 0;
    const double* params =
        num_free > 0 ? steps.params[in.problem.images[image].camera].data()
                     : nullptr;
    double u[kDim], J[3 * kDim];
    ApplyStep<kDim>(o.y, o.P, o.K, num_free, steps.twists[image], params, u);
    MultiplyRows<kDim>(o.P, 3, pose.cam_from_world, 3, J);
    AddSquareOfPoint<kDim>(J, step.V.values);
    for (int k = 0; k < kDim; ++k) {
      for (int i = 0; i < 3; ++i) {
        step.g[i] += J[3 * k + i] * o.residual[k];
        b[i] += J[3 * k + i] * (o.residual[k] + u[k]);
      }
    }
  }
  step.squared_distance = squared_distance;
  const PointFactor f = FactorPoint(in, step.V);
  SolveLower(f, b);
  SolveUpper(f, b);
  for (int i = 0; i < 3; ++i) step.d[i] = -b[i];
  return step;
}

// The linear model of a point is unreliable for steps beyond this fraction of
// its distance. Reprojections are inversely proportional to depth, so the
// relative error of the model is at most a tenth for shorter steps.
constexpr double kLongStep = 0.1;

// Moves a point to old_point + fraction * d with the first fraction of 1, 1/2,
// ..., 1/64 whose cost is finite and at most `bound`, otherwise 0. Returns the
// new cost.
template <class Cost>
MGSFM_ALWAYS_INLINE double MovePoint(const double* old_point, const double* d,
                                     double bound, const Cost& cost_at,
                                     double* point) {
  double fraction = 1.0;
  // A point whose step still fails at 1/64 does not move in this iteration.
  for (int i = 0; i <= 6; ++i, fraction *= 0.5) {
    for (int k = 0; k < 3; ++k) point[k] = old_point[k] + fraction * d[k];
    const double cost = cost_at(point);
    if (std::isfinite(cost) && cost <= bound) return cost;
  }
  std::copy_n(old_point, 3, point);
  return cost_at(point);
}

// Moves points for the step of all other unknowns, and evaluates the
// cost.
template <class R>
MGSFM_ALWAYS_INLINE StepSums StepChunkBody(
    const PassInput<R>& in, const StepInput& input, const ChunkRanges& chunk,
    std::vector<Eigen::Vector3d>* new_points) {
  StepSums sums;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    PointStep step;
    if (in.problem.points_are_free) {
      step = StepOfPoint(in, input.steps, chunk, p);
    }
    const double* d = step.d;
    const double* old_point = in.points[p].data();
    double D[3];
    DiagonalOfPoint(step.V, D);
    double squared_step = 0.0;
    for (int i = 0; i < 3; ++i) {
      sums.decrease += d[i] * (in.lambda * D[i] * d[i] - step.g[i]);
      squared_step += d[i] * d[i];
      sums.squared_position += old_point[i] * old_point[i];
    }
    sums.squared_step += squared_step;
    const auto cost_at = [&](const double* point) {
      return CostOfPoint<R>(in.problem, in.structure, chunk, in.measured,
                            input.new_poses, p, point);
    };
    const bool is_long =
        squared_step > kLongStep * kLongStep * step.squared_distance;
    const double bound =
        is_long ? cost_at(old_point) : std::numeric_limits<double>::infinity();
    sums.cost +=
        MovePoint(old_point, d, bound, cost_at, (*new_points)[p].data());
  }
  return sums;
}

template <class R>
StepSums StepChunkAny(const PassInput<R>& in, const StepInput& input,
                      const ChunkRanges& chunk,
                      std::vector<Eigen::Vector3d>* new_points) {
  return StepChunkBody(in, input, chunk, new_points);
}
template <class R>
MGSFM_TARGET_AVX2 StepSums StepChunkAvx2(
    const PassInput<R>& in, const StepInput& input, const ChunkRanges& chunk,
    std::vector<Eigen::Vector3d>* new_points) {
  return StepChunkBody(in, input, chunk, new_points);
}

// Sets the derivatives of observation k: loads or recomputes them.
template <class R>
MGSFM_ALWAYS_INLINE void LoadDerivatives(const PassInput<R>& in,
                                         const RobustLoss& loss,
                                         const double* kept,
                                         const ImagePose& pose, size_t p,
                                         size_t k, ProductTerms* o) {
  constexpr int kDim = R::kDim;
  if (kept == nullptr) {
    // Cannot fail: Linearize() has succeeded with this state.
    LinearizeObservation<R>(loss, pose, in.points[p].data(),
                            in.measured.data() + kDim * k, o);
  } else {
    double x[3];
    TransformPoint(pose, in.points[p].data(), o->y, x);
    std::copy_n(kept, 3 * kDim, o->P);
    if (R::kHasCamera) {
      std::copy_n(kept + 3 * kDim, kDim * pose.num_free_params, o->K);
    }
  }
  MultiplyRows<kDim>(o->P, 3, pose.cam_from_world, 3, o->J);
}

// Adds the columns of an image times u - J a to its sums.
template <class R, int N>
MGSFM_ALWAYS_INLINE void AddProductToImage(const ProductTerms& o, int num_free,
                                           const double* a, double* sums) {
  constexpr int kDim = R::kDim;
  double Q[3 * kDim];
  if (N == 6) RotationRows<kDim>(o.y, o.P, 3, Q);
  for (int d = 0; d < kDim; ++d) {
    const double* J = o.J + 3 * d;
    const double rest = o.u[d] - J[0] * a[0] - J[1] * a[1] - J[2] * a[2];
    for (int c = 0; c < 3; ++c) {
      if (N == 6) sums[c] += Q[3 * d + c] * rest;
      sums[N - 3 + c] += o.P[3 * d + c] * rest;
    }
    for (int c = 0; c < num_free; ++c) {
      sums[N + c] += o.K[d * num_free + c] * rest;
    }
  }
}

// Multiplies the Schur complement, without its damping, with a vector. Per
// image, the workspace receives the products of its columns with (I - J (V +
// lambda D)^-1 J^T) times the change of the image.
template <class R, int N>
MGSFM_ALWAYS_INLINE void MultiplyChunkBody(const PassInput<R>& in,
                                           KeptDerivatives* kept,
                                           const ImageSteps& steps,
                                           const ChunkRanges& chunk,
                                           SchurWorkspace* w) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  ProductTerms* terms = w->product_terms.data();
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    const size_t begin = s.point_begin[p], end = s.point_begin[p + 1];
    const RobustLoss loss = in.problem.LossOfPoint(end - begin);
    PointHessian V;
    double a[3] = {0.0, 0.0, 0.0};  // J^T u, then (V + lambda D)^-1 J^T u
    for (size_t k = begin; k < end; ++k) {
      const int image = images[s.observation_image[k]].image;
      const ImagePose& pose = in.poses[image];
      ProductTerms& o = terms[k - begin];
      LoadDerivatives(in, loss, kept->Find(k), pose, p, k, &o);
      AddSquareOfPoint<kDim>(o.J, V.values);
      const int num_free = R::kHasCamera ? pose.num_free_params : 0;
      const double* params =
          num_free > 0 ? steps.params[in.problem.images[image].camera].data()
                       : nullptr;
      ApplyStep<kDim>(o.y, o.P, o.K, num_free, steps.twists[image], params,
                      o.u);
      for (int d = 0; d < kDim; ++d) {
        for (int i = 0; i < 3; ++i) a[i] += o.J[3 * d + i] * o.u[d];
      }
    }
    if (in.problem.points_are_free) {
      const PointFactor f = FactorPoint(in, V);
      SolveLower(f, a);
      SolveUpper(f, a);
    } else {
      std::fill_n(a, 3, 0.0);
    }
    for (size_t k = begin; k < end; ++k) {
      const int i = s.observation_image[k];
      if (w->image_num_columns[i] == 0) continue;
      const ImagePose& pose = in.poses[images[i].image];
      AddProductToImage<R, N>(
          terms[k - begin], R::kHasCamera ? pose.num_free_params : 0, a,
          w->image_gradients.data() + kMaxNumImageColumns * i);
    }
  }
}

template <class R, int N>
void MultiplyChunkAny(const PassInput<R>& in, KeptDerivatives* kept,
                      const ImageSteps& steps, const ChunkRanges& chunk,
                      SchurWorkspace* w) {
  MultiplyChunkBody<R, N>(in, kept, steps, chunk, w);
}
template <class R, int N>
MGSFM_TARGET_AVX2 void MultiplyChunkAvx2(const PassInput<R>& in,
                                         KeptDerivatives* kept,
                                         const ImageSteps& steps,
                                         const ChunkRanges& chunk,
                                         SchurWorkspace* w) {
  MultiplyChunkBody<R, N>(in, kept, steps, chunk, w);
}

}  // namespace mgsfm
