// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/allocations.h"

#include <dlfcn.h>
#include <pthread.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>
#include <unwind.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <new>
#include <sstream>
#include <unordered_map>
#include <utility>

namespace mgsfm {
namespace {

std::atomic<bool> is_counting{false};
std::atomic<long> failing_call{-1};
std::atomic<long> num_calls{0};
std::atomic<long> num_bytes{0};
std::atomic<long> num_live{0};
std::atomic<long> num_failed{0};
std::atomic<uint64_t> order_hash{0};

// The thread and the frame that started the count.
pthread_t starting_thread;
uintptr_t outermost_frame = 0;

// The stack whose first call fails.
std::atomic<bool> has_failing_stack{false};
uintptr_t failing_caller = 0;
uint64_t failing_hash = 0;
intptr_t failing_size = 0;
std::atomic<long> num_calls_of_stack{0};

struct StackRecorder {
  std::optional<long> call;  // nullopt: all
  std::mutex mutex;
  std::unordered_map<uint64_t, size_t> indices;  // by hash
  std::vector<CallStack> stacks;
};
std::atomic<bool> is_recording{false};
StackRecorder recorder;
// The recorder allocates, too.
thread_local bool is_in_recorder = false;

bool IsOnStartingThread() {
  return pthread_equal(pthread_self(), starting_thread) != 0;
}

// Hashes the return addresses between two positions of a stack.
struct StackWalk {
  uintptr_t begin = 0;
  uintptr_t end = 0;
  uint64_t hash = 0;
  std::vector<uintptr_t>* addresses = nullptr;  // null: not wanted
};

_Unwind_Reason_Code AddFrame(_Unwind_Context* context, void* data) {
  auto* walk = static_cast<StackWalk*>(data);
  const uintptr_t position = _Unwind_GetCFA(context);
  if (position >= walk->end) return _URC_END_OF_STACK;
  if (position <= walk->begin) return _URC_NO_REASON;  // of this file
  walk->hash = (walk->hash ^ _Unwind_GetIP(context)) * 0x9e3779b97f4a7c15ull;
  walk->hash ^= walk->hash >> 29;
  if (walk->addresses != nullptr) {
    walk->addresses->push_back(_Unwind_GetIP(context));
  }
  return _URC_NO_REASON;
}

// A call of operator new.
struct Call {
  const void* return_address = nullptr;
  const void* frame = nullptr;

