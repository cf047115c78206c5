// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/options_io.h"

#include <algorithm>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <set>

#include "base/text_lines.h"
#include "base/text_streams.h"
#include "base/text_tools.h"
#include "mgsfm/base/version.h"

namespace mgsfm {
namespace {

std::string Trim(const std::string& text) {
  const char* const spaces = " \t\r";
  const size_t begin = text.find_first_not_of(spaces);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(spaces) - begin + 1);
}

// Quotes text that Trim or Unquote would change.
std::string QuoteIfNeeded(const std::string& text) {
  if (text == Trim(text) && (text.empty() || text[0] != '"')) return text;
  TextOutput quoted;
  quoted << std::quoted(text);
  return quoted.str();
}

std::string Unquote(const std::string& text) {
  if (text.empty() || text[0] != '"') return text;
  std::string unquoted;
  for (size_t i = 1; i < text.size(); ++i) {
    if (text[i] == '"' && i + 1 == text.size()) return unquoted;
    if (text[i] == '"') break;
    if (text[i] == '\\' && i + 1 < text.size()) ++i;
    unquoted += text[i];
  }
  throw Error("unbalanced quotes in " + text);
}

constexpr char kVersionKey[] = "mgsfm_version";

// The reader's position in a configuration file.
struct FileState {
  std::string section;
  std::set<std::string> names;
  std::string version;  // of the program that wrote the file; may be empty
  std::string unknown;  // unknown options with their lines
};

// The file and line of a message.
std::string Place(const std::string& source, int line_number) {
  return source + ":" + std::to_string(line_number) + ": ";
}

void CheckFileVersion(const std::string& version) {
  if (!IsNewerVersion(version)) return;
  throw Error("the file was written by mgsfm " + version +
              ", which is newer than this " + Version() +
              "; update mgsfm, or remove the line and what it does not know");
}

// Parses one line of a configuration file, which sets a section or an option.
// Returns a description of the option if it is unknown.
std::optional<std::string> LoadLine(const std::string& line,
                                    const OptionList& options,
                                    const OptionAdvice& advice,
                                    FileState* state) {
  if (line.empty() || line[0] == '#' || line[0] == ';') return std::nullopt;
  if (line[0] == '[') {
    if (line.back() != ']') throw Error("']' is missing after '" + line + "'");
    state->section = Trim(line.substr(1, line.size() - 2));
    return std::nullopt;
  }
  const size_t equals = line.find('=');
  if (equals == std::string::npos) {
    throw Error("expected 'key = value' or '[Section]', not '" + line + "'");
  }
  const std::string key = Trim(line.substr(0, equals));
  const std::string name =
      state->section.empty() ? key : state->section + "." + key;
  if (!state->names.insert(name).second) {
    throw Error("option " + name + " is set twice; remove one of the lines");
  }
  const std::string value = Unquote(Trim(line.substr(equals + 1)));
  if (name == kVersionKey) {
    CheckFileVersion(value);
    state->version = value;
    return std::nullopt;
  }
  auto unknown = DescribeUnknownOption(options, name, advice);
  if (!unknown) SetOption(options, name, value);
  return unknown;
}

// Describes the valid values, e.g. "int in [2, inf)" or "a|b".
std::string DescribeType(const OptionEntry& entry) {
  if (!entry.choices.empty()) return Joined(entry.choices, "|");
  if (std::holds_alternative<std::string>(entry.default_value)) return "text";
  if (std::holds_alternative<bool>(entry.default_value)) return "true|false";
  const std::string text =
      std::holds_alternative<int>(entry.default_value) ? "int" : "number";
  const std::string range = entry.UsableRange().ToString();
  return range.empty() ? text : text + " in " + range;
}

std::string DescribeDefault(const OptionEntry& entry) {
  if (entry.IsRequired()) return "required";
  const std::string text = FormatOptionValue(entry.default_value);
  return text.empty() ? "none" : text;
}

void AppendWrapped(const std::string& text, size_t indent, std::string* out) {
  TextInput words(text);
  std::string word;
  size_t column = 0;
  while (words >> word) {
    // A terminal has 80 columns.
    if (column == 0 || column + 1 + word.size() > 80) {
      *out += (column == 0 ? "" : "\n") + std::string(indent, ' ') + word;
      column = indent + word.size();
    } else {
      *out += " " + word;
      column += 1 + word.size();
    }
  }
  if (column > 0) *out += "\n";
}

std::string EscapePipes(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '|') escaped += '\\';
    escaped += c;
  }
  return escaped;
}

