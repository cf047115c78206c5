// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/context.h"

#include "mgsfm/base/error.h"

namespace mgsfm {

void Context::Debug(const std::string& message) const {
  if (log) log(LogLevel::kDebug, message);
}

void Context::Info(const std::string& message) const {
  if (log) log(LogLevel::kInfo, message);
}

void Context::Warning(const std::string& message) const {
  if (log) log(LogLevel::kWarning, message);
}

void Context::ReportProgress(std::string_view stage, size_t done,
                             size_t total) const {
  CheckInterrupted();
  if (progress) progress({stage, done, total});
}

void Context::CheckInterrupted() const {
  if (is_canceled && is_canceled()) throw Interrupted();
}

}  // namespace mgsfm
