// SPDX-License-Identifier: BSD-3-Clause
#include "machine_limits.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

#include "mgsfm/base/timer.h"
#include "rig_solver/schur_passes.h"

namespace mgsfm {
namespace {

constexpr int kNumRuns = 7;

double MeasureCopy() {
  constexpr size_t kSize = size_t{64} << 20;  // beyond any cache
  std::vector<char> from(kSize, 1), to(kSize, 2);
  double best = 0.0;
  for (int run = 0; run < kNumRuns; ++run) {
    from[run] = static_cast<char>(run);
    const Timer timer;
    std::memcpy(to.data(), from.data(), kSize);
    const double seconds = timer.Seconds();
    if (to[run] != from[run]) return 0.0;
    best = std::max(best, 2.0 * kSize / seconds);
  }
  return best;
}

constexpr int kNumSums = 12;  // enough to hide the latency of each
constexpr int kWidth = 4;
typedef double Four __attribute__((vector_size(8 * kWidth), aligned(8)));

MGSFM_ALWAYS_INLINE double AddProductsBody(size_t num_steps) {
  Four sums[kNumSums];
  const Four factor = {0.999, 0.998, 0.997, 0.996};
  const Four term = {0.1, 0.2, 0.3, 0.4};
  for (int k = 0; k < kNumSums; ++k) sums[k] = term + static_cast<double>(k);
  for (size_t i = 0; i < num_steps; ++i) {
#pragma GCC unroll 12
    for (int k = 0; k < kNumSums; ++k) sums[k] = sums[k] * factor + term;
  }
  double total = 0.0;
  for (const Four& sum : sums) {
    for (int i = 0; i < kWidth; ++i) total += sum[i];
  }
  return total;
}

double AddProductsAny(size_t num_steps) { return AddProductsBody(num_steps); }
MGSFM_TARGET_AVX2 double AddProductsAvx2(size_t num_steps) {
  return AddProductsBody(num_steps);
}

double MeasureMultiplyAdds() {
  constexpr size_t kNumSteps = 2000000;
  const auto add = HasAvx2() ? AddProductsAvx2 : AddProductsAny;
  double best = 0.0, total = 0.0;
  for (int run = 0; run < kNumRuns; ++run) {
    const Timer timer;
    total += add(kNumSteps);
    best =
        std::max(best, 2.0 * kNumSums * kWidth * kNumSteps / timer.Seconds());
  }
  return total > 0.0 ? best : 0.0;
}

}  // namespace

const MachineLimits& MeasuredMachineLimits() {
  static const MachineLimits limits = {MeasureCopy(), MeasureMultiplyAdds()};
  return limits;
}

}  // namespace mgsfm
