// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
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

template <class Item>
void SortById(std::vector<Item>* items) {
  std::sort(items->begin(), items->end(),
            [](const Item& a, const Item& b) { return a.id < b.id; });
}

template <class Item>
void SortByName(std::vector<Item>* items) {
  std::sort(items->begin(), items->end(),
            [](const Item& a, const Item& b) { return a.name < b.name; });
}

}  // namespace mgsfm
