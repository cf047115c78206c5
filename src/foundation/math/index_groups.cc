// SPDX-License-Identifier: BSD-3-Clause
#include "math/index_groups.h"

namespace mgsfm {

IndexGroups GroupByKey(const std::vector<int>& keys, size_t num_keys) {
  IndexGroups groups;
  groups.begin.assign(num_keys + 1, 0);
  for (const int key : keys) {
    if (key >= 0) ++groups.begin[key + 1];
  }
  for (size_t k = 0; k < num_keys; ++k) {
    groups.begin[k + 1] += groups.begin[k];
  }
  groups.items.resize(groups.begin.back());
  std::vector<size_t> next(groups.begin.begin(), groups.begin.end() - 1);
  for (size_t i = 0; i < keys.size(); ++i) {
    if (keys[i] >= 0) groups.items[next[keys[i]]++] = static_cast<int>(i);
  }
  return groups;
}

}  // namespace mgsfm
