// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// A program that links allocations.cc allocates through it: operator new, and
// SQLite's allocator after HookSqliteAllocations.
struct AllocationCounts {
  long num_calls = 0;
  long num_bytes = 0;
  long num_live = 0;  // of operator new, allocated and not released
};

// From now on, counts calls; the call number `failing_call`, from 0, fails.
void StartAllocationCount(long failing_call = -1);
AllocationCounts StopAllocationCount();

// To be called before the first use of SQLite.
void HookSqliteAllocations();

}  // namespace mgsfm
