// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

#include "base/random.h"

namespace mgsfm {

// The numbers 0 to size - 1.
inline std::vector<int> InOrder(int size) {
  std::vector<int> order(size);
  std::iota(order.begin(), order.end(), 0);
  return order;
}

// The same numbers in another order, always the same one.
inline std::vector<int> Shuffled(int size) {
  std::vector<int> order = InOrder(size);
  Random random(1);
  for (size_t i = order.size(); i > 1; --i) {
    std::swap(order[i - 1], order[random.Index(static_cast<uint32_t>(i))]);
  }
  return order;
}

}  // namespace mgsfm
