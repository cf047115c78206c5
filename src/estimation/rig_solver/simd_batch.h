// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/cpu_features.h"

namespace mgsfm {

// A vector of N doubles. Uses vector registers explicitly if possible.
template <int N>
struct SimdBatch {
  double values[N];

  MGSFM_ALWAYS_INLINE void Load(const double* from) {
    for (int i = 0; i < N; ++i) values[i] = from[i];
  }
  MGSFM_ALWAYS_INLINE void Store(double* to) const {
    for (int i = 0; i < N; ++i) to[i] = values[i];
  }
  MGSFM_ALWAYS_INLINE void Scale(double factor) {
    for (int i = 0; i < N; ++i) values[i] *= factor;
  }
  MGSFM_ALWAYS_INLINE void AddScaled(const SimdBatch& other, double factor) {
    for (int i = 0; i < N; ++i) values[i] += other.values[i] * factor;
  }
};

#if defined(__GNUC__)
template <>
struct SimdBatch<6> {
  // For unaligned memory; `using` does not accept these attributes.
  // NOLINTBEGIN(modernize-use-using)
  typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));
  typedef double Two __attribute__((vector_size(16), aligned(8), may_alias));
  // NOLINTEND(modernize-use-using)
  Four four;
  Two two;

  MGSFM_ALWAYS_INLINE void Load(const double* from) {
    four = *reinterpret_cast<const Four*>(from);
    two = *reinterpret_cast<const Two*>(from + 4);
  }
  MGSFM_ALWAYS_INLINE void Store(double* to) const {
    *reinterpret_cast<Four*>(to) = four;
    *reinterpret_cast<Two*>(to + 4) = two;
  }
  MGSFM_ALWAYS_INLINE void Scale(double factor) {
    four *= factor;
    two *= factor;
  }
  MGSFM_ALWAYS_INLINE void AddScaled(const SimdBatch& other, double factor) {
    four += other.four * factor;
    two += other.two * factor;
  }
};
#endif

}  // namespace mgsfm
