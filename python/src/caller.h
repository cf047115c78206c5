// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>

#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"

namespace mgsfm::python {

// A call from Python into the library: runs without the GIL, takes it for the
// callbacks of the caller, and stops for signals and for exceptions of these
// callbacks.
class Caller {
 public:
  // Callables or None: log(level: str, message: str) and
  // progress(stage: str, done: int, total: int).
  Caller(pybind11::object log, pybind11::object progress);

  // Returns function(context). Throws what the callbacks or the handler of a
  // signal raised, such as KeyboardInterrupt, instead of Interrupted.
  template <class Function>
  auto Run(const Function& function)
      -> std::invoke_result_t<Function, const Context&> {
    try {
      auto result = RunWithoutPython(function);
      if (!raised_) return result;
    } catch (const Interrupted&) {
      if (!raised_) throw;
    }
    throw pybind11::error_already_set(*std::move(raised_));
  }

  // The last message of level error, or "".
  const std::string& last_error() const { return last_error_; }

 private:
  template <class Function>
  auto RunWithoutPython(const Function& function) {
    const pybind11::gil_scoped_release release;
    return function(MakeContext());
  }
  Context MakeContext();
  void Log(LogLevel level, const std::string& message);
  void ShowProgress(const Progress& progress);
  bool IsCanceled();
  // Calls with the GIL and keeps the first exception.
  template <class Function>
  void WithPython(const Function& function);

  pybind11::object log_;
  pybind11::object progress_;
  std::string last_error_;
  std::optional<pybind11::error_already_set> raised_;
  std::atomic<bool> is_canceled_{false};
  std::thread::id thread_ = std::this_thread::get_id();
  std::chrono::steady_clock::time_point last_check_;
};

}  // namespace mgsfm::python
