// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// The range of an option, with default limits where the option has none: the
// largest meaningful value in its unit, and the smallest for positive numbers.
// These limits prevent endless loops, absurd allocations, and overflow in
// squares and quotients.
Range RangeOf(const OptionEntry& entry);

}  // namespace mgsfm
