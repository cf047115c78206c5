// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

#include "base/format.h"

namespace mgsfm {

// Tells whether two runs have the same input: a hash of the added items in
// order. FNV-1a with 64 bits: two inputs collide by accident with a probability
// of 2^-64. Not cryptographic.
class Fingerprint {
 public:
  Fingerprint& Add(const std::string& text) {
    AddBytes(text.data(), text.size());
    return Add(text.size());  // "a", "bc" differs from "ab", "c"
  }
  template <class T>
  Fingerprint& Add(T number) {
    static_assert(std::is_arithmetic_v<T>, "has no padding");
    AddBytes(reinterpret_cast<const char*>(&number), sizeof(number));
    return *this;
  }

  uint64_t hash() const { return hash_; }
  std::string ToString() const {
    return Formatted("%016llx", static_cast<unsigned long long>(hash_));
  }

 private:
  void AddBytes(const char* bytes, size_t size) {
    for (size_t i = 0; i < size; ++i) {
      hash_ = (hash_ ^ static_cast<unsigned char>(bytes[i])) * 0x100000001b3ull;
    }
  }

  uint64_t hash_ = 0xcbf29ce484222325ull;
};

}  // namespace mgsfm
