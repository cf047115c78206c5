// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"

#include <cmath>

#include "mgsfm/base/error.h"

namespace mgsfm {

Random::Random(uint64_t seed, uint64_t stream) : state_(seed) {
  state_ = NextBits() ^ (stream * 0xD1342543DE82EF95ull);
  NextBits();
}

uint64_t Random::NextBits() {
  state_ += 0x9E3779B97F4A7C15ull;
  uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

double Random::Uniform() {
  return static_cast<double>(NextBits() >> 11) * 0x1.0p-53;
}

double Random::Uniform(double low, double high) {
  return low + (high - low) * Uniform();
}

uint32_t Random::Index(uint32_t size) {
  MGSFM_CHECK_GT(size, 0u);
  return static_cast<uint32_t>(((NextBits() >> 32) * size) >> 32);
}

double Random::Normal() {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
  return radius * std::cos(2.0 * 3.14159265358979323846 * Uniform());
}

}  // namespace mgsfm
