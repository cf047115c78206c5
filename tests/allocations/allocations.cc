// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/allocations.h"

#include <sqlite3.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace mgsfm {
namespace {

std::atomic<bool> is_counting{false};
std::atomic<long> failing_call{-1};
std::atomic<long> num_calls{0};
std::atomic<long> num_bytes{0};
std::atomic<long> num_live{0};

bool MayAllocate(size_t size) {
  if (!is_counting) return true;
  num_bytes += static_cast<long>(size);
  return num_calls++ != failing_call;
}

void* Allocate(size_t size, size_t alignment) {
  if (!MayAllocate(size)) return nullptr;
  const size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* const memory = alignment <= alignof(std::max_align_t)
                           ? std::malloc(size == 0 ? 1 : size)
                           : std::aligned_alloc(alignment, rounded);
  if (memory != nullptr) ++num_live;
  return memory;
}

void* AllocateOrThrow(size_t size, size_t alignment) {
  void* const memory = Allocate(size, alignment);
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

void* AllocateForSqlite(int size) {
  return MayAllocate(static_cast<size_t>(size)) ? SqliteMethods().xMalloc(size)
                                                : nullptr;
}

void* ReallocateForSqlite(void* memory, int size) {
  return MayAllocate(static_cast<size_t>(size))
             ? SqliteMethods().xRealloc(memory, size)
             : nullptr;
}

}  // namespace

void StartAllocationCount(long call) {
  failing_call = call;
  num_calls = 0;
  num_bytes = 0;
  is_counting = true;
}

AllocationCounts StopAllocationCount() {
  is_counting = false;
  return {num_calls, num_bytes, num_live};
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

void* operator new(size_t size) { return m::AllocateOrThrow(size, kUsual); }
void* operator new[](size_t size) { return m::AllocateOrThrow(size, kUsual); }
void* operator new(size_t size, const std::nothrow_t&) noexcept {
  return m::Allocate(size, kUsual);
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
  return m::Allocate(size, kUsual);
}
void* operator new(size_t size, std::align_val_t alignment) {
  return m::AllocateOrThrow(size, static_cast<size_t>(alignment));
}
void* operator new[](size_t size, std::align_val_t alignment) {
  return m::AllocateOrThrow(size, static_cast<size_t>(alignment));
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
