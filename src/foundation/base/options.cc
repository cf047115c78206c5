// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "mgsfm/base/options_io.h"

namespace mgsfm {
namespace {

std::string Format(bool value) { return value ? "true" : "false"; }
std::string Format(int value) { return std::to_string(value); }
std::string Format(const std::string& value) { return value; }

// The fewest digits that parse to the same number.
std::string Format(double value) {
  const double magnitude = std::abs(value);
  const bool is_handy =
      magnitude == 0.0 || (magnitude >= 1e-4 && magnitude < 1e9);
  char buffer[40];
  const auto [end, error] = std::to_chars(
      buffer, buffer + sizeof(buffer), value,
      is_handy ? std::chars_format::fixed : std::chars_format::general);
  MGSFM_CHECK(error == std::errc());
  return std::string(buffer, end);
}

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

[[noreturn]] void ThrowBadValue(const OptionEntry& entry,
                                const std::string& text,
                                const std::string& expected) {
  throw Error("option " + entry.name + ": '" + text + "' is not " + expected);
}

// Throws unless the whole text is one number in the range of its type.
template <class Number>
Number ParseNumber(const OptionEntry& entry, const std::string& text,
                   const char* type_name) {
  Number value;
  const char* end = text.data() + text.size();
  const auto [parsed_end, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc::result_out_of_range) {
    ThrowBadValue(entry, text, "within the range of its type");
  }
  if (error != std::errc() || parsed_end != end) {
    ThrowBadValue(entry, text, type_name);
  }
  return value;
}

bool ParseBool(const OptionEntry& entry, const std::string& text) {
  if (text == "true" || text == "1") return true;
  if (text == "false" || text == "0") return false;
  ThrowBadValue(entry, text, "true or false");
}

void CheckText(const OptionEntry& entry, const std::string& text) {
  if (!entry.choices.empty()) {
    if (!Contains(entry.choices, text)) {
      ThrowBadValue(entry, text, "one of " + Joined(entry.choices, ", "));
    }
    return;
  }
  if (text.empty() && entry.IsRequired()) {
    throw Error("option " + entry.name +
                " is required: " + (entry.help.empty() ? "" : entry.help));
  }
  if (!entry.range.Contains(static_cast<double>(text.size()))) {
    ThrowBadValue(entry, text, "of a length within " + entry.range.ToString());
  }
  if (const auto problem = WhyUnusable(text)) {
    throw Error("option " + entry.name + ": '" + text + "' " + *problem);
  }
}

void CheckNumber(const OptionEntry& entry, double value) {
  if (!std::isfinite(value)) {
    ThrowBadValue(entry, Format(value), "a finite number");
  }
  const Range range = entry.UsableRange();
  if (!range.Contains(value)) {
    ThrowBadValue(entry, Format(value),
                  "within " + range.ToString() +
                      (entry.unit.empty() ? "" : " " + entry.unit));
  }
}

void CheckValue(const OptionEntry& entry, const OptionValue& value) {
  if (const auto* text = std::get_if<std::string>(&value)) {
    CheckText(entry, *text);
  } else if (const auto* integer = std::get_if<int>(&value)) {
    CheckNumber(entry, *integer);
  } else if (const auto* real = std::get_if<double>(&value)) {
    CheckNumber(entry, *real);
  }
}

std::string WithoutSection(const std::string& name) {
  return name.substr(name.rfind('.') + 1);  // the whole name without '.'
}

// Levenshtein distance.
size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<size_t> row = Indices<size_t>(b.size() + 1);
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, diagonal + 1});
    }
  }
  return row[b.size()];
}

// The shortest of the names that contain the part, unless it is too short to
// be specific.
const std::string* ShortestWithPart(const std::string& part,
                                    const std::vector<std::string>& names) {
  // Three letters occur in many names by chance.
  if (part.size() < 4) return nullptr;
  const std::string* shortest = nullptr;
  for (const std::string& name : names) {
    if (ToLower(name).find(part) == std::string::npos) continue;
    if (shortest == nullptr || name.size() < shortest->size()) shortest = &name;
  }
  return shortest;
}

}  // namespace

std::string Range::ToString() const {
  if (std::isinf(min) && std::isinf(max)) return "";
  const std::string lower =
      std::isinf(min) ? "(-inf" : (min_is_open ? "(" : "[") + Format(min);
  const std::string upper =
      std::isinf(max) ? "inf)" : Format(max) + (max_is_open ? ")" : "]");
  return lower + ", " + upper;
}

