// SPDX-License-Identifier: BSD-3-Clause
#include "priors/named_vectors.h"

#include <map>
#include <optional>
#include <string_view>

#include "base/text.h"
#include "base/text_lines.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Returns the name, which may have blanks, and sets the three numbers after it.
std::string SplitLine(const TextLines& lines, const std::string& columns,
                      Eigen::Vector3d* value) {
  const auto split = SplitNamedWords(lines.line(), 3);
  if (!split) lines.Throw("expected 'image_name " + columns + "'");
  for (int k = 0; k < 3; ++k) {
    const std::string_view word = split->words[static_cast<size_t>(k)];
    const std::optional<double> number = ParseDouble(word);
    if (!number) {
      lines.Throw("has '" + Printable(word) +
                  "' where a finite number should be");
    }
    (*value)[k] = *number;
  }
  return split->name;
}

}  // namespace

std::vector<NamedVector> ReadNamedVectors(const Scene& scene,
                                          const std::string& path,
                                          const std::string& columns,
                                          const std::string& option,
                                          OtherImages others) {
  std::map<std::string, int> idx_of_name;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    idx_of_name[scene.images[i].name] = static_cast<int>(i);
  }
  TextLines lines(path, "'" + path + "' (" + option + ")");
  std::vector<NamedVector> vectors;
  Mask is_named(scene.images.size(), false);
  while (lines.NextContent()) {
    NamedVector vector;
    vector.line_number = lines.number();
    const std::string name = SplitLine(lines, columns, &vector.value);
    const auto found = idx_of_name.find(name);
    if (found == idx_of_name.end()) {
      if (others == OtherImages::kIgnore) continue;
      lines.Throw("names the image '" + name +
                  "', which the database does not have");
    }
    vector.image_idx = found->second;
    if (is_named[vector.image_idx]) lines.Throw("names '" + name + "' again");
    is_named[vector.image_idx] = true;
    vectors.push_back(vector);
  }
  return vectors;
}

}  // namespace mgsfm
