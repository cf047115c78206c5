// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

#include "mgsfm/base/parallel.h"

namespace mgsfm {

// Calls function(i) for i in [0, size), in parallel, and sums what it returns.
// Sums are formed over chunks of fixed size and then in order, so the result
// is the same to the last bit for every number of threads.
template <class Function>
double ParallelSum(size_t size, int num_threads, const Function& function) {
  constexpr size_t kChunkSize = 256;
  std::vector<double> sums((size + kChunkSize - 1) / kChunkSize, 0.0);
  ParallelFor(
      sums.size(), num_threads,
      [&](size_t chunk) {
        const size_t end = std::min(size, (chunk + 1) * kChunkSize);
        double sum = 0.0;
        for (size_t i = chunk * kChunkSize; i < end; ++i) sum += function(i);
        sums[chunk] = sum;
      },
      1);
  double total = 0.0;
  for (const double sum : sums) total += sum;
  return total;
}

}  // namespace mgsfm
