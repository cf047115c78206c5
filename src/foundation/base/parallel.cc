// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {

int ResolveNumThreads(int num_threads) {
  if (num_threads > 0) return num_threads;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void ParallelFor(size_t size, int num_threads,
                 const std::function<void(size_t)>& function, size_t block_size,
                 const std::function<void(size_t)>& on_block_done) {
  MGSFM_CHECK_GT(block_size, 0u);
  std::atomic<size_t> next{0};
  std::atomic<size_t> num_done{0};
  std::exception_ptr first_exception;
  std::mutex exception_mutex;

  const auto work = [&](bool is_caller) {
    while (true) {
      const size_t begin = next.fetch_add(block_size);
      if (begin >= size) return;
      const size_t end = std::min(size, begin + block_size);
      try {
        for (size_t i = begin; i < end; ++i) function(i);
        num_done += end - begin;
        if (is_caller && on_block_done) on_block_done(num_done);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(exception_mutex);
        if (!first_exception) first_exception = std::current_exception();
        next = size;
        return;
      }
    }
  };

  const size_t num_blocks = (size + block_size - 1) / block_size;
  const size_t num_helpers = std::min<size_t>(
      num_blocks > 0 ? num_blocks - 1 : 0, std::max(1, num_threads) - 1);
  std::vector<std::thread> helpers;
  helpers.reserve(num_helpers);
  try {
    for (size_t i = 0; i < num_helpers; ++i) helpers.emplace_back(work, false);
  } catch (const std::exception&) {
    // No more threads or memory; continue with the threads that started.
  }
  work(true);
  for (std::thread& helper : helpers) helper.join();
  if (first_exception) std::rethrow_exception(first_exception);
}

void ParallelFor(size_t size, const Context& context, std::string_view stage,
                 const std::function<void(size_t)>& function,
                 size_t block_size) {
  ParallelFor(
      size, ResolveNumThreads(context.num_threads), function, block_size,
      [&](size_t num_done) { context.ReportProgress(stage, num_done, size); });
}

}  // namespace mgsfm
