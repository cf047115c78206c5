// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {

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

constexpr Range AnyValue() { return {}; }
constexpr Range AtLeast(double min) { return {min, Range().max, false, false}; }
constexpr Range GreaterThan(double min) {
  return {min, Range().max, true, false};
}
constexpr Range Between(double min, double max) {
  return {min, max, false, false};
}
// The range of strings that must not be empty.
constexpr Range Required() { return AtLeast(1); }

// The documentation of an option. Texts are literals.
struct OptionInfo {
  const char* name;
  Range range;
  const char* unit;
  const char* help;
};

// A value with its documentation. T is bool, int, double, std::string or an
// enum with a table of names (see EnumTable). An options struct documents each
// option at its declaration and lists all of them once:
//
//   struct TrackOptions {
//     Option<int> min_track_length{"min_track_length", 3, AtLeast(2), "images",
//                                  "Minimum track length."};
//     Option<bool> use_all{"use_all", false, "Use all tracks."};
//     SplitOptions split;
//     LossOptions loss;
//
//     template <class Visitor>
//     void Describe(Visitor& visit) {
//       visit(min_track_length, use_all, split);
//       visit.Group("Loss", loss);
//     }
//   };
//
// The options of a nested struct follow under their own names (`split`) or
// under a prefix (`Loss.`). Command-line flags, configuration files, range
// checks, the report and the options reference are generated from this list
// (mgsfm/base/options_io.h).
//
// An option converts to its value and can be assigned one. Templates and member
// functions need `*option` or `option->`, and `auto` should be avoided:
//
//   const int min_length = options.min_track_length;
//   if (!options.output_path->empty()) Write(*options.output_path + ".txt");
template <class T>
class Option {
 public:
  constexpr Option(const char* name, T value, const char* help)
      : Option(name, std::move(value), AnyValue(), "", help) {}
  constexpr Option(const char* name, T value, const Range& range,
                   const char* help)
      : Option(name, std::move(value), range, "", help) {}
  constexpr Option(const char* name, T value, const Range& range,
                   const char* unit, const char* help)
      : value_(std::move(value)), info_{name, range, unit, help} {}

  // Assignments change the value only.
  Option(const Option&) = default;
  Option& operator=(const Option& other) { return *this = other.value_; }
  Option& operator=(T value) {
    value_ = std::move(value);
    return *this;
  }

  // NOLINTNEXTLINE(google-explicit-constructor)
  constexpr operator const T&() const { return value_; }
  constexpr const T& operator*() const { return value_; }
  constexpr const T* operator->() const { return &value_; }

  constexpr const OptionInfo& Info() const { return info_; }

 private:
  T value_;
  OptionInfo info_;
};

// The names of the values of an enum option. Specialize with
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
