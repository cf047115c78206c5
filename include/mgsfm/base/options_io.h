// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <istream>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "mgsfm/base/options.h"

namespace mgsfm {

// The value of an option; that of an enum is its name.
using OptionValue = std::variant<bool, int, double, std::string>;

// One field of a struct of options, without its type. Refers to the struct it
// was listed from, which must outlive it.
struct OptionEntry {
  std::string name;  // with prefixes, e.g. "Tracks.min_track_length"
  std::string unit;
  std::string help;
  Range range;
  std::vector<std::string> choices;  // the names of an enum, otherwise empty
  OptionValue default_value;         // what the field held when it was listed
  std::function<OptionValue()> get;
  std::function<void(const OptionValue&)> set;  // does not check

  // "" at top level, "Tracks" for "Tracks.min_track_length".
  std::string Section() const;
  // Must be set by the user, as it has no usable default.
  bool IsRequired() const;
};

using OptionList = std::vector<OptionEntry>;

// Calls that Describe makes, as a list. The only template of the mechanism;
// everything else works on its result.
class OptionLister {
 public:
  template <class T>
  void operator()(std::string_view name, T& field, const Range& range,
                  std::string_view unit, std::string_view help) {
    OptionEntry entry;
    entry.name = prefix_ + std::string(name);
    entry.unit = unit;
    entry.help = help;
    entry.range = range;
    if constexpr (std::is_enum_v<T>) {
      for (const auto& choice : EnumTable<T>::kNames) {
        entry.choices.emplace_back(choice.first);
      }
      entry.get = [&field]() -> OptionValue {
        return std::string(EnumName(field));
      };
      entry.set = [&field](const OptionValue& value) {
        field = EnumValue<T>(std::get<std::string>(value));
      };
    } else {
      entry.get = [&field]() -> OptionValue { return field; };
      entry.set = [&field](const OptionValue& value) {
        field = std::get<T>(value);
      };
    }
    entry.default_value = entry.get();
    entries_.push_back(std::move(entry));
  }

  template <class T>
  void Group(std::string_view name, T& group) {
    const std::string outer_prefix = prefix_;
    prefix_ += std::string(name) + ".";
    T::Describe(group, *this);
    prefix_ = outer_prefix;
  }

  OptionList TakeEntries() { return std::move(entries_); }

 private:
  std::string prefix_;
  OptionList entries_;
};

template <class Options>
OptionList ListOptions(Options* options) {
  OptionLister lister;
  Options::Describe(*options, lister);
  return lister.TakeEntries();
}

// ---------------------------------------------------------------- values

// How a value is written in all texts. Numbers are written with the fewest
// digits that are read back as the same number.
std::string FormatOptionValue(const OptionValue& value);

// Reads a value of the type of the entry. Throws Error, naming the option, if
// the text is not exactly one finite value of that type, or out of range.
OptionValue ParseOptionValue(const OptionEntry& entry, const std::string& text);

// ParseOptionValue, then set. Unknown names are an Error that suggests the
// nearest known one.
void SetOption(const OptionList& options, const std::string& name,
               const std::string& text);

// Throws Error unless all values are finite and in their range.
void CheckOptions(const OptionList& options);
template <class Options>
void CheckOptionsOf(Options options) {
  CheckOptions(ListOptions(&options));
}

// " (did you mean 'nearest'?)" or "" if none of the names is like `name`.
std::string SuggestName(const std::string& name,
                        const std::vector<std::string>& known_names);

// ----------------------------------------------------- configuration file
//
//   # a comment
//   num_threads = 4
//   [Tracks]
//   min_track_length = 3
//
// Keys are the names of the command line; those of a section leave out its
// prefix. A value ends with its line; one that starts or ends with a space or
// starts with '"' is quoted, with \" and \\ inside. Keys may come in any order,
// but each only once.

// Sets the options that the text names. `source` names it in errors.
void LoadOptions(std::istream& text, const std::string& source,
                 const OptionList& options);
void LoadOptions(const std::filesystem::path& path, const OptionList& options);

// All options with their present values; LoadOptions reads it back.
std::string DumpOptions(const OptionList& options);

// ------------------------------------------------------------------- texts

// {"num_threads": 4, "Tracks": {"min_track_length": 3}}
std::string OptionsToJson(const OptionList& options);
template <class Options>
std::string OptionsToJsonOf(Options options) {
  return OptionsToJson(ListOptions(&options));
}

// For --help: per option its flag, type, default, range, unit and help text,
// at most 80 columns wide.
std::string OptionsToHelp(const OptionList& options);

// A table per section.
std::string OptionsToMarkdown(const OptionList& options);

}  // namespace mgsfm
