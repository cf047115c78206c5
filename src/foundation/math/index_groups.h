// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// Groups of array indices: the ascending indices of group g are items[begin[g]]
// to items[begin[g + 1] - 1].
struct IndexGroups {
  std::vector<size_t> begin = {0};
  std::vector<int> items;
};

// Groups the indices of `keys` by key. Items with negative keys are excluded.
// O(keys + num_keys).
IndexGroups GroupByKey(const std::vector<int>& keys, size_t num_keys);

}  // namespace mgsfm