struct Section {
  std::string name;
  std::vector<const OptionEntry*> entries;
};

// The sections are in the order of their first option.
std::vector<Section> SectionsOf(const OptionList& options) {
  std::vector<Section> sections;
  for (const OptionEntry& entry : options) {
    const std::string name = entry.Section();
    auto section =
        std::find_if(sections.begin(), sections.end(),
                     [&](const Section& other) { return other.name == name; });
    if (section == sections.end()) {
      // The top level must come first because it has no heading in files.
      section = sections.insert(name.empty() ? sections.begin() : section,
                                {name, {}});
    }
    section->entries.push_back(&entry);
  }
  return sections;
}

std::string KeyInSection(const OptionEntry& entry) {
  return entry.name.substr(entry.name.rfind('.') + 1);
}

}  // namespace

void LoadOptions(std::istream& text, const std::string& source,
                 const OptionList& options, const OptionAdvice& advice) {
  std::string line;
  FileState state;
  const auto fail = [&](const std::string& problem) {
    const bool is_older = !state.version.empty() && state.version != Version();
    throw Error(problem + (is_older
                               ? "; mgsfm " + state.version +
                                     " wrote the file, this is " + Version()
                               : ""));
  };
  for (int line_number = 1; std::getline(text, line); ++line_number) {
    try {
      const auto unknown = LoadLine(Trim(line), options, advice, &state);
      if (!unknown) continue;
      state.unknown += (state.unknown.empty() ? "" : "; ") +
                       Place(source, line_number) + "unknown option " +
                       *unknown;
    } catch (const Error& error) {
      fail(Place(source, line_number) + error.what());
    }
  }
  if (text.bad()) throw Error(source + ": read error");
  if (!state.unknown.empty()) fail(state.unknown);
}

void LoadOptions(const std::filesystem::path& path, const OptionList& options,
                 const OptionAdvice& advice) {
  TextInput file(ReadText(path, "configuration file '" + path.string() + "'"));
  LoadOptions(file, path.string(), options, advice);
}

std::string DumpOptions(const OptionList& options) {
  std::string text = std::string(kVersionKey) + " = " + Version() + "\n";
  for (const auto& [section, entries] : SectionsOf(options)) {
    if (!section.empty()) text += "\n[" + section + "]\n";
    for (const OptionEntry* entry : entries) {
      const std::string value = FormatOptionValue(entry->get());
      // A required option stays commented out so that it is still reported as
      // missing.
      if (value.empty() && entry->IsRequired()) text += "# required: ";
      text += KeyInSection(*entry) + " = " + QuoteIfNeeded(value) + "\n";
    }
  }
  return text;
}

std::string OptionsToJson(const OptionList& options) {
  nlohmann::ordered_json root = nlohmann::ordered_json::object();
  for (const OptionEntry& entry : options) {
    nlohmann::ordered_json* node = &root;
    TextInput sections(entry.Section());
    std::string section;
    while (std::getline(sections, section, '.')) node = &(*node)[section];
    std::visit([&](const auto& value) { (*node)[KeyInSection(entry)] = value; },
               entry.get());
  }
  // JSON must be valid UTF-8, paths need not be.
  return root.dump(2, ' ', false,
                   nlohmann::ordered_json::error_handler_t::replace);
}

std::string OptionsToHelp(const OptionList& options) {
  std::string text;
  for (const auto& [section, entries] : SectionsOf(options)) {
    if (!section.empty()) text += "\n" + section + "\n";
    for (const OptionEntry* entry : entries) {
      text += "  --" + entry->name + "\n";
      AppendWrapped(DescribeType(*entry) +
                        (entry->unit.empty() ? "" : " " + entry->unit) +
                        "; default: " + DescribeDefault(*entry),
                    6, &text);
      AppendWrapped(entry->help, 6, &text);
    }
  }
  return text;
}

std::string OptionsToMarkdown(const OptionList& options) {
  std::string text;
  for (const auto& [section, entries] : SectionsOf(options)) {
    if (!section.empty()) text += "\n### " + section + "\n\n";
    text += "| option | default | values | unit | meaning |\n";
    text += "|---|---|---|---|---|\n";
    for (const OptionEntry* entry : entries) {
      text += "| `" + entry->name + "` | " + DescribeDefault(*entry) + " | " +
              EscapePipes(DescribeType(*entry)) + " | " + entry->unit + " | " +
              EscapePipes(entry->help) + " |\n";
    }
  }
  return text;
}

}  // namespace mgsfm
