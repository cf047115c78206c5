// SPDX-License-Identifier: BSD-3-Clause
#include "caller.h"

#include "command.h"
#include "mgsfm/base/options.h"

namespace mgsfm::python {

namespace py = pybind11;

// Signals and progress need no more; each costs a switch of threads if other
// threads run Python code.
constexpr std::chrono::milliseconds kCheckInterval(20);

Caller::Caller(py::object log, py::object progress)
    : log_(std::move(log)), progress_(std::move(progress)) {}

Context Caller::MakeContext() {
  Context context;
  context.log = [this](LogLevel level, const std::string& message) {
    Log(level, message);
  };
  if (!progress_.is_none()) {
    context.progress = [this](const Progress& progress) {
      ShowProgress(progress);
    };
  }
  context.is_canceled = [this] { return IsCanceled(); };
  return context;
}

template <class Function>
void Caller::WithPython(const Function& function) {
  const py::gil_scoped_acquire acquire;
  try {
    function();
  } catch (py::error_already_set& error) {
    if (!raised_) raised_.emplace(std::move(error));
    is_canceled_ = true;
  }
}

void Caller::Log(LogLevel level, const std::string& message) {
  if (level == LogLevel::kError) last_error_ = message;
  if (log_.is_none() || is_canceled_) return;
  WithPython([&] { log_(EnumName(level), message); });
}

void Caller::ShowProgress(const Progress& progress) {
  if (is_canceled_) return;
  WithPython([&] { progress_(progress.stage, progress.done, progress.total); });
}

bool Caller::IsCanceled() {
  if (is_canceled_ || std::this_thread::get_id() != thread_) {
    return is_canceled_;
  }
  const auto now = std::chrono::steady_clock::now();
  if (now - last_check_ < kCheckInterval) return false;
  last_check_ = now;
  WithPython([] {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  });
  return is_canceled_;
}

}  // namespace mgsfm::python
