// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>

namespace mgsfm {

// Four numbers in a register. Operators act on each of them; a comparison is -1
// where it holds.
using Four = float __attribute__((vector_size(16)));
using FourInts = int32_t __attribute__((vector_size(16)));

inline Four LoadFour(const float* from) {
  Four four;
  std::memcpy(&four, from, sizeof(four));
  return four;
}

template <typename T, typename Vector>
void StoreFour(const Vector& four, T* to) {
  static_assert(sizeof(four) == 4 * sizeof(T));
  std::memcpy(to, &four, sizeof(four));
}

inline bool HasAny(const FourInts& comparison) {
  uint64_t halves[2];
  std::memcpy(halves, &comparison, sizeof(halves));
  return (halves[0] | halves[1]) != 0;
}

}  // namespace mgsfm
