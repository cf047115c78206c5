// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <iterator>
#include <numeric>
#include <type_traits>
#include <vector>

namespace mgsfm {

// Algorithms of the standard library on all of a container. Keys and predicates
// are callables or pointers to members.

template <class Items, class Predicate>
bool AnyOf(const Items& items, const Predicate& predicate) {
  return std::any_of(items.begin(), items.end(), std::ref(predicate));
}

template <class Items, class Predicate>
bool AllOf(const Items& items, const Predicate& predicate) {
  return std::all_of(items.begin(), items.end(), std::ref(predicate));
}

template <class Items, class Predicate>
bool NoneOf(const Items& items, const Predicate& predicate) {
  return std::none_of(items.begin(), items.end(), std::ref(predicate));
}

template <class Items, class Predicate>
std::ptrdiff_t CountIf(const Items& items, const Predicate& predicate) {
  return std::count_if(items.begin(), items.end(), std::ref(predicate));
}

template <class Items, class Value>
bool Contains(const Items& items, const Value& value) {
  return std::find(items.begin(), items.end(), value) != items.end();
}

// Sorts by increasing keys.
template <class Items, class Key>
void SortBy(Items* items, const Key& key) {
  std::sort(items->begin(), items->end(), [&](const auto& a, const auto& b) {
    return std::invoke(key, a) < std::invoke(key, b);
  });
}

// The same; items with equal keys keep their order.
template <class Items, class Key>
void StableSortBy(Items* items, const Key& key) {
  std::stable_sort(items->begin(), items->end(),
                   [&](const auto& a, const auto& b) {
                     return std::invoke(key, a) < std::invoke(key, b);
                   });
}

// The same by decreasing keys.
template <class Items, class Key>
void StableSortDescendingBy(Items* items, const Key& key) {
  std::stable_sort(items->begin(), items->end(),
                   [&](const auto& a, const auto& b) {
                     return std::invoke(key, a) > std::invoke(key, b);
                   });
}

// Sorts items and removes repeated ones.
template <class Items>
void SortUnique(Items* items) {
  std::sort(items->begin(), items->end());
  items->erase(std::unique(items->begin(), items->end()), items->end());
}

// Removes items with a property; the others keep their order.
template <class Items, class Predicate>
void EraseIf(Items* items, const Predicate& predicate) {
  items->erase(
      std::remove_if(items->begin(), items->end(), std::ref(predicate)),
      items->end());
}

// The results of a function, or one member, for each item.
template <class Items, class Function>
auto Transformed(const Items& items, const Function& function) {
  std::vector<std::decay_t<decltype(std::invoke(function, *std::begin(items)))>>
      results;
  results.reserve(std::size(items));
  for (const auto& item : items) {
    results.push_back(std::invoke(function, item));
  }
  return results;
}

// The items of all lists in one.
template <class Lists>
auto Concatenated(const Lists& lists) {
  std::decay_t<decltype(*std::begin(lists))> all;
  for (const auto& list : lists) {
    all.insert(all.end(), std::begin(list), std::end(list));
  }
  return all;
}

// The items, or `max_size` of them at equal spacing if there are more.
template <class Items>
Items EvenlySpaced(const Items& items, size_t max_size) {
  if (items.size() <= max_size) return items;
  Items selected;
  for (size_t i = 0; i < max_size; ++i) {
    selected.push_back(items[i * items.size() / max_size]);
  }
  return selected;
}

// The larger median of an even number of values, which must not be empty.
template <class T>
T UpperMedian(std::vector<T> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// 0, 1, ... size - 1.
template <class T = int>
std::vector<T> Indices(size_t size) {
  std::vector<T> indices(size);
  std::iota(indices.begin(), indices.end(), T{0});
  return indices;
}

}  // namespace mgsfm
