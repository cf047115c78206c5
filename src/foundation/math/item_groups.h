// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

namespace mgsfm {

// Items in groups, in flat arrays. Offset is an unsigned or signed integer that
// holds their number.
template <class Item, class Offset = size_t>
struct ItemGroups {
  std::vector<Offset> offsets = {0};  // of each group, and the end
  std::vector<Item> items;

  const Item* begin(size_t group) const {
    return items.data() + offsets[group];
  }
  const Item* end(size_t group) const {
    return items.data() + offsets[group + 1];
  }
  Offset Size(size_t group) const {
    return offsets[group + 1] - offsets[group];
  }
};

// visit_all(add) calls add(group, item) for all items. It is called twice and
// must add the same items; those of a group keep their order. O(items +
// groups).
template <class Item, class Offset = size_t, class VisitAll>
ItemGroups<Item, Offset> GroupItems(size_t num_groups,
                                    const VisitAll& visit_all) {
  ItemGroups<Item, Offset> groups;
  std::vector<Offset>& offsets = groups.offsets;
  offsets.assign(num_groups + 1, 0);
  visit_all([&](size_t group, const Item&) { ++offsets[group + 1]; });
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  groups.items.resize(offsets.back());
  std::vector<Offset> next(offsets.begin(), offsets.end() - 1);
  visit_all([&](size_t group, const Item& item) {
    groups.items[next[group]++] = item;
  });
  return groups;
}

}  // namespace mgsfm
