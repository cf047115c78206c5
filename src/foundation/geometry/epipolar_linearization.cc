// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "base/cpu_features.h"
#include "geometry/epipolar_terms.h"
#include "geometry/pose_refinement.h"

namespace mgsfm::internal {
namespace {

// An AVX register.
typedef double Four __attribute__((vector_size(32)));
constexpr int kWidth = sizeof(Four) / sizeof(double);

// The ray components of four matches. SIMD lanes without a match have weight 0.
struct FourMatches {
  Four f1[3], f2[3];
  Four weight;
};

MGSFM_ALWAYS_INLINE void Load(const RayMatches& matches, size_t begin,
                              FourMatches* four) {
  const size_t last = matches.size() - 1;
  for (int lane = 0; lane < kWidth; ++lane) {
    const size_t i = std::min(begin + lane, last);
    for (int k = 0; k < 3; ++k) {
      four->f1[k][lane] = matches.rays1[i][k];
      four->f2[k][lane] = matches.rays2[i][k];
    }
    four->weight[lane] = begin + lane <= last ? 1.0 : 0.0;
  }
}

MGSFM_ALWAYS_INLINE void Cross(const Four* a, const Four* b, Four* c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

// Sampson errors r and their gradients as in SampsonAngle. Undefined errors
// have value 0 and weight 0.
MGSFM_ALWAYS_INLINE void ComputeErrors(const EpipolarPose& pose,
                                       const Eigen::Matrix<double, 3, 2>& basis,
                                       FourMatches* m, Four* error,
                                       Four* gradient) {
  const Four zero = {0.0, 0.0, 0.0, 0.0};
  const Four* f = m->f2;
  Four a[3], t[3], n[3], c[3];
  for (int k = 0; k < 3; ++k) {
    t[k] = zero + pose.direction[k];
    a[k] = pose.rotation(k, 0) * m->f1[0] + pose.rotation(k, 1) * m->f1[1] +
           pose.rotation(k, 2) * m->f1[2];
  }
  Cross(a, f, n);
  Cross(a, t, c);
  const Four ta = t[0] * a[0] + t[1] * a[1] + t[2] * a[2];
  const Four tf = t[0] * f[0] + t[1] * f[1] + t[2] * f[2];
  const Four af = a[0] * f[0] + a[1] * f[1] + a[2] * f[2];
  const Four e = t[0] * n[0] + t[1] * n[1] + t[2] * n[2];
  const Four s = 2.0 - ta * ta - tf * tf - 2.0 * e * e;
  Four inv_s, inv_sqrt_s;
  for (int lane = 0; lane < kWidth; ++lane) {
    const bool is_defined = s[lane] > EpipolarTerms::kMinSquaredGradient;
    inv_s[lane] = is_defined ? 1.0 / s[lane] : 0.0;
    inv_sqrt_s[lane] = std::sqrt(inv_s[lane]);
    if (!is_defined) m->weight[lane] = 0.0;
  }
  const Four r = e * inv_sqrt_s;
  const Four by_e = inv_sqrt_s * (1.0 + 2.0 * r * r);
  const Four by_s = r * inv_s;
  *error = r;
  gradient[3] = gradient[4] = zero;
  for (int k = 0; k < 3; ++k) {
    gradient[k] = by_e * (ta * f[k] - af * t[k]) + by_s * ta * c[k];
    const Four by_direction = by_e * n[k] + by_s * (ta * a[k] + tf * f[k]);
    gradient[3] += basis(k, 0) * by_direction;
    gradient[4] += basis(k, 1) * by_direction;
  }
}

MGSFM_ALWAYS_INLINE double SumOf(const Four& lanes) {
  return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
}

MGSFM_ALWAYS_INLINE void SumBody(const RayMatches& matches,
                                 const EpipolarPose& pose,
                                 const Eigen::Matrix<double, 3, 2>& basis,
                                 double loss_scale, PoseSums* sums) {
  const double inv_squared_scale = 1.0 / (loss_scale * loss_scale);
  const Four zero = {0.0, 0.0, 0.0, 0.0};
  Four hessian[15], gradient[5];
  std::fill_n(hessian, 15, zero);
  std::fill_n(gradient, 5, zero);
  LogSum log_sum;
  for (size_t begin = 0; begin < matches.size(); begin += kWidth) {
    FourMatches four;
    Load(matches, begin, &four);
    Four r, g[5];
    ComputeErrors(pose, basis, &four, &r, g);
    const Four x = 1.0 + four.weight * r * r * inv_squared_scale;
    const Four weight = four.weight / x;
    for (int i = 0, k = 0; i < 5; ++i) {
      const Four weighted = weight * g[i];
      gradient[i] += r * weighted;
      for (int j = 0; j <= i; ++j, ++k) hessian[k] += weighted * g[j];
    }
    log_sum.Add((x[0] * x[1]) * (x[2] * x[3]));
  }
  for (int i = 0, k = 0; i < 5; ++i) {
    sums->gradient[i] = SumOf(gradient[i]);
    for (int j = 0; j <= i; ++j, ++k) {
      sums->hessian(i, j) = sums->hessian(j, i) = SumOf(hessian[k]);
    }
  }
  sums->cost = 0.5 * loss_scale * loss_scale * log_sum.Total();
}

void SumAny(const RayMatches& matches, const EpipolarPose& pose,
            const Eigen::Matrix<double, 3, 2>& basis, double loss_scale,
            PoseSums* sums) {
  SumBody(matches, pose, basis, loss_scale, sums);
}
MGSFM_TARGET_AVX2 void SumAvx2(const RayMatches& matches,
                               const EpipolarPose& pose,
                               const Eigen::Matrix<double, 3, 2>& basis,
                               double loss_scale, PoseSums* sums) {
  SumBody(matches, pose, basis, loss_scale, sums);
}

}  // namespace

PoseSums SumSampsonTerms(const RayMatches& matches, const EpipolarPose& pose,
                         const Eigen::Matrix<double, 3, 2>& basis,
                         double loss_scale) {
  PoseSums sums;
  const auto sum = HasAvx2() ? SumAvx2 : SumAny;
  sum(matches, pose, basis, loss_scale, &sums);
  return sums;
}

}  // namespace mgsfm::internal
