// SPDX-License-Identifier: BSD-3-Clause
#include "io/priors/named_vectors.h"

#include <map>
#include <optional>

#include "base/file_reading.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

[[noreturn]] void ThrowAtLine(const std::string& path, int number,
                              const std::string& problem) {
  throw Error("'" + path + "': line " + std::to_string(number) + " " + problem);
}

// Names may have blanks: the last three words are the numbers. Returns the
// name; `problem` says what is wrong, if anything.
std::string SplitLine(const std::string& line, const std::string& columns,
                      Eigen::Vector3d* value, std::string* problem) {
  std::vector<std::string> words;
  TextInput stream(line);
  for (std::string word; stream >> word;) words.push_back(word);
  if (words.size() < 4) {
    *problem = "is not 'image_name " + columns + "'";
    return "";
  }
  size_t end = line.size();
  for (int k = 2; k >= 0; --k) {
    const std::string& word = words[words.size() - 3 + k];
    const std::optional<double> number = ParseDouble(word);
    if (!number) {
      *problem = "has '" + word + "' where a finite number should be";
      return "";
    }
    (*value)[k] = *number;
    end = line.rfind(word, end - 1);
  }
  std::string name = line.substr(0, end);
  name.erase(name.find_last_not_of(" \t") + 1);
  name.erase(0, name.find_first_not_of(" \t"));
  return name;
}

bool IsSkipped(const std::string& line) {
  return line.find_first_not_of(" \t") == std::string::npos ||
         line.front() == '#';
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
  TextInput file(ReadFile(path, "'" + path + "' (" + option + ")"));
  std::vector<NamedVector> vectors;
  Mask is_named(scene.images.size(), false);
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (IsSkipped(line)) continue;
    NamedVector vector;
    vector.line_number = number;
    std::string problem;
    const std::string name = SplitLine(line, columns, &vector.value, &problem);
    const auto found = idx_of_name.find(name);
    const bool is_unknown = problem.empty() && found == idx_of_name.end();
    if (is_unknown && others == OtherImages::kIgnore) continue;
    if (is_unknown) {
      problem = "names the image '";
      problem += name + "', which the database does not have";
    } else if (problem.empty() && is_named[found->second]) {
      problem = "names '" + name + "' again";
    }
    if (!problem.empty()) {
      ThrowAtLine(path, number, problem);
    }
    vector.image_idx = found->second;
    is_named[vector.image_idx] = true;
    vectors.push_back(vector);
  }
  return vectors;
}

}  // namespace mgsfm
