// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "rig_solver/damping.h"
#include "rig_solver/image_poses.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_structure.h"
#include "rig_solver/schur_workspace.h"
#include "rig_solver/simd_batch.h"

// The inner loops over the observations of points, on plain arrays. They are
// inlined into the passes of schur_passes.h, which are compiled for several
// instruction sets. R is a residual type, N the size of pose blocks: 6, or 3 if
// no rotation is free. docs/maths/rig_solver.md has the formulas.
namespace mgsfm {

// The input of passes. Points are in the order of the structure.
template <class R>
struct PassInput {
  const RigProblemBase& problem;
  const RigStructure& structure;
  // R::kDim per observation.
  const std::vector<typename R::Scalar>& measured;
  const std::vector<ImagePose>& poses;
  const std::vector<Eigen::Vector3d>& points;
  double lambda;
};

// Symmetric 3 x 3: (0,0), (1,0), (1,1), (2,0), (2,1), (2,2).
struct PointHessian {
  double values[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
};

// Cholesky factor of V + lambda D, with the inverse of its diagonal.
struct PointFactor {
  double l10, l20, l21;
  double inverse0, inverse1, inverse2;
};

// Smaller pivots, relative to the diagonal, are due to rounding.
inline constexpr double kMinPivot = 1e-15;

// D of a point; see rig_equations.h.
MGSFM_ALWAYS_INLINE void DiagonalOfPoint(const PointHessian& hessian,
                                         double* D) {
  const double* v = hessian.values;
  D[0] = ClampDiagonal(v[0]);
  D[1] = ClampDiagonal(v[2]);
  D[2] = ClampDiagonal(v[5]);
}

template <class R>
MGSFM_ALWAYS_INLINE PointFactor FactorPoint(const PassInput<R>& in,
                                            const PointHessian& hessian) {
  const double* v = hessian.values;
  double D[3];
  DiagonalOfPoint(hessian, D);
  const double d0 = v[0] + in.lambda * D[0];
  const double d1 = v[2] + in.lambda * D[1];
  const double d2 = v[5] + in.lambda * D[2];
  PointFactor f;
  f.inverse0 = 1.0 / std::sqrt(d0);
  f.l10 = v[1] * f.inverse0;
  f.l20 = v[3] * f.inverse0;
  f.inverse1 = 1.0 / std::sqrt(std::max(d1 - f.l10 * f.l10, kMinPivot * d1));
  f.l21 = (v[4] - f.l20 * f.l10) * f.inverse1;
  f.inverse2 = 1.0 / std::sqrt(std::max(d2 - f.l20 * f.l20 - f.l21 * f.l21,
                                        kMinPivot * d2));
  return f;
}

// b <- L^-1 b.
MGSFM_ALWAYS_INLINE void SolveLower(const PointFactor& f, double* b) {
  b[0] *= f.inverse0;
  b[1] = (b[1] - f.l10 * b[0]) * f.inverse1;
  b[2] = (b[2] - f.l20 * b[0] - f.l21 * b[1]) * f.inverse2;
}

// b <- L^-T b.
MGSFM_ALWAYS_INLINE void SolveUpper(const PointFactor& f, double* b) {
  b[2] *= f.inverse2;
  b[1] = (b[1] - f.l21 * b[2]) * f.inverse1;
  b[0] = (b[0] - f.l10 * b[1] - f.l20 * b[2]) * f.inverse0;
}

// y = S R (p - c), x = y + t.
MGSFM_ALWAYS_INLINE void TransformPoint(const ImagePose& pose, const double* p,
                                        double* y, double* x) {
  const double* m = pose.cam_from_world;
  const double d0 = p[0] - pose.center[0];
  const double d1 = p[1] - pose.center[1];
  const double d2 = p[2] - pose.center[2];
  for (int i = 0; i < 3; ++i) {
    y[i] = m[3 * i] * d0 + m[3 * i + 1] * d1 + m[3 * i + 2] * d2;
    x[i] = y[i] + pose.translation[i];
  }
}

// An observation; all values are scaled by the square root of its weight.
template <int kDim>
struct ObservationTerms {
  double y[3];
  double residual[kDim];
  double P[3 * kDim];                    // by x
  double K[kDim * kMaxNumCameraParams];  // by free parameters
};

// Sets y, residual, P and K. False if the residual is undefined.
template <class R, class Terms>
MGSFM_ALWAYS_INLINE bool LinearizeObservation(
    const RobustLoss& loss, const ImagePose& pose, const double* point,
    const typename R::Scalar* measured, Terms* o) {
  double x[3];
  TransformPoint(pose, point, o->y, x);
  if (!R::Linearize(pose, x, measured, o->residual, o->P, o->K)) {
    return false;
  }
  double squared = 0.0;
  for (int i = 0; i < R::kDim; ++i) squared += o->residual[i] * o->residual[i];
  const double weight = LossWeight(loss, squared);
  if (weight == 1.0) return true;
  const double root = std::sqrt(weight);
  for (int i = 0; i < R::kDim; ++i) o->residual[i] *= root;
  for (int i = 0; i < 3 * R::kDim; ++i) o->P[i] *= root;
  if (R::kHasCamera) {
    for (int i = 0; i < R::kDim * pose.num_free_params; ++i) o->K[i] *= root;
  }
  return true;
}

// The coupling of a block to the current point: three columns.
MGSFM_ALWAYS_INLINE double* CouplingOf(int block, size_t point,
                                       SchurWorkspace* w) {
  double* coupling = w->couplings.data() + kCouplingSize * block;
  if (w->last_point[block] != point) {
    w->last_point[block] = point;
    w->met[w->num_met++] = block;
    std::fill_n(coupling, 3 * w->block_size[block], 0.0);
  }
  return coupling;
}

// Rows y x a_i: derivatives with respect to a rotation of a function whose
// derivatives with respect to y are a_i. Rows of the result have this stride.
template <int kDim>
MGSFM_ALWAYS_INLINE void RotationRows(const double* y, const double* a,
                                      int stride, double* q) {
  for (int i = 0; i < kDim; ++i) {
    const double* r = a + 3 * i;
    q[stride * i] = y[1] * r[2] - y[2] * r[1];
    q[stride * i + 1] = y[2] * r[0] - y[0] * r[2];
    q[stride * i + 2] = y[0] * r[1] - y[1] * r[0];
  }
}

// result = a m with kDim rows of 3 and a 3 x 3 matrix m. Rows have this stride.
template <int kDim>
MGSFM_ALWAYS_INLINE void MultiplyRows(const double* a, int a_stride,
                                      const double* m, int stride,
                                      double* result) {
  for (int i = 0; i < kDim; ++i) {
    const double* r = a + a_stride * i;
    for (int j = 0; j < 3; ++j) {
      result[stride * i + j] = r[0] * m[j] + r[1] * m[3 + j] + r[2] * m[6 + j];
    }
  }
}

// coupling += rows^T J: rows kDim x kSize, J kDim x 3, three columns of kSize.
template <int kDim, int kSize>
MGSFM_ALWAYS_INLINE void AddCoupling(const double* rows, const double* J,
                                     double* coupling) {
  SimdBatch<kSize> row[kDim];
  for (int k = 0; k < kDim; ++k) row[k].Load(rows + kSize * k);
  for (int j = 0; j < 3; ++j) {
    SimdBatch<kSize> column;
    column.Load(coupling + kSize * j);
    for (int k = 0; k < kDim; ++k) column.AddScaled(row[k], J[3 * k + j]);
    column.Store(coupling + kSize * j);
  }
}

// The same for any size.
template <int kDim>
MGSFM_ALWAYS_INLINE void AddCoupling(const double* rows, int size,
                                     const double* J, double* coupling) {
  for (int j = 0; j < 3; ++j) {
    for (int k = 0; k < kDim; ++k) {
      for (int i = 0; i < size; ++i) {
        coupling[j * size + i] += rows[k * size + i] * J[3 * k + j];
      }
    }
  }
}

// hessian (kSize x kSize) += rows^T rows, gradient += rows^T r.
template <int kDim, int kSize>
MGSFM_ALWAYS_INLINE void AddSquare(const double* rows, const double* r,
                                   double* hessian, double* gradient) {
  SimdBatch<kSize> row[kDim];
  SimdBatch<kSize> sum;
  sum.Load(gradient);
  for (int k = 0; k < kDim; ++k) {
    row[k].Load(rows + kSize * k);
    sum.AddScaled(row[k], r[k]);
  }
  sum.Store(gradient);
  for (int j = 0; j < kSize; ++j) {
    SimdBatch<kSize> column;
    column.Load(hessian + kSize * j);
    for (int k = 0; k < kDim; ++k) {
      column.AddScaled(row[k], rows[kSize * k + j]);
    }
    column.Store(hessian + kSize * j);
  }
}

// The same for the N columns of an image followed by those of its parameters.
template <int kDim, int N>
MGSFM_ALWAYS_INLINE void AddSquareWithParams(const double* rows,
                                             const double* K, int num_free,
                                             const double* r, double* hessian,
                                             double* gradient) {
  const int size = N + num_free;
  double all[kDim * kMaxNumImageColumns];
  for (int k = 0; k < kDim; ++k) {
    double* row = all + k * size;
    for (int i = 0; i < N; ++i) row[i] = rows[k * N + i];
    for (int i = 0; i < num_free; ++i) row[N + i] = K[k * num_free + i];
    for (int i = 0; i < size; ++i) gradient[i] += row[i] * r[k];
  }
  for (int k = 0; k < kDim; ++k) {
    const double* row = all + k * size;
    for (int j = 0; j < size; ++j) {
      for (int i = 0; i < size; ++i) hessian[j * size + i] += row[i] * row[j];
    }
  }
}

// Derivatives of a residual: N columns for pose blocks.
template <int kDim, int N>
struct ObservationRows {
  double point[3 * kDim];
  double image[N * kDim];  // with respect to rotation (if N is 6) and shift
  double frame[N * kDim];
};

template <int kDim, int N, class Terms>
MGSFM_ALWAYS_INLINE void ComputeRows(const ImagePose& pose, const Terms& o,
                                     ObservationRows<kDim, N>* rows) {
  MultiplyRows<kDim>(o.P, 3, pose.cam_from_world, 3, rows->point);
  for (int k = 0; k < kDim; ++k) {
    for (int i = 0; i < 3; ++i) {
      rows->image[N * k + N - 3 + i] = o.P[3 * k + i];
      rows->frame[N * k + N - 3 + i] = -rows->point[3 * k + i];
    }
  }
  if (N == 6) {
    RotationRows<kDim>(o.y, o.P, N, rows->image);
    MultiplyRows<kDim>(rows->image, N, pose.sensor_from_frame, N, rows->frame);
  }
}

// Computes the rows of observation k of a point. False if undefined.
template <class R, int N>
MGSFM_ALWAYS_INLINE bool ComputeRowsOf(const PassInput<R>& in,
                                       const RobustLoss& loss,
                                       const ImagePose& pose, size_t point,
                                       size_t k, ObservationTerms<R::kDim>* o,
                                       ObservationRows<R::kDim, N>* rows) {
  if (!LinearizeObservation<R>(loss, pose, in.points[point].data(),
                               in.measured.data() + R::kDim * k, o)) {
    return false;
  }
  ComputeRows<R::kDim, N>(pose, *o, rows);
  return true;
}

// Adds the couplings of the blocks of an image to a point or to a part of it.
template <class R, int N, class Terms>
MGSFM_ALWAYS_INLINE void AddCouplings(const ImagePose& pose,
                                      const ChunkImage& image, size_t point,
                                      const Terms& o,
                                      const ObservationRows<R::kDim, N>& rows,
                                      SchurWorkspace* w) {
  constexpr int kDim = R::kDim;
  if (image.frame != kNoBlock) {
    AddCoupling<kDim, N>(rows.frame, rows.point,
                         CouplingOf(image.frame, point, w));
  }
  if (image.sensor != kNoBlock) {
    AddCoupling<kDim, N>(rows.image, rows.point,
                         CouplingOf(image.sensor, point, w));
  }
  if (image.camera != kNoBlock) {
    AddCoupling<kDim>(o.K, R::kHasCamera ? pose.num_free_params : 0, rows.point,
                      CouplingOf(image.camera, point, w));
  }
}

// Adds an observation to its image.
template <class R, int N>
MGSFM_ALWAYS_INLINE void AddToImage(const ImagePose& pose, int image_idx,
                                    const ObservationTerms<R::kDim>& o,
                                    const ObservationRows<R::kDim, N>& rows,
                                    SchurWorkspace* w) {
  constexpr int kDim = R::kDim;
  double* hessian =
      w->image_hessians.data() + w->image_hessian_begin[image_idx];
  double* gradient =
      w->image_gradients.data() + kMaxNumImageColumns * image_idx;
  const int num_free = R::kHasCamera ? pose.num_free_params : 0;
  if (num_free == 0) {
    AddSquare<kDim, N>(rows.image, o.residual, hessian, gradient);
  } else {
    AddSquareWithParams<kDim, N>(rows.image, o.K, num_free, o.residual, hessian,
                                 gradient);
  }
}

// v += J^T J, as in PointHessian.
template <int kDim>
MGSFM_ALWAYS_INLINE void AddSquareOfPoint(const double* J, double* v) {
  for (int d = 0; d < kDim; ++d) {
    for (int a = 0, e = 0; a < 3; ++a) {
      for (int b = 0; b <= a; ++b, ++e) v[e] += J[3 * d + a] * J[3 * d + b];
    }
  }
}

template <class R>
MGSFM_ALWAYS_INLINE void StoreTerms(const ImagePose& pose,
                                    const ObservationTerms<R::kDim>& o,
                                    ProductTerms* stored) {
  std::copy_n(o.y, 3, stored->y);
  std::copy_n(o.P, 3 * R::kDim, stored->P);
  if (R::kHasCamera) {
    std::copy_n(o.K, R::kDim * pose.num_free_params, stored->K);
  }
}

// Adds the observations of a point to its images and to its own equations.
// Stores its couplings, and the terms of a cut point, in the workspace. If not
// null, `kept` receives P and K of each observation (kept_size values).
template <class R, int N>
MGSFM_ALWAYS_INLINE bool LinearizePoint(const PassInput<R>& in,
                                        const ChunkRanges& chunk, size_t point,
                                        bool is_cut, PointHessian* V, double* g,
                                        double* kept, size_t kept_size,
                                        SchurWorkspace* w) {
  constexpr int kDim = R::kDim;
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  double v[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  double gradient[3] = {0.0, 0.0, 0.0};
  const RobustLoss loss =
      in.problem.LossOfPoint(s.point_begin[point + 1] - s.point_begin[point]);
  ObservationTerms<kDim> o;
  w->num_met = 0;
  for (size_t k = s.point_begin[point]; k < s.point_begin[point + 1]; ++k) {
    const int i = s.observation_image[k];
    const ImagePose& pose = in.poses[images[i].image];
    ObservationRows<kDim, N> rows;
    if (!ComputeRowsOf<R, N>(in, loss, pose, point, k, &o, &rows)) return false;
    const double* J = rows.point;
    AddSquareOfPoint<kDim>(J, v);
    for (int d = 0; d < kDim; ++d) {
      for (int a = 0; a < 3; ++a) gradient[a] += J[3 * d + a] * o.residual[d];
    }
    if (w->image_num_columns[i] > 0) {
      AddToImage<R, N>(pose, i, o, rows, w);
      AddCouplings<R, N>(pose, images[i], point, o, rows, w);
    }
    if (is_cut) {
      StoreTerms<R>(pose, o, &w->product_terms[k - s.point_begin[point]]);
    }
    if (kept != nullptr) {
      double* to = kept + kept_size * (k - s.point_begin[point]);
      std::copy_n(o.P, 3 * kDim, to);
      if (R::kHasCamera) {
        std::copy_n(o.K, kDim * pose.num_free_params, to + 3 * kDim);
      }
    }
  }
  std::copy_n(v, 6, V->values);
  std::copy_n(gradient, 3, g);
  return std::isfinite(v[0] + v[2] + v[5] + gradient[0] + gradient[1] +
                       gradient[2]);
}

// b <- U = W L^-T of a block, correction += U u.
template <int kSize>
MGSFM_ALWAYS_INLINE void ScaleCoupling(const PointFactor& f, const double* u,
                                       double* W, double* correction) {
  SimdBatch<kSize> u0, u1, u2, sum;
  u0.Load(W);
  u1.Load(W + kSize);
  u2.Load(W + 2 * kSize);
  u0.Scale(f.inverse0);
  u1.AddScaled(u0, -f.l10);
  u1.Scale(f.inverse1);
  u2.AddScaled(u0, -f.l20);
  u2.AddScaled(u1, -f.l21);
  u2.Scale(f.inverse2);
  u0.Store(W);
  u1.Store(W + kSize);
  u2.Store(W + 2 * kSize);
  sum.Load(correction);
  sum.AddScaled(u0, u[0]);
  sum.AddScaled(u1, u[1]);
  sum.AddScaled(u2, u[2]);
  sum.Store(correction);
}

MGSFM_ALWAYS_INLINE void ScaleCoupling(const PointFactor& f, const double* u,
                                       int size, double* W,
                                       double* correction) {
  for (int r = 0; r < size; ++r) {
    const double u0 = W[r] * f.inverse0;
    const double u1 = (W[size + r] - f.l10 * u0) * f.inverse1;
    const double u2 = (W[2 * size + r] - f.l20 * u0 - f.l21 * u1) * f.inverse2;
    W[r] = u0;
    W[size + r] = u1;
    W[2 * size + r] = u2;
    correction[r] += u0 * u[0] + u1 * u[1] + u2 * u[2];
  }
}

// pair (kSize x kSize) -= a b^T, a and b of three columns.
template <int kSize>
MGSFM_ALWAYS_INLINE void SubtractProduct(const SimdBatch<kSize>* a,
                                         const double* b, double* pair) {
  for (int j = 0; j < kSize; ++j) {
    SimdBatch<kSize> column;
    column.Load(pair + kSize * j);
    column.AddScaled(a[0], -b[j]);
    column.AddScaled(a[1], -b[kSize + j]);
    column.AddScaled(a[2], -b[2 * kSize + j]);
    column.Store(pair + kSize * j);
  }
}

MGSFM_ALWAYS_INLINE void SubtractProduct(const double* a, int rows,
                                         const double* b, int columns,
                                         double* pair) {
  for (int j = 0; j < columns; ++j) {
    const double b0 = b[j], b1 = b[columns + j], b2 = b[2 * columns + j];
    double* column = pair + j * rows;
    for (int i = 0; i < rows; ++i) {
      column[i] -= a[i] * b0 + a[rows + i] * b1 + a[2 * rows + i] * b2;
    }
  }
}

// Subtracts U U^T from the local matrix.
template <int N>
MGSFM_ALWAYS_INLINE void SubtractProducts(SchurWorkspace* w) {
  const int* met = w->met.data();
  for (size_t i = 0; i < w->num_met; ++i) {
    const int row = met[i];
    const int rows = w->block_size[row];
    const double* a = w->couplings.data() + kCouplingSize * row;
    const int* pair_begin = w->pair_begin.data() + row * w->num_blocks;
    SimdBatch<N> lanes[3];  // used if rows == N
    for (int k = 0; k < 3; ++k) lanes[k].Load(a + N * k);
    for (size_t k = 0; k <= i; ++k) {
      const int column = met[k];
      if (pair_begin[column] == kNoPair) continue;
      const int columns = w->block_size[column];
      const double* b = w->couplings.data() + kCouplingSize * column;
      double* pair = w->pair_values.data() + pair_begin[column];
      if (rows == N && columns == N) {
        SubtractProduct<N>(lanes, b, pair);
      } else {
        SubtractProduct(a, rows, b, columns, pair);
      }
    }
  }
}

// Eliminates a point from the local system: with U = W L^-T of each block,
// subtracts U U^T from the matrix and adds U L^-1 g to the right-hand side. For
// cut points, EliminatePart() updates the matrix.
template <int N>
MGSFM_ALWAYS_INLINE void EliminatePoint(const PointFactor& f, const double* g,
                                        bool is_cut, SchurWorkspace* w) {
  double u[3] = {g[0], g[1], g[2]};
  SolveLower(f, u);
  int* met = w->met.data();
  for (size_t i = 1; i < w->num_met; ++i) {
    const int block = met[i];
    size_t k = i;
    for (; k > 0 && met[k - 1] > block; --k) met[k] = met[k - 1];
    met[k] = block;
  }
  for (size_t i = 0; i < w->num_met; ++i) {
    const int block = met[i];
    double* W = w->couplings.data() + kCouplingSize * block;
    double* correction = w->correction.data() + w->block_first[block];
    if (w->block_is_masked[block]) {
      const double* mask = &w->block_mask[6 * block + 6 - N];
      for (int j = 0; j < 3; ++j) {
        for (int r = 0; r < N; ++r) W[j * N + r] *= mask[r];
      }
    }
    if (w->block_size[block] == N) {
      ScaleCoupling<N>(f, u, W, correction);
    } else {
      ScaleCoupling(f, u, w->block_size[block], W, correction);
    }
  }
  if (!is_cut) SubtractProducts<N>(w);
}

// Eliminates the observations [begin, end) of a point from the local matrix as
// if they were a point of their own. LinearizePoint() has stored their terms.
template <class R, int N>
MGSFM_ALWAYS_INLINE void EliminatePart(const PassInput<R>& in,
                                       const ChunkRanges& chunk, size_t point,
                                       size_t begin, size_t end,
                                       SchurWorkspace* w) {
  constexpr double kNoGradient[3] = {0.0, 0.0, 0.0};
  const RigStructure& s = in.structure;
  const ChunkImage* images = s.chunk_images.data() + chunk.images.begin;
  // Differs from every point index.
  const size_t part = s.point_order.size() + begin;
  PointHessian V;
  w->num_met = 0;
  for (size_t k = begin; k < end; ++k) {
    const int i = s.observation_image[k];
    const ImagePose& pose = in.poses[images[i].image];
    const ProductTerms& o = w->product_terms[k - s.point_begin[point]];
    ObservationRows<R::kDim, N> rows;
    ComputeRows<R::kDim, N>(pose, o, &rows);
    AddSquareOfPoint<R::kDim>(rows.point, V.values);
    AddCouplings<R, N>(pose, images[i], part, o, rows, w);
  }
  EliminatePoint<N>(FactorPoint(in, V), kNoGradient, false, w);
}

}  // namespace mgsfm
