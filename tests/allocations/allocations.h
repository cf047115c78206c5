// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// A program that links allocations.cc allocates through it: operator new, and
// SQLite's allocator after HookSqliteAllocations.
struct AllocationCounts {
  long num_calls = 0;
  long num_bytes = 0;
  long num_live = 0;        // of operator new, allocated and not released
  long num_failed = 0;      // that were made to fail
  uint64_t order_hash = 0;  // of the sizes, in the order of the calls
};

// From now on, counts calls; the call number `failing_call`, from 0, fails.
void StartAllocationCount(long failing_call = -1);
AllocationCounts StopAllocationCount();

// Where allocations are called from: up to the function that starts the count,
// or to the start of a thread. Valid in one process.
struct CallStack {
  std::vector<uintptr_t> return_addresses;  // from the innermost on
  uint64_t hash = 0;                        // of these
  intptr_t size = 0;    // bytes of the stack of the thread in use
  long num_calls = 0;   // of operator new or SQLite's allocator
  long first_call = 0;  // their numbers, from 0
  long last_call = 0;
};

// The innermost return addresses, as arguments of addr2line -Cfe.
std::string Describe(const CallStack& stack);

// From now on, counts calls and records their stacks, or that of one call.
void StartStackRecording(std::optional<long> call = std::nullopt);
// The different stacks, in the order of their first allocations.
std::vector<CallStack> StopStackRecording();

// From now on, counts calls; the first one with this stack fails.
void StartAllocationCount(const CallStack& stack);

// From now on, counts calls of one thread. At each of these calls, by ascending
// numbers, the process forks: the call fails in the child, and the parent goes
// on once the child ended. A child that runs for a minute is killed.
void PrepareForking(const std::vector<long>& failing_calls);
void StartForking();
bool IsForkedChild();
struct ForkedChild {
  long failing_call = 0;
  int status = 0;  // of waitpid
};
std::vector<ForkedChild> StopForking();

// To be called before the first use of SQLite.
void HookSqliteAllocations();

}  // namespace mgsfm
