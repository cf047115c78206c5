// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/cpu_features.h"
#include "least_squares/chunk_kernels.h"

// Passes over the points of a chunk. Each is compiled for generic x86-64 and
// for AVX2 with FMA; the choice is made at run time.

namespace mgsfm {

// The output of a linearisation besides the workspace, which receives the local
// system of the chunk after elimination of its points (images still separate).
template <class R>
struct LinearizeOutput {
  std::vector<PointHessian>& hessians;
  std::vector<Eigen::Vector3d>& gradients;
  // P and K of all observations for MultiplyChunk; empty if direct.
  std::vector<double>& kept;
  size_t kept_size = 0;
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
                                            const LinearizeOutput<R>& out,
                                            ChunkWorkspace* w) {
  const RigStructure& s = in.structure;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    double* kept = out.kept.empty()
                       ? nullptr
                       : out.kept.data() + out.kept_size * s.point_begin[p];
    if (!LinearizePoint<R, N>(in, chunk, p, &out.hessians[p],
                              out.gradients[p].data(), kept, out.kept_size,
                              w)) {
      return false;
    }
    if (!in.problem.points_are_free) continue;
    const size_t end = s.point_begin[p + 1];
    size_t end_of_part = EndOfPart(s, s.point_begin[p], end);
    const bool is_cut = end_of_part < end;
    EliminatePoint<N>(FactorPoint(in, out.hessians[p]), out.gradients[p].data(),
                      is_cut, w);
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
                       const LinearizeOutput<R>& out, ChunkWorkspace* w) {
  return LinearizeChunkBody<R, N>(in, chunk, out, w);
}
template <class R, int N>
MGSFM_TARGET_AVX2 bool LinearizeChunkAvx2(const PassInput<R>& in,
                                          const ChunkRanges& chunk,
                                          const LinearizeOutput<R>& out,
                                          ChunkWorkspace* w) {
  return LinearizeChunkBody<R, N>(in, chunk, out, w);
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

// b += (P S R)^T u.
template <int kDim>
MGSFM_ALWAYS_INLINE void AddToPoint(const ImagePose& pose, const double* P,
                                    const double* u, double* b) {
  double f[3] = {0.0, 0.0, 0.0};
  for (int k = 0; k < kDim; ++k) {
    for (int i = 0; i < 3; ++i) f[i] += P[3 * k + i] * u[k];
  }
  const double* m = pose.cam_from_world;
  for (int i = 0; i < 3; ++i) {
    b[i] += m[i] * f[0] + m[3 + i] * f[1] + m[6 + i] * f[2];
  }
}

// The cost of the observations of a point; infinite if one is undefined.
template <class R>
MGSFM_ALWAYS_INLINE double CostOfPoint(const RigProblemBase& problem,
                                       const RigStructure& s,
                                       const ChunkRanges& chunk,
                                       const std::vector<double>& measured,
                                       const std::vector<ImagePose>& poses,
                                       size_t p, const double* point) {
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
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
    cost += 0.5 * problem.loss.Cost(squared);
  }
  return cost;
}

template <class R>
struct StepInput {
  const std::vector<PointHessian>& hessians;
  const std::vector<Eigen::Vector3d>& gradients;
  const ImageSteps& steps;
  const std::vector<ImagePose>& new_poses;
};

// d = -(V + lambda D)^-1 (g + W z). Returns the square of the point's distance
// from the closest camera that observes it.
template <class R>
MGSFM_ALWAYS_INLINE double StepOfPoint(const PassInput<R>& in,
                                       const StepInput<R>& step,
                                       const ChunkRanges& chunk, size_t p,
                                       double* d) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  double b[3] = {step.gradients[p][0], step.gradients[p][1],
                 step.gradients[p][2]};
  double squared_distance = std::numeric_limits<double>::infinity();
  ObservationTerms<kDim> o;
  for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
    const int image = images[s.observation_image[k]].image;
    const ImagePose& pose = in.poses[image];
    if (!LinearizeObservation<R>(in.problem.loss, pose, in.points[p].data(),
                                 in.measured.data() + kDim * k, &o)) {
      continue;
    }
    const double* t = pose.translation;
    const double x[3] = {o.y[0] + t[0], o.y[1] + t[1], o.y[2] + t[2]};
    squared_distance =
        std::min(squared_distance, x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    const int num_free = R::kHasCamera ? pose.num_free_params : 0;
    const double* params =
        num_free > 0 ? step.steps.params[in.problem.images[image].camera].data()
                     : nullptr;
    double u[kDim];
    ApplyStep<kDim>(o.y, o.P, o.K, num_free, step.steps.twists[image], params,
                    u);
    AddToPoint<kDim>(pose, o.P, u, b);
  }
  const PointFactor f = FactorPoint(in, step.hessians[p]);
  SolveLower(f, b);
  SolveUpper(f, b);
  for (int i = 0; i < 3; ++i) d[i] = -b[i];
  return squared_distance;
}

// The linear model of a point is unreliable for steps beyond this fraction of
// its distance. Reprojections are inversely proportional to depth, so for
// shorter steps the model misses at most a tenth of their change.
constexpr double kLongStep = 0.1;
// A point whose step still fails at 1/64 stays for this iteration.
constexpr int kMaxNumPointHalvings = 6;

