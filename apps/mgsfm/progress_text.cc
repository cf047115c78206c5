// SPDX-License-Identifier: BSD-3-Clause
#include "progress_text.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"

namespace mgsfm {

std::string FormatHoursMinutes(double seconds) {
  // An estimate of more than a century is meaningless.
  constexpr double kMaxMinutes = 60.0 * 24.0 * 36525.0;
  const auto minutes = static_cast<long>(
      std::clamp(std::ceil(seconds / 60.0), 0.0, kMaxMinutes));
  return Formatted("%ld:%02ld", minutes / 60, minutes % 60);
}

std::string ProgressBar(double share, int width) {
  const int num_done = static_cast<int>(std::clamp(share, 0.0, 1.0) *
                                        static_cast<double>(width));
  std::string bar(static_cast<size_t>(num_done), '=');
  if (num_done < width) bar += '>';
  bar.resize(static_cast<size_t>(width), ' ');
  return "[" + bar + "]";
}

std::optional<std::string> ProgressText::Update(const Progress& progress,
                                                double now_s) {
  if (progress.total == 0) return std::nullopt;
  // The same stage may run once more, for another part of the scene.
  if (progress.stage != stage_ || progress.done < num_done_at_start_) {
    stage_ = progress.stage;
    stage_start_s_ = now_s;
    num_done_at_start_ = progress.done;
  }
  share_ =
      static_cast<double>(progress.done) / static_cast<double>(progress.total);
  if (progress.done >= progress.total) {
    stage_.clear();
    return std::nullopt;
  }
  const auto num_new = static_cast<double>(progress.done - num_done_at_start_);
  if (num_new == 0.0 || now_s - shown_s_ < interval_s_) return std::nullopt;
  shown_s_ = now_s;
  const double per_second = num_new / std::max(1e-9, now_s - stage_start_s_);
  const auto num_left = static_cast<double>(progress.total - progress.done);
  const std::string numbers = Formatted(
      per_second < 1000.0 ? ": %zu of %zu, %.3g/s, " : ": %zu of %zu, %.0f/s, ",
      progress.done, progress.total, per_second);
  return stage_ + numbers + FormatHoursMinutes(num_left / per_second) + " left";
}

}  // namespace mgsfm
