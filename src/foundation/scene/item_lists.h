// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace mgsfm {

// Lists of items with a member `id` or `name`, such as images and cameras.

template <class Item>
auto IndexById(const std::vector<Item>& items) {
  std::map<decltype(Item::id), int> idx_of_id;
  for (size_t i = 0; i < items.size(); ++i) {
    idx_of_id.emplace(items[i].id, static_cast<int>(i));
  }
  return idx_of_id;
}

template <class Item>
std::map<std::string, int> IndexByName(const std::vector<Item>& items) {
  std::map<std::string, int> idx_of_name;
  for (size_t i = 0; i < items.size(); ++i) {
    idx_of_name.emplace(items[i].name, static_cast<int>(i));
  }
  return idx_of_name;
}

}  // namespace mgsfm
