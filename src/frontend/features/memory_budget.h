// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <mutex>

namespace mgsfm {

// Bounds the memory that several threads use together. A single thread may
// exceed the bound.
class MemoryBudget {
 public:
  explicit MemoryBudget(size_t num_bytes) : limit_(num_bytes) {}

  // Waits for its share of the budget and holds it until the end of its scope.
  class Share {
   public:
    Share(MemoryBudget* budget, size_t num_bytes)
        : budget_(budget), num_bytes_(num_bytes) {
      std::unique_lock<std::mutex> lock(budget_->mutex_);
      budget_->released_.wait(lock, [this] {
        return budget_->used_ == 0 ||
               budget_->used_ + num_bytes_ <= budget_->limit_;
      });
      budget_->used_ += num_bytes_;
    }
    ~Share() {
      {
        const std::lock_guard<std::mutex> lock(budget_->mutex_);
        budget_->used_ -= num_bytes_;
      }
      budget_->released_.notify_all();
    }
    Share(const Share&) = delete;
    Share& operator=(const Share&) = delete;

   private:
    MemoryBudget* budget_;
    size_t num_bytes_;
  };

 private:
  const size_t limit_;
  size_t used_ = 0;
  std::mutex mutex_;
  std::condition_variable released_;
};

}  // namespace mgsfm
