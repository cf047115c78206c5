// SPDX-License-Identifier: BSD-3-Clause
#include "video/frame_selection.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

int NearestTo(int64_t instant_ns, const std::vector<int64_t>& times_ns) {
  const auto after =
      std::lower_bound(times_ns.begin(), times_ns.end(), instant_ns);
  const auto idx = static_cast<int>(after - times_ns.begin());
  if (after == times_ns.begin()) return idx;
  if (after == times_ns.end()) return idx - 1;
  return instant_ns - *(after - 1) <= *after - instant_ns ? idx - 1 : idx;
}

}  // namespace

std::vector<int> SelectByRate(const std::vector<int64_t>& times_ns,
                              double rate_hz) {
  MGSFM_CHECK(rate_hz > 0.0);
  std::vector<int> selected;
  if (times_ns.empty()) return selected;
  const auto length_ns =
      static_cast<double>(times_ns.back() - times_ns.front());
  const auto num_steps = static_cast<int64_t>(length_ns * rate_hz / 1e9);
  for (int64_t k = 0; k <= num_steps; ++k) {
    const auto offset_ns = static_cast<int64_t>(
        std::llround(static_cast<double>(k) * 1e9 / rate_hz));
    const int nearest = NearestTo(times_ns.front() + offset_ns, times_ns);
    if (selected.empty() || nearest > selected.back()) {
      selected.push_back(nearest);
    }
  }
  return selected;
}

std::vector<std::optional<int>> SelectAtInstants(
    const std::vector<int64_t>& instants_ns,
    const std::vector<int64_t>& times_ns, int64_t max_difference_ns) {
  std::vector<std::optional<int>> selected(instants_ns.size());
  if (times_ns.empty()) return selected;
  const auto difference = [&](size_t i, int idx) {
    return std::abs(instants_ns[i] - times_ns[idx]);
  };
  std::optional<size_t> last;  // the last instant with an image
  for (size_t i = 0; i < instants_ns.size(); ++i) {
    const int nearest = NearestTo(instants_ns[i], times_ns);
    if (difference(i, nearest) > max_difference_ns) continue;
    if (last && selected[*last] == nearest) {
      if (difference(*last, nearest) <= difference(i, nearest)) continue;
      selected[*last].reset();
    }
    selected[i] = nearest;
    last = i;
  }
  return selected;
}

std::optional<int64_t> MedianInterval(const std::vector<int64_t>& times_ns) {
  if (times_ns.size() < 2) return std::nullopt;
  std::vector<int64_t> intervals;
  for (size_t i = 1; i < times_ns.size(); ++i) {
    intervals.push_back(times_ns[i] - times_ns[i - 1]);
  }
  const auto middle =
      intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  return *middle;
}

}  // namespace mgsfm
