// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

TEST(ResolveNumThreads, KeepsPositiveAndFindsAtLeastOne) {
  EXPECT_EQ(ResolveNumThreads(3), 3);
  EXPECT_GE(ResolveNumThreads(-1), 1);
}

TEST(ParallelFor, CallsEveryItemOnce) {
  for (const int num_threads : {-1, 0, 1, 2, 5}) {
    for (const size_t size : {0u, 1u, 15u, 16u, 17u, 1000u}) {
      for (const size_t block_size : {1u, 7u, 2000u}) {
        std::vector<int> counts(size, 0);
        ParallelFor(
            size, num_threads, [&](size_t i) { ++counts[i]; }, block_size);
        EXPECT_EQ(counts, std::vector<int>(size, 1));
      }
    }
  }
}

TEST(ParallelFor, UsesNoMoreThreadsThanAsked) {
  std::atomic<int> num_running{0};
  std::atomic<int> max_num_running{0};
  ParallelFor(
      64, 3,
      [&](size_t) {
        const int running = ++num_running;
        int seen = max_num_running;
        while (running > seen &&
               !max_num_running.compare_exchange_weak(seen, running)) {
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        --num_running;
      },
      1);
  EXPECT_LE(max_num_running, 3);
}

TEST(ParallelFor, RethrowsAfterAllThreadsEnded) {
  for (const int num_threads : {1, 4}) {
    std::atomic<int> num_running{0};
    try {
      ParallelFor(
          1000, num_threads,
          [&](size_t i) {
            ++num_running;
            if (i == 500) {
              --num_running;
              throw Error("item 500");
            }
            --num_running;
          },
          1);
      FAIL() << "no exception";
    } catch (const Error& error) {
      EXPECT_STREQ(error.what(), "item 500");
      EXPECT_EQ(num_running, 0);
    }
  }
}

TEST(ParallelFor, ReportsProgressFromTheCallersThread) {
  const std::thread::id caller = std::this_thread::get_id();
  size_t last = 0;
  ParallelFor(
      100, 2, [](size_t) {}, 10,
      [&](size_t num_done) {
        EXPECT_EQ(std::this_thread::get_id(), caller);
        EXPECT_GE(num_done, last);
        EXPECT_LE(num_done, 100u);
        last = num_done;
      });
}

// Sanitizers need terabytes of addresses.
#ifndef __SANITIZE_ADDRESS__
// In a process that may not have the stack of another thread.
TEST(ParallelFor, NeedsNoMoreThreadsThanTheSystemAllows) {
  const pid_t pid = fork();
  if (pid == 0) {
    const rlimit none{1 << 20, 1 << 20};
    setrlimit(RLIMIT_AS, &none);
    std::atomic<int> num_calls{0};
    ParallelFor(
        100, 4, [&](size_t) { ++num_calls; }, 1);
    _exit(num_calls == 100 ? 0 : 1);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}
#endif

}  // namespace
}  // namespace mgsfm
