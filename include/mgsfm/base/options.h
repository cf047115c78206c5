// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <string_view>

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
// report and docs/options.md are all visitors of this one list
// (mgsfm/base/options_io.h).

// The values an option may take; `open` ends are excluded.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_is_open = false;
  bool max_is_open = false;

  bool Contains(double value) const {
    return (min_is_open ? value > min : value >= min) &&
           (max_is_open ? value < max : value <= max);
  }
  // As interval, e.g. "[2, inf)".
  std::string ToString() const;
};

inline Range AnyValue() { return {}; }
inline Range AtLeast(double min) { return {min, Range().max, false, false}; }
inline Range GreaterThan(double min) { return {min, Range().max, true, false}; }
inline Range Between(double min, double max) {
  return {min, max, false, false};
}

// The names of the values of an enum that is used as an option. Specialise
// with `static constexpr std::pair<std::string_view, E> kNames[] = {...};`.
template <class E>
struct EnumTable;

}  // namespace mgsfm
