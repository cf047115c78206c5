// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>

// MGSFM_TARGET_AVX2 compiles a function for x86-64 processors with AVX2 and
// FMA. HasAvx2() returns whether the processor supports both. The environment
// variable MGSFM_PORTABLE disables them, so that all processors compute alike.
#if defined(__x86_64__)
#define MGSFM_TARGET_AVX2 __attribute__((target("avx2,fma")))
#else
#define MGSFM_TARGET_AVX2
#endif

// Forces inlining into loops that are compiled once per instruction set.
#define MGSFM_ALWAYS_INLINE inline __attribute__((always_inline))

namespace mgsfm {

inline bool HasAvx2() {
#if defined(__x86_64__)
  static const bool kHasAvx2 = std::getenv("MGSFM_PORTABLE") == nullptr &&
                               __builtin_cpu_supports("avx2") &&
                               __builtin_cpu_supports("fma");
  return kHasAvx2;
#else
  return false;
#endif
}

}  // namespace mgsfm
