// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <ratio>

namespace mgsfm {

constexpr int64_t kNsPerSecond = std::nano::den;

}  // namespace mgsfm
