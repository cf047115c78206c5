// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace mgsfm {

// From now on, large blocks of memory return to the system as soon as they are
// freed. By default, the C library of Linux may keep blocks of up to 32 MiB,
// which leaves holes between small ones. Does nothing on other systems.
void ReturnLargeBlocks();

// Throws std::bad_alloc unless the process can allocate this many more bytes.
// Some libraries end the process if memory runs out during their setup.
void RequireMemory(size_t num_bytes);

}  // namespace mgsfm
