// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

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

// Computes produce(0), produce(1), ... in several threads; one thread takes the
// results in this order. At most `max_in_flight` results are started and not
// yet taken.
template <class Result>
class OrderedPipeline {
 public:
  OrderedPipeline(size_t size, int num_threads, size_t max_in_flight,
                  std::function<Result(size_t)> produce)
      : size_(size), max_in_flight_(max_in_flight), produce_(produce) {
    const auto num_workers = std::min<size_t>(size, std::max(1, num_threads));
    workers_.reserve(num_workers);
    try {
      for (size_t i = 0; i < num_workers; ++i) {
        workers_.emplace_back([this] { Work(); });
      }
    } catch (const std::exception&) {
      // No more threads or memory; continue with the threads that started.
      if (workers_.empty()) throw;
    }
  }

  // Starts no more computations and waits for those in progress.
  ~OrderedPipeline() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      next_ = size_;
    }
    changed_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }
  OrderedPipeline(const OrderedPipeline&) = delete;
  OrderedPipeline& operator=(const OrderedPipeline&) = delete;

  // Takes all results that are ready and next in order. Waits briefly for the
  // first one, so there may be none. Rethrows exceptions of produce().
  std::vector<Result> Take() {
    // Callers check for interruptions between two calls.
    constexpr std::chrono::milliseconds kMaxWait(100);
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait_for(lock, kMaxWait, [this] {
      return !slots_.empty() && slots_.front().IsDone();
    });
    std::vector<Result> results;
    while (!slots_.empty() && slots_.front().IsDone()) {
      if (slots_.front().exception) {
        std::rethrow_exception(slots_.front().exception);
      }
      results.push_back(*std::move(slots_.front().result));
      slots_.pop_front();
      ++num_taken_;
    }
    lock.unlock();
    changed_.notify_all();
    return results;
  }

 private:
  struct Slot {
    std::optional<Result> result;
    std::exception_ptr exception;
    bool IsDone() const { return result.has_value() || exception; }
  };

  void Work() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] {
        return next_ >= size_ || next_ < num_taken_ + max_in_flight_;
      });
      if (next_ >= size_) return;
      const size_t i = next_++;
      slots_.emplace_back();
      lock.unlock();
      Slot slot = Produce(i);
      lock.lock();
      slots_[i - num_taken_] = std::move(slot);
      changed_.notify_all();
    }
  }

  Slot Produce(size_t i) const {
    Slot slot;
    try {
      slot.result = produce_(i);
    } catch (...) {
      slot.exception = std::current_exception();
    }
    return slot;
  }

  const size_t size_;
  const size_t max_in_flight_;
  const std::function<Result(size_t)> produce_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Slot> slots_;  // the first one is the next to take
  size_t next_ = 0;
  size_t num_taken_ = 0;
  std::vector<std::thread> workers_;
};

}  // namespace mgsfm
