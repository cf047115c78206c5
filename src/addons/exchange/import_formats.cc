// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/import_formats.h"

#include <algorithm>
#include <cctype>
#include <iterator>

namespace mgsfm {
namespace {

struct KnownFormat {
  ImportFormat format;
  std::string_view extension;
};

constexpr KnownFormat kFormats[] = {
    {{"nvm", ReadNvm}, ".nvm"},
    {{"bundler", ReadBundler}, ".out"},
    {{"nerfstudio", ReadNerfstudio}, ".json"},
};

std::string ToLower(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return lower;
}

template <class Predicate>
const ImportFormat* FindIf(Predicate is_wanted) {
  const auto* const found =
      std::find_if(std::begin(kFormats), std::end(kFormats), is_wanted);
  return found == std::end(kFormats) ? nullptr : &found->format;
}

}  // namespace

const ImportFormat* FindImportFormat(std::string_view name) {
  return FindIf([lower = ToLower(name)](const KnownFormat& known) {
    return known.format.name == lower;
  });
}

std::vector<std::string> ImportFormatNames() {
  std::vector<std::string> names;
  for (const KnownFormat& known : kFormats) {
    names.emplace_back(known.format.name);
  }
  return names;
}

const ImportFormat* GuessImportFormat(const std::filesystem::path& path) {
  return FindIf(
      [extension = ToLower(path.extension().string())](
          const KnownFormat& known) { return known.extension == extension; });
}

}  // namespace mgsfm
