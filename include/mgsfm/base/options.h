// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {

// The one mechanism for options. A struct of options lists its fields once:
//
//   struct TrackOptions {
//     int min_track_length = 3;
//     template <class Self, class Visitor>
//     static void Describe(Self& self, Visitor& visit) {
//       visit("min_track_length", self.min_track_length, AtLeast(2), "images",
//             "Shorter tracks are not used.");
//     }
//   };
//
// Self is the struct or its const version. A field is bool, int, double,
// std::string or an enum with a table of names (see EnumTable). A struct made
// of other structs nests them under a prefix:
//
//   visit.Group("Tracks", self.tracks);
//
// Command-line flags, the configuration file, --dump_config, the checks, the
// report and docs/options.md are all made from this one list
// (mgsfm/base/options_io.h).

// The values that a number may take, or the lengths of a string; `open` ends
// are excluded. Has no meaning for other types.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_is_open = false;
  bool max_is_open = false;

  bool Contains(double value) const {
    return (min_is_open ? value > min : value >= min) &&
           (max_is_open ? value < max : value <= max);
  }
  // As interval, e.g. "[2, inf)"; "" if there is no limit.
  std::string ToString() const;
};

inline Range AnyValue() { return {}; }
inline Range AtLeast(double min) { return {min, Range().max, false, false}; }
inline Range GreaterThan(double min) { return {min, Range().max, true, false}; }
inline Range Between(double min, double max) {
  return {min, max, false, false};
}
// For strings: must not be left empty.
inline Range Required() { return AtLeast(1); }

// The names of the values of an enum that is used as an option. Specialise
// with `static constexpr std::pair<std::string_view, E> kNames[] = {...};`.
template <class E>
struct EnumTable;

template <class E>
std::string_view EnumName(E value) {
  for (const auto& [name, named_value] : EnumTable<E>::kNames) {
    if (named_value == value) return name;
  }
  throw ContractError("a value of an enum has no name in its EnumTable");
}

// `name` must be one of the table.
template <class E>
E EnumValue(std::string_view name) {
  for (const auto& [value_name, value] : EnumTable<E>::kNames) {
    if (value_name == name) return value;
  }
  throw ContractError("no value of the enum is named " + std::string(name));
}

}  // namespace mgsfm
