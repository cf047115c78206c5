// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {

// One boolean per item of an array, e.g. which pairs are used or which
// observations are inliers. Item i describes item i of that array.
//
// Unlike in std::vector<bool>, items are distinct memory locations: parallel
// loops may write different items concurrently.
class Mask {
  struct Flag {
    bool value = false;
    operator bool() const { return value; }  // NOLINT: a Flag is a bool
    friend bool operator==(Flag a, Flag b) { return a.value == b.value; }
  };

 public:
  using const_iterator = std::vector<Flag>::const_iterator;  // NOLINT

  Mask() = default;
  explicit Mask(size_t size, bool value = false) : flags_(size, Flag{value}) {}
  Mask(const_iterator begin, const_iterator end) : flags_(begin, end) {}
  Mask(std::initializer_list<bool> values) {
    flags_.reserve(values.size());
    for (const bool value : values) flags_.push_back({value});
  }

  bool& operator[](size_t idx) { return flags_[idx].value; }
  bool operator[](size_t idx) const { return flags_[idx].value; }
  size_t size() const { return flags_.size(); }
  bool empty() const { return flags_.empty(); }
  const_iterator begin() const { return flags_.begin(); }
  const_iterator end() const { return flags_.end(); }

  void assign(size_t size, bool value) { flags_.assign(size, Flag{value}); }
  void resize(size_t size, bool value = false) {
    flags_.resize(size, Flag{value});
  }
  void reserve(size_t size) { flags_.reserve(size); }
  void push_back(bool value) { flags_.push_back({value}); }
  bool& back() { return flags_.back().value; }
  bool back() const { return flags_.back().value; }
  void clear() { flags_.clear(); }

  // Assigns `value` to the items in [begin, end).
  void Fill(size_t begin, size_t end, bool value) {
    for (size_t i = begin; i < end; ++i) flags_[i].value = value;
  }

  // Number of items that are set.
  size_t Count() const {
    return static_cast<size_t>(
        std::count_if(begin(), end(), [](Flag flag) { return flag.value; }));
  }
  bool Any() const {
    return std::any_of(begin(), end(), [](Flag flag) { return flag.value; });
  }

  // Clears every item that is set in `other`, which must have the same size.
  void Remove(const Mask& other) {
    MGSFM_CHECK_EQ(size(), other.size());
    for (size_t i = 0; i < size(); ++i) {
      if (other[i]) flags_[i].value = false;
    }
  }

  friend bool operator==(const Mask& a, const Mask& b) {
    return a.flags_ == b.flags_;
  }
  friend bool operator!=(const Mask& a, const Mask& b) { return !(a == b); }

 private:
  std::vector<Flag> flags_;
};

}  // namespace mgsfm
