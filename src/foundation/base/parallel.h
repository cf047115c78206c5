// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <string_view>

#include "mgsfm/base/context.h"

namespace mgsfm {

// The number of threads for a request: positive values are kept, all others
// select the number of hardware threads.
int ResolveNumThreads(int num_threads);

// The number of parts of a sum or merge that threads share, whatever their
// number; it suffices for some tens of threads.
inline constexpr size_t kNumParts = 16;
// Additions or copies per task; fewer do not justify a thread.
inline constexpr size_t kItemsPerTask = 32768;

// Calls function(i) once for every i in [0, size) on num_threads threads.
// Blocks of `block_size` items are scheduled dynamically, so `function` must
// write only memory that belongs to its item; results then do not depend on the
// number of threads. The first exception is rethrown after all threads have
// ended. The calling thread calls on_block_done(num_done), if set, between its
// own blocks with the number of items finished so far.
void ParallelFor(size_t size, int num_threads,
                 const std::function<void(size_t)>& function,
                 size_t block_size = 16,
                 const std::function<void(size_t)>& on_block_done = nullptr);

// The same on the threads of the context, which gets the progress of the stage.
void ParallelFor(size_t size, const Context& context, std::string_view stage,
                 const std::function<void(size_t)>& function,
                 size_t block_size = 1);

}  // namespace mgsfm