// Moves a point to old_point + fraction * d with the first fraction of 1, 1/2,
// ..., 1/64 whose cost is finite and at most `bound`, otherwise 0. Returns the
// new cost.
template <class Cost>
MGSFM_ALWAYS_INLINE double MovePoint(const double* old_point, const double* d,
                                     double bound, const Cost& cost_at,
                                     double* point) {
  double fraction = 1.0;
  for (int i = 0; i <= kMaxNumPointHalvings; ++i, fraction *= 0.5) {
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
    const PassInput<R>& in, const StepInput<R>& step, const ChunkRanges& chunk,
    std::vector<Eigen::Vector3d>* new_points) {
  StepSums sums;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    double d[3] = {0.0, 0.0, 0.0};
    double squared_distance = 0.0;
    if (in.problem.points_are_free) {
      squared_distance = StepOfPoint(in, step, chunk, p, d);
    }
    const double* old_point = in.points[p].data();
    double D[3];
    DiagonalOfPoint(step.hessians[p], D);
    double squared_step = 0.0;
    for (int i = 0; i < 3; ++i) {
      sums.decrease += d[i] * (in.lambda * D[i] * d[i] - step.gradients[p][i]);
      squared_step += d[i] * d[i];
      sums.squared_position += old_point[i] * old_point[i];
    }
    sums.squared_step += squared_step;
    const auto cost_at = [&](const double* point) {
      return CostOfPoint<R>(in.problem, in.structure, chunk, in.measured,
                            step.new_poses, p, point);
    };
    const bool is_long =
        squared_step > kLongStep * kLongStep * squared_distance;
    const double bound =
        is_long ? cost_at(old_point) : std::numeric_limits<double>::infinity();
    sums.cost +=
        MovePoint(old_point, d, bound, cost_at, (*new_points)[p].data());
  }
  return sums;
}

template <class R>
StepSums StepChunkAny(const PassInput<R>& in, const StepInput<R>& step,
                      const ChunkRanges& chunk,
                      std::vector<Eigen::Vector3d>* new_points) {
  return StepChunkBody(in, step, chunk, new_points);
}
template <class R>
MGSFM_TARGET_AVX2 StepSums StepChunkAvx2(
    const PassInput<R>& in, const StepInput<R>& step, const ChunkRanges& chunk,
    std::vector<Eigen::Vector3d>* new_points) {
  return StepChunkBody(in, step, chunk, new_points);
}

// Multiplies the reduced matrix, without its damping, with a vector. Per image,
// the workspace receives the products of its columns with
// (I - J (V + lambda D)^-1 J^T) times the change of the image.
template <class R, int N>
MGSFM_ALWAYS_INLINE void MultiplyChunkBody(const PassInput<R>& in,
                                           const LinearizeOutput<R>& linear,
                                           const ImageSteps& steps,
                                           const ChunkRanges& chunk,
                                           ChunkWorkspace* w) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    double a[3] = {0.0, 0.0, 0.0};
    for (int half = 0; half < 2; ++half) {
      double b[3] = {0.0, 0.0, 0.0};
      for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
        const int i = s.observation_image[k];
        const int image = images[i].image;
        const ImagePose& pose = in.poses[image];
        double y[3], x[3];
        TransformPoint(pose, in.points[p].data(), y, x);
        const double* P = linear.kept.data() + linear.kept_size * k;
        const double* K = P + 3 * kDim;
        const int num_free = R::kHasCamera ? pose.num_free_params : 0;
        const double* params =
            num_free > 0 ? steps.params[in.problem.images[image].camera].data()
                         : nullptr;
        double u[kDim];
        ApplyStep<kDim>(y, P, K, num_free, steps.twists[image], params, u);
        if (half == 0) {
          AddToPoint<kDim>(pose, P, u, b);
          continue;
        }
        if (w->image_num_columns[i] == 0) continue;
        double J[3 * kDim], Q[3 * kDim];
        MultiplyRows<kDim>(P, 3, pose.cam_from_world, 3, J);
        if (N == 6) RotationRows<kDim>(y, P, 3, Q);
        double* sums = w->image_gradients.data() + kMaxNumImageColumns * i;
        for (int d = 0; d < kDim; ++d) {
          const double rest = u[d] - J[3 * d] * a[0] - J[3 * d + 1] * a[1] -
                              J[3 * d + 2] * a[2];
          for (int c = 0; c < 3; ++c) {
            if (N == 6) sums[c] += Q[3 * d + c] * rest;
            sums[N - 3 + c] += P[3 * d + c] * rest;
          }
          for (int c = 0; c < num_free; ++c) {
            sums[N + c] += K[d * num_free + c] * rest;
          }
        }
      }
      if (half == 1 || !in.problem.points_are_free) continue;
      const PointFactor f = FactorPoint(in, linear.hessians[p]);
      SolveLower(f, b);
      SolveUpper(f, b);
      for (int i = 0; i < 3; ++i) a[i] = b[i];
    }
  }
}

template <class R, int N>
void MultiplyChunkAny(const PassInput<R>& in, const LinearizeOutput<R>& linear,
                      const ImageSteps& steps, const ChunkRanges& chunk,
                      ChunkWorkspace* w) {
  MultiplyChunkBody<R, N>(in, linear, steps, chunk, w);
}
template <class R, int N>
MGSFM_TARGET_AVX2 void MultiplyChunkAvx2(const PassInput<R>& in,
                                         const LinearizeOutput<R>& linear,
                                         const ImageSteps& steps,
                                         const ChunkRanges& chunk,
                                         ChunkWorkspace* w) {
  MultiplyChunkBody<R, N>(in, linear, steps, chunk, w);
}

}  // namespace mgsfm
