// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <istream>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "mgsfm/base/options.h"

namespace mgsfm {

// The value of an option. Enums are represented by their names.
using OptionValue = std::variant<bool, int, double, std::string>;

// One type-erased field of an options struct. References that struct, which
// must outlive it.
struct OptionEntry {
  std::string name;  // including prefixes, e.g. "Tracks.min_track_length"
  std::string unit;
  std::string help;
  Range range;
  std::vector<std::string> choices;  // names of an enum; empty for other types
  OptionValue default_value;         // the value when the option was listed
  std::function<OptionValue()> get;
  std::function<void(const OptionValue&)> set;  // without range check

  // "" at top level, "Tracks" for "Tracks.min_track_length".
  std::string Section() const;
  // The default is unusable, so the user must set the option.
  bool IsRequired() const;
  // The range, with default limits where the option has none: the largest
  // meaningful value in its unit, and the smallest for positive numbers. These
  // limits prevent endless loops, absurd allocations, and overflow in squares
  // and quotients.
  Range UsableRange() const;
};

using OptionList = std::vector<OptionEntry>;

// A visitor for Describe that collects the options in a list. All other
// functions operate on this list.
class OptionLister {
 public:
  // Options, and structs whose options are listed under their own names.
  template <class... Items>
  void operator()(Items&... items) {
    (List(items), ...);
  }

  // A struct whose options are listed under a prefix.
  template <class Options>
  void Group(const char* name, Options& options) {
    const std::string outer_prefix = prefix_;
    prefix_ += std::string(name) + ".";
    List(options);
    prefix_ = outer_prefix;
  }

  OptionList TakeEntries() { return std::move(entries_); }

 private:
  template <class Options>
  void List(Options& options) {
    options.Describe(*this);
  }

  template <class T>
  void List(Option<T>& option) {
    const OptionInfo& info = option.Info();
    OptionEntry entry;
    entry.name = prefix_ + info.name;
    entry.unit = info.unit;
    entry.help = info.help;
    entry.range = info.range;
    if constexpr (std::is_enum_v<T>) {
      for (const auto& choice : EnumTable<T>::kNames) {
        entry.choices.emplace_back(choice.first);
      }
      entry.get = [&option]() -> OptionValue {
        return std::string(EnumName<T>(option));
      };
      entry.set = [&option](const OptionValue& value) {
        option = EnumValue<T>(std::get<std::string>(value));
      };
    } else {
      entry.get = [&option]() -> OptionValue { return *option; };
      entry.set = [&option](const OptionValue& value) {
        option = std::get<T>(value);
      };
    }
    entry.default_value = entry.get();
    entries_.push_back(std::move(entry));
  }

  std::string prefix_;
  OptionList entries_;
};

template <class Options>
OptionList ListOptions(Options* options) {
  OptionLister lister;
  lister(*options);
  return lister.TakeEntries();
}

// ---------------------------------------------------------------- values

// Formats a value. Numbers use the fewest digits that parse to the same number.
std::string FormatOptionValue(const OptionValue& value);

// Parses a value of the type of the entry. Throws Error that names the option
// if the text is not exactly one finite value of that type within its range.
OptionValue ParseOptionValue(const OptionEntry& entry, const std::string& text);

// Parses and sets the named option. Throws Error with a suggestion if the name
// is unknown.
void SetOption(const OptionList& options, const std::string& name,
               const std::string& text);

// The replacement of an option of another program, such as "use --x".
using OptionAdvice =
    std::function<std::optional<std::string>(const std::string& name)>;

// "x: use --y" or "x (did you mean 'z'?)"; nullopt if the option is known.
std::optional<std::string> DescribeUnknownOption(const OptionList& options,
                                                 const std::string& name,
                                                 const OptionAdvice& advice);

// Throws one Error for all names that are unknown.
void CheckOptionNames(const OptionList& options,
                      const std::vector<std::string>& names,
                      const OptionAdvice& advice = {});

// Sets all named options after checking their names.
void SetNamedOptions(
    const OptionList& options,
    const std::vector<std::pair<std::string, std::string>>& values);

// Throws Error unless all values are finite and within their ranges.
void CheckOptions(const OptionList& options);
template <class Options>
void CheckOptionsOf(Options options) {
  CheckOptions(ListOptions(&options));
}

// " (did you mean 'nearest'?)", or "" if no known name is similar to `name`.
std::string SuggestName(const std::string& name,
                        const std::vector<std::string>& known_names);

// ----------------------------------------------------- configuration file
//
//   # a comment
//   num_threads = 4
//   [Tracks]
//   min_track_length = 3
//
// `mgsfm_version` may name the version that wrote the file; a newer one than
// this is an error. Keys are option names without the prefix of their section.
// A value extends to the end of its line. Values that start or end with a space
// or start with '"' are quoted, with the escapes \" and \\. Keys may appear in
// any order, each at most once.

// Sets the options listed in the text. `source` identifies the text in errors.
void LoadOptions(std::istream& text, const std::string& source,
                 const OptionList& options, const OptionAdvice& advice = {});
void LoadOptions(const std::filesystem::path& path, const OptionList& options,
                 const OptionAdvice& advice = {});

// All options with their current values, in the format of LoadOptions.
std::string DumpOptions(const OptionList& options);

// --------------------------------------------------------------- formatting

// {"num_threads": 4, "Tracks": {"min_track_length": 3}}
std::string OptionsToJson(const OptionList& options);
template <class Options>
std::string OptionsToJsonOf(Options options) {
  return OptionsToJson(ListOptions(&options));
}

// Command-line help with at most 80 columns: flag, type, default, range, unit
// and help text of each option.
std::string OptionsToHelp(const OptionList& options);

// One table per section.
std::string OptionsToMarkdown(const OptionList& options);

}  // namespace mgsfm
