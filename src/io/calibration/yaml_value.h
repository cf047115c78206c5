// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/yaml.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// A value of a YAML file, or of a JSON file, which is YAML, too. All functions
// throw Error, naming file, line and key, unless the value has the requested
// type.
class YamlValue {
 public:
  // Parses a file with content `text`. Accepts the header %YAML:1.0 of OpenCV.
  YamlValue(const std::string& path, std::string text);

  YamlValue(const YamlValue&) = default;
  // Assigning a node of yaml-cpp would change the file that it is part of.
  YamlValue& operator=(const YamlValue& other) {
    path_ = other.path_;
    name_ = other.name_;
    node_.reset(other.node_);
    return *this;
  }
  ~YamlValue() = default;

  bool IsMap() const { return node_.IsMap(); }
  bool IsSequence() const { return node_.IsSequence(); }
  bool Has(const std::string& key) const;

  YamlValue operator[](const std::string& key) const;
  std::optional<YamlValue> Find(const std::string& key) const;
  // The first of the keys that exists.
  std::optional<YamlValue> FindAny(const std::vector<std::string>& keys) const;
  // The values of a map or sequence; values of a sequence have no key.
  std::vector<std::pair<std::string, YamlValue>> Items() const;

  std::string Text() const;
  double Number() const;
  // The numbers of a sequence, of a sequence of sequences, or of the matrix
  // {rows, cols, data} of OpenCV.
  std::vector<double> Numbers() const;
  std::vector<double> Numbers(size_t size) const;
  // A matrix of 4 or 3 rows and 4 columns.
  Rigid3 Pose() const;
  // A positive integer, such as the width of an image.
  int Size() const;
  // [width, height]
  std::pair<int, int> ImageSize() const;

  // "'cam.yaml', line 3"
  std::string Place() const;
  [[noreturn]] void Throw(const std::string& problem) const;

 private:
  YamlValue(std::string path, std::string name, const YAML::Node& node)
      : path_(std::move(path)), name_(std::move(name)), node_(node) {}
  // Aliases can make a small file a deep or large value.
  void AppendNumbers(const YAML::Node& node, int depth,
                     std::vector<double>* numbers) const;

  std::string path_;
  std::string name_;  // its key
  YAML::Node node_;
};

}  // namespace mgsfm
