// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// What one thread of this machine can do at best, from a loop that copies
// memory and one of independent multiply-adds in registers.
struct MachineLimits {
  double copied_bytes_per_second = 0.0;  // read and written
  double flops_per_second = 0.0;         // a multiply-add is two
};

// The best of several runs, measured at the first call.
const MachineLimits& MeasuredMachineLimits();

}  // namespace mgsfm