std::string OptionEntry::Section() const {
  const size_t dot = name.rfind('.');
  return dot == std::string::npos ? "" : name.substr(0, dot);
}

bool OptionEntry::IsRequired() const {
  const auto* text = std::get_if<std::string>(&default_value);
  return text != nullptr && choices.empty() && text->empty() &&
         !range.Contains(0.0);
}

Range OptionEntry::UsableRange() const {
  Range usable = range;
  const bool is_real = std::holds_alternative<double>(default_value);
  const bool is_integer = std::holds_alternative<int>(default_value);
  // An integer without unit is a seed or step; all values are valid.
  if (!is_real && (!is_integer || unit.empty())) return usable;
  if (std::isinf(usable.max)) usable.max = MaxOfUnit(unit);
  if (std::isinf(usable.min)) usable.min = -usable.max;
  if (is_real && usable.min == 0.0 && usable.min_is_open) {
    // Smaller values are negligible beside numbers of size 1 in double
    // precision.
    usable.min = 1e-15;
    usable.min_is_open = false;
  }
  return usable;
}

std::string FormatOptionValue(const OptionValue& value) {
  return std::visit([](const auto& typed) { return Format(typed); }, value);
}

OptionValue ParseOptionValue(const OptionEntry& entry,
                             const std::string& text) {
  OptionValue value = entry.default_value;
  if (auto* flag = std::get_if<bool>(&value)) {
    *flag = ParseBool(entry, text);
  } else if (auto* integer = std::get_if<int>(&value)) {
    *integer = ParseNumber<int>(entry, text, "an integer");
  } else if (auto* real = std::get_if<double>(&value)) {
    *real = ParseNumber<double>(entry, text, "a number");
  } else {
    value = text;
  }
  CheckValue(entry, value);
  return value;
}

void SetOption(const OptionList& options, const std::string& name,
               const std::string& text) {
  CheckOptionNames(options, {name});
  for (const OptionEntry& entry : options) {
    if (entry.name == name) entry.set(ParseOptionValue(entry, text));
  }
}

std::optional<std::string> DescribeUnknownOption(const OptionList& options,
                                                 const std::string& name,
                                                 const OptionAdvice& advice) {
  std::vector<std::string> known_names;
  for (const OptionEntry& entry : options) {
    if (entry.name == name) return std::nullopt;
    known_names.push_back(entry.name);
  }
  const auto advised = advice ? advice(name) : std::nullopt;
  return name + (advised ? ": " + *advised : SuggestName(name, known_names));
}

void CheckOptionNames(const OptionList& options,
                      const std::vector<std::string>& names,
                      const OptionAdvice& advice) {
  std::string unknown;
  size_t num_unknown = 0;
  for (const std::string& name : names) {
    const auto described = DescribeUnknownOption(options, name, advice);
    if (!described) continue;
    unknown += (num_unknown++ == 0 ? "" : "; ") + *described;
  }
  if (num_unknown == 0) return;
  throw Error((num_unknown == 1
                   ? "unknown option "
                   : std::to_string(num_unknown) + " unknown options: ") +
              unknown);
}

void SetNamedOptions(
    const OptionList& options,
    const std::vector<std::pair<std::string, std::string>>& values) {
  std::vector<std::string> names;
  for (const auto& [name, text] : values) names.push_back(name);
  CheckOptionNames(options, names);
  for (const auto& [name, text] : values) SetOption(options, name, text);
}

void CheckOptions(const OptionList& options) {
  for (const OptionEntry& entry : options) CheckValue(entry, entry.get());
}

std::string SuggestName(const std::string& name,
                        const std::vector<std::string>& known_names) {
  const std::string wanted = ToLower(name);
  // Names are similar up to an edit distance of a third of their length, at
  // least 2: a typing error usually changes one or two letters.
  size_t min_distance = std::max<size_t>(2, wanted.size() / 3) + 1;
  const std::string* nearest = nullptr;
  for (const std::string& known_name : known_names) {
    const std::string known = ToLower(known_name);
    // A missing or wrong section costs as much as one letter.
    const size_t distance = std::min(
        EditDistance(wanted, known),
        EditDistance(WithoutSection(wanted), WithoutSection(known)) + 1);
    if (distance < min_distance) {
      min_distance = distance;
      nearest = &known_name;
    }
  }
  if (nearest == nullptr) nearest = ShortestWithPart(wanted, known_names);
  return nullptr == nearest ? "" : " (did you mean '" + *nearest + "'?)";
}

}  // namespace mgsfm
