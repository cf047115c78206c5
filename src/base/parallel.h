// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>

namespace mgsfm {

// Number of threads to use for a request: a positive one is kept, -1 means all
// hardware threads.
int ResolveNumThreads(int num_threads);

// Calls function(i) once for every i in [0, size), on num_threads threads.
// Items are handed out in blocks of `block_size`, so which thread runs an item
// is not fixed: function must only write to memory that belongs to its item.
// Under that condition results do not depend on the number of threads. The
// first exception thrown by an item is rethrown here after all threads ended.
// `on_block_done(num_done)`, when given, is called from the calling thread
// between its own blocks, with the number of items finished so far.
void ParallelFor(size_t size, int num_threads,
                 const std::function<void(size_t)>& function,
                 size_t block_size = 16,
                 const std::function<void(size_t)>& on_block_done = nullptr);

}  // namespace mgsfm
