// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"

namespace mgsfm {

// A context whose stages use that many threads.
inline Context Threads(int num_threads) {
  Context context;
  context.num_threads = num_threads;
  return context;
}

}  // namespace mgsfm
