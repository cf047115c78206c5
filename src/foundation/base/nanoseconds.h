// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace mgsfm {

constexpr int64_t kNsPerSecond = 1'000'000'000;

}  // namespace mgsfm
