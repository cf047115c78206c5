// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// Groups of positions in one array: group g holds items[begin[g]] to
// items[begin[g + 1] - 1], ascending.
struct IndexGroups {
  std::vector<size_t> begin = {0};
  std::vector<int> items;
};

// Groups the positions of `keys` by key; negative keys are left out. Linear.
IndexGroups GroupByKey(const std::vector<int>& keys, size_t num_keys);

}  // namespace mgsfm
