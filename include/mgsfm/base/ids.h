// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <ostream>

namespace mgsfm {

// An identifier used in files and by users: not contiguous, without meaningful
// order and never an array index. Each kind is a distinct type, so that a
// camera id cannot be passed as an image id. Dense zero-based indices into the
// arrays of a Scene are plain ints named `*_idx`.
template <class Tag>
class Id {
 public:
  constexpr explicit Id(uint32_t value) : value_(value) {}
  constexpr uint32_t value() const { return value_; }

  friend constexpr bool operator==(Id a, Id b) { return a.value_ == b.value_; }
  friend constexpr bool operator!=(Id a, Id b) { return a.value_ != b.value_; }
  friend constexpr bool operator<(Id a, Id b) { return a.value_ < b.value_; }
  friend std::ostream& operator<<(std::ostream& os, Id id) {
    return os << id.value_;
  }

 private:
  uint32_t value_;
};

using CameraId = Id<struct CameraTag>;
using ImageId = Id<struct ImageTag>;
using FrameId = Id<struct FrameTag>;
using RigId = Id<struct RigTag>;

}  // namespace mgsfm

template <class Tag>
struct std::hash<mgsfm::Id<Tag>> {
  std::size_t operator()(mgsfm::Id<Tag> id) const noexcept {
    return std::hash<uint32_t>()(id.value());
  }
};
