// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace mgsfm {

// A fast seeded generator (splitmix64). Unlike the distributions of <random>,
// it returns the same numbers with every compiler and standard library.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}
  // An independent generator for item `stream` of a parallel loop.
  Random(uint64_t seed, uint64_t stream);

  uint64_t NextBits();
  // Uniform in [0, 1).
  double Uniform();
  // Uniform in [low, high).
  double Uniform(double low, double high);
  // Uniform integer in [0, size); size > 0.
  uint32_t Index(uint32_t size);
  // Standard normal (Box-Muller).
  double Normal();

 private:
  uint64_t state_;
};

}  // namespace mgsfm
