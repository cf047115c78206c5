// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {

// An options struct describes each of its fields once:
//
//   struct TrackOptions {
//     int min_track_length = 3;
//     template <class Self, class Visitor>
//     static void Describe(Self& self, Visitor& visit) {
//       visit("min_track_length", self.min_track_length, AtLeast(2), "images",
//             "Minimum number of images of a track.");
//     }
//   };
//
// Self is the struct, const or not. A field is a bool, int, double, std::string
// or an enum with a table of names (see EnumTable). A struct that contains
// other options structs nests them under a prefix:
//
//   visit.Group("Tracks", self.tracks);
//
// Command-line flags, configuration files, range checks, the report and the
// options reference are all generated from this description
// (mgsfm/base/options_io.h).

// The valid values of a number, or the valid lengths of a string. Open ends are
// excluded. Ignored for other types.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_is_open = false;
  bool max_is_open = false;

  bool Contains(double value) const {
    return (min_is_open ? value > min : value >= min) &&
           (max_is_open ? value < max : value <= max);
  }
  // Interval notation, e.g. "[2, inf)"; "" if unbounded.
  std::string ToString() const;
};

inline Range AnyValue() { return {}; }
inline Range AtLeast(double min) { return {min, Range().max, false, false}; }
inline Range GreaterThan(double min) { return {min, Range().max, true, false}; }
inline Range Between(double min, double max) {
  return {min, max, false, false};
}
// For strings that must not be empty.
inline Range Required() { return AtLeast(1); }

// The names of the values of an enum option. Specialise with
// `static constexpr std::pair<std::string_view, E> kNames[] = {...};`.
template <class E>
struct EnumTable;

template <class E>
std::string_view EnumName(E value) {
  for (const auto& [name, named_value] : EnumTable<E>::kNames) {
    if (named_value == value) return name;
  }
  throw ContractError("an enum value is missing in its EnumTable");
}

// Throws ContractError unless `name` is in the table.
template <class E>
E EnumValue(std::string_view name) {
  for (const auto& [value_name, value] : EnumTable<E>::kNames) {
    if (value_name == name) return value;
  }
  throw ContractError("no enum value is named " + std::string(name));
}

}  // namespace mgsfm
