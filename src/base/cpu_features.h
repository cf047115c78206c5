// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>

// Functions marked MGSFM_TARGET_AVX2 are compiled for x86-64 processors with
// AVX2 and FMA; HasAvx2() tells whether the program runs on one of those, and
// the environment variable MGSFM_PORTABLE is not set: with it, all processors
// compute as those without.
#if defined(__x86_64__) && defined(__GNUC__)
#define MGSFM_TARGET_AVX2 __attribute__((target("avx2,fma")))
#else
#define MGSFM_TARGET_AVX2
#endif

// Functions of hot loops are inlined into loops that are compiled more than
// once, for different processors.
#if defined(__GNUC__)
#define MGSFM_ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define MGSFM_ALWAYS_INLINE inline
#endif

namespace mgsfm {

inline bool HasAvx2() {
#if defined(__x86_64__) && defined(__GNUC__)
  static const bool kHasAvx2 = std::getenv("MGSFM_PORTABLE") == nullptr &&
                               __builtin_cpu_supports("avx2") &&
                               __builtin_cpu_supports("fma");
  return kHasAvx2;
#else
  return false;
#endif
}

}  // namespace mgsfm
