// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/import_formats.h"

#include "base/text_tools.h"

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

}  // namespace

const ImportFormat* FindImportFormat(std::string_view name) {
  const std::string lower = ToLower(std::string(name));
  for (const KnownFormat& known : kFormats) {
    if (known.format.name == lower) return &known.format;
  }
  return nullptr;
}

std::vector<std::string> ImportFormatNames() {
  std::vector<std::string> names;
  for (const KnownFormat& known : kFormats) {
    names.emplace_back(known.format.name);
  }
  return names;
}

const ImportFormat* GuessImportFormat(const std::filesystem::path& path) {
  const std::string extension = ToLower(path.extension().string());
  for (const KnownFormat& known : kFormats) {
    if (known.extension == extension) return &known.format;
  }
  return nullptr;
}

}  // namespace mgsfm
