// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// The range of an option, with limits where it has none: the largest value that
// has a meaning in its unit, and for numbers above zero the smallest. So no
// option makes a loop endless, allocates absurd memory, or overflows when it is
// squared or divided by.
Range RangeOf(const OptionEntry& entry);

}  // namespace mgsfm
