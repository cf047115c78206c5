// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace mgsfm {

// Numbers the used elements of an array densely, in the order of first use.
class DenseNumbering {
 public:
  explicit DenseNumbering(size_t size) : number_(size) {}

  // The number of element `idx`. `idxs` lists the numbered elements; a new one
  // is appended.
  int NumberOf(int idx, std::vector<int>* idxs) {
    if (!number_[idx]) {
      number_[idx] = static_cast<int>(idxs->size());
      idxs->push_back(idx);
    }
    return *number_[idx];
  }

 private:
  std::vector<std::optional<int>> number_;
};

}  // namespace mgsfm
