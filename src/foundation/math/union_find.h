// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

namespace mgsfm {

// Disjoint-set forest over 0 .. size - 1 with union by size and path halving.
// Operations take amortized near-constant time.
class UnionFind {
 public:
  explicit UnionFind(size_t size) : parent_(size), size_(size, 1) {
    std::iota(parent_.begin(), parent_.end(), size_t{0});
  }

  size_t size() const { return parent_.size(); }

  // The representative of the set that contains x.
  size_t Find(size_t x) {
    while (parent_[x] != x) {
      parent_[x] = parent_[parent_[x]];
      x = parent_[x];
    }
    return x;
  }

  // Merges two sets. Returns false if they are the same set.
  bool Union(size_t x, size_t y) {
    x = Find(x);
    y = Find(y);
    if (x == y) return false;
    if (size_[x] < size_[y]) std::swap(x, y);
    parent_[y] = x;
    size_[x] += size_[y];
    return true;
  }

  size_t SetSize(size_t x) { return size_[Find(x)]; }

 private:
  std::vector<size_t> parent_;
  std::vector<size_t> size_;
};

}  // namespace mgsfm
