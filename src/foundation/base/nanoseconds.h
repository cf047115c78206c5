// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <ratio>

namespace mgsfm {

constexpr int64_t kNsPerSecond = std::nano::den;

constexpr double Seconds(int64_t time_ns) {
  return static_cast<double>(time_ns) / kNsPerSecond;
}

}  // namespace mgsfm