  // A thread's descriptor is above its stack.
  intptr_t StackSize() const {
    const auto top = IsOnStartingThread()
                         ? outermost_frame
                         : static_cast<uintptr_t>(pthread_self());
    return static_cast<intptr_t>(top - reinterpret_cast<uintptr_t>(frame));
  }
};

uint64_t HashStack(const Call& call,
                   std::vector<uintptr_t>* addresses = nullptr) {
  StackWalk walk;
  walk.begin = reinterpret_cast<uintptr_t>(call.frame);
  walk.end = IsOnStartingThread() ? outermost_frame : UINTPTR_MAX;
  walk.addresses = addresses;
  _Unwind_Backtrace(AddFrame, &walk);
  return walk.hash;
}

void Record(const Call& call, long number) {
  if (recorder.call && *recorder.call != number) return;
  is_in_recorder = true;
  CallStack stack;
  stack.hash = HashStack(call, &stack.return_addresses);
  stack.size = call.StackSize();
  stack.first_call = number;
  {
    const std::lock_guard<std::mutex> lock(recorder.mutex);
    const auto [found, is_new] =
        recorder.indices.emplace(stack.hash, recorder.stacks.size());
    if (is_new) recorder.stacks.push_back(std::move(stack));
    ++recorder.stacks[found->second].num_calls;
    recorder.stacks[found->second].last_call = number;
  }
  is_in_recorder = false;
}

// Walks only stacks with the same caller and of the same size, as that takes
// microseconds.
bool HasFailingStack(const Call& call) {
  return reinterpret_cast<uintptr_t>(call.return_address) == failing_caller &&
         call.StackSize() == failing_size && HashStack(call) == failing_hash;
}

// The calls at which the process forks.
struct Forking {
  std::vector<long> failing_calls;
  size_t next = 0;
  std::vector<ForkedChild> children;
};
Forking forking;
std::atomic<bool> is_forking{false};
bool is_forked_child = false;

// True if the call fails in this process, a child that was forked for it.
bool FailsInThisProcess(long number) {
  if (forking.next == forking.failing_calls.size() ||
      forking.failing_calls[forking.next] != number) {
    return false;
  }
  const pid_t child = fork();
  if (child == 0) {
    is_forked_child = true;
    is_forking = false;
    alarm(60);
    return true;
  }
  ForkedChild& result = forking.children[forking.next++];
  result.failing_call = number;
  if (child < 0 || waitpid(child, &result.status, 0) != child) {
    std::perror("fork");
    std::abort();
  }
  return false;
}

bool Fails(const Call& call, long number) {
  if (is_forking) return FailsInThisProcess(number);
  if (!has_failing_stack) return number == failing_call;
  return HasFailingStack(call) && num_calls_of_stack++ == 0;
}

bool MayAllocate(size_t size, const Call& call) {
  if (!is_counting || is_in_recorder) return true;
  num_bytes += static_cast<long>(size);
  order_hash = (order_hash ^ size) * 0x9e3779b97f4a7c15ull;
  const long number = num_calls++;
  if (is_recording) Record(call, number);
  if (!Fails(call, number)) return true;
  ++num_failed;
  return false;
}

void* Allocate(size_t size, size_t alignment, const Call& call) {
  if (!MayAllocate(size, call)) return nullptr;
  const size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* const memory = alignment <= alignof(std::max_align_t)
                           ? std::malloc(size == 0 ? 1 : size)
                           : std::aligned_alloc(alignment, rounded);
  if (memory != nullptr) ++num_live;
  return memory;
}

void* AllocateOrThrow(size_t size, size_t alignment, const Call& call) {
  void* const memory = Allocate(size, alignment, call);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

void Release(void* memory) {
  if (memory == nullptr) return;
  --num_live;
  std::free(memory);
}

sqlite3_mem_methods& SqliteMethods() {
  static sqlite3_mem_methods methods;
  return methods;
}

// The caller of the function that uses it.
#define MGSFM_THIS_CALL \
  mgsfm::Call { __builtin_return_address(0), __builtin_frame_address(0) }

void* AllocateForSqlite(int size) {
  return MayAllocate(static_cast<size_t>(size), MGSFM_THIS_CALL)
             ? SqliteMethods().xMalloc(size)
             : nullptr;
}

void* ReallocateForSqlite(void* memory, int size) {
  return MayAllocate(static_cast<size_t>(size), MGSFM_THIS_CALL)
             ? SqliteMethods().xRealloc(memory, size)
             : nullptr;
}

void Start(long call, const void* frame) {
  starting_thread = pthread_self();
  outermost_frame = reinterpret_cast<uintptr_t>(frame);
  failing_call = call;
  num_calls = 0;
  num_bytes = 0;
  num_failed = 0;
  order_hash = 0;
  num_calls_of_stack = 0;
  is_counting = true;
}

}  // namespace

void StartAllocationCount(long call) {
  has_failing_stack = false;
  Start(call, __builtin_dwarf_cfa());
}

void StartAllocationCount(const CallStack& stack) {
  failing_caller = stack.return_addresses.front();
  failing_hash = stack.hash;
  failing_size = stack.size;
  has_failing_stack = true;
  Start(-1, __builtin_dwarf_cfa());
}

void PrepareForking(const std::vector<long>& failing_calls) {
  forking.failing_calls = failing_calls;
  forking.next = 0;
  forking.children.resize(failing_calls.size());
}

void StartForking() {
  has_failing_stack = false;
  is_forking = true;
  Start(-1, __builtin_dwarf_cfa());
}

bool IsForkedChild() { return is_forked_child; }

std::vector<ForkedChild> StopForking() {
  is_counting = false;
  is_forking = false;
  forking.failing_calls = {};
  forking.children.resize(forking.next);  // those whose calls were made
  return std::exchange(forking.children, {});
}

void StartStackRecording(std::optional<long> call) {
  recorder.call = call;
  has_failing_stack = false;
  is_recording = true;
  Start(-1, __builtin_dwarf_cfa());
}

AllocationCounts StopAllocationCount() {
  is_counting = false;
  return {num_calls, num_bytes, num_live, num_failed, order_hash};
}

std::string Describe(const CallStack& stack) {
  constexpr size_t kMaxNumAddresses = 16;
  std::ostringstream text;
  for (size_t i = 0;
       i < std::min(kMaxNumAddresses, stack.return_addresses.size()); ++i) {
    // The byte before belongs to the call.
    const uintptr_t address = stack.return_addresses[i] - 1;
    Dl_info info;
    if (dladdr(reinterpret_cast<const void*>(address), &info) == 0) continue;
    text << (i > 0 ? " " : "") << info.dli_fname << " 0x" << std::hex
         << address - reinterpret_cast<uintptr_t>(info.dli_fbase) << std::dec;
  }
  return text.str();
}

std::vector<CallStack> StopStackRecording() {
  is_counting = false;
  is_recording = false;
  recorder.indices.clear();
  return std::exchange(recorder.stacks, {});
}

void HookSqliteAllocations() {
  sqlite3_config(SQLITE_CONFIG_GETMALLOC, &SqliteMethods());
  sqlite3_mem_methods hooked = SqliteMethods();
  hooked.xMalloc = AllocateForSqlite;
  hooked.xRealloc = ReallocateForSqlite;
  sqlite3_config(SQLITE_CONFIG_MALLOC, &hooked);
  // Otherwise SQLite takes small blocks from pools of its own.
  sqlite3_config(SQLITE_CONFIG_LOOKASIDE, 0, 0);
}

}  // namespace mgsfm

namespace m = mgsfm;
constexpr size_t kUsual = alignof(std::max_align_t);

void* operator new(size_t size) {
  return m::AllocateOrThrow(size, kUsual, MGSFM_THIS_CALL);
}
void* operator new[](size_t size) {
  return m::AllocateOrThrow(size, kUsual, MGSFM_THIS_CALL);
}
void* operator new(size_t size, const std::nothrow_t&) noexcept {
  return m::Allocate(size, kUsual, MGSFM_THIS_CALL);
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
  return m::Allocate(size, kUsual, MGSFM_THIS_CALL);
}
void* operator new(size_t size, std::align_val_t alignment) {
  return m::AllocateOrThrow(size, static_cast<size_t>(alignment),
                            MGSFM_THIS_CALL);
}
void* operator new[](size_t size, std::align_val_t alignment) {
  return m::AllocateOrThrow(size, static_cast<size_t>(alignment),
                            MGSFM_THIS_CALL);
}
void operator delete(void* memory) noexcept { m::Release(memory); }
void operator delete[](void* memory) noexcept { m::Release(memory); }
void operator delete(void* memory, size_t) noexcept { m::Release(memory); }
void operator delete[](void* memory, size_t) noexcept { m::Release(memory); }
void operator delete(void* memory, std::align_val_t) noexcept {
  m::Release(memory);
}
void operator delete[](void* memory, std::align_val_t) noexcept {
  m::Release(memory);
}
void operator delete(void* memory, size_t, std::align_val_t) noexcept {
  m::Release(memory);
}
void operator delete[](void* memory, size_t, std::align_val_t) noexcept {
  m::Release(memory);
}
