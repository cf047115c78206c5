// SPDX-License-Identifier: BSD-3-Clause
#include "base/option_range.h"

#include <cmath>
#include <utility>

namespace mgsfm {
namespace {

// Numbers of all other units are ratios or counts of parts of a recording.
constexpr std::pair<std::string_view, double> kMaxima[] = {
    {"rounds", 100},       {"iterations", 1e4}, {"frames", 1e5},
    {"images", 1e6},       {"trials", 1e5},     {"deg", 360},
    {"rad", 2 * M_PI},     {"m", 1e7},          {"of the larger side", 1e3},
    {"matches", 1e7},      {"features", 1e7},   {"points", 1e7},
    {"observations", 1e7}, {"tracks", 1e7},     {"descriptors", 1e8},
    {"words", 1e8},        {"pairs", 1e8}};

double MaxOfUnit(std::string_view unit) {
  for (const auto& [name, max] : kMaxima) {
    if (name == unit) return max;
  }
  // Far above any sensible ratio, size or time; rejects only typing errors.
  return 1e6;
}

}  // namespace

Range RangeOf(const OptionEntry& entry) {
  Range range = entry.range;
  const bool is_real = std::holds_alternative<double>(entry.default_value);
  const bool is_integer = std::holds_alternative<int>(entry.default_value);
  // An integer without unit is a seed or step; all values are valid.
  if (!is_real && (!is_integer || entry.unit.empty())) return range;
  if (std::isinf(range.max)) range.max = MaxOfUnit(entry.unit);
  if (std::isinf(range.min)) range.min = -range.max;
  if (is_real && range.min == 0.0 && range.min_is_open) {
    // Smaller values are negligible beside numbers of size 1 in double
    // precision.
    range.min = 1e-15;
    range.min_is_open = false;
  }
  return range;
}

}  // namespace mgsfm
