// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// Peak throughput of one thread: memory bandwidth of a copy loop, and
// arithmetic of independent multiply-adds in registers.
struct MachineLimits {
  double copied_bytes_per_second = 0.0;  // read and written
  double flops_per_second = 0.0;         // a multiply-add is two
};

// The best of several runs, measured by the first call.
const MachineLimits& MeasuredMachineLimits();

}  // namespace mgsfm
