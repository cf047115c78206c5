// SPDX-License-Identifier: BSD-3-Clause
#include "base/memory.h"

#include <sys/mman.h>

#include <cstdlib>  // defines __GLIBC__
#include <new>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace mgsfm {

void ReturnLargeBlocks() {
#ifdef __GLIBC__
  // The initial values; setting them explicitly makes them constant.
  constexpr int kBytes = 128 * 1024;
  mallopt(M_MMAP_THRESHOLD, kBytes);
  mallopt(M_TRIM_THRESHOLD, kBytes);
#endif
}

void RequireMemory(size_t num_bytes) {
  void* memory = mmap(nullptr, num_bytes, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  munmap(memory, num_bytes);
}

}  // namespace mgsfm
