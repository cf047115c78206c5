// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/yaml_value.h"

#include <cmath>
#include <set>

#include "base/text.h"
#include "files/image_reading.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// A matrix is a list of rows and at most 4 x 4; lenses have fewer parameters.
constexpr int kMaxDepth = 3;
constexpr size_t kMaxNumNumbers = 64;

std::string PlaceOf(const std::string& path, const YAML::Mark& mark) {
  const std::string file = "'" + path + "'";
  return mark.is_null() ? file
                        : file + ", line " + std::to_string(mark.line + 1);
}

}  // namespace

YamlValue::YamlValue(const std::string& path, std::string text) : path_(path) {
  // OpenCV writes %YAML:1.0 where YAML has %YAML 1.0.
  if (text.compare(0, 6, "%YAML:") == 0) text[0] = '#';
  try {
    node_.reset(YAML::Load(text));
  } catch (const YAML::Exception& error) {
    throw Error(PlaceOf(path, error.mark) + ": not valid YAML or JSON: " +
                Printable(error.msg) + "; correct the line");
  }
}

std::string YamlValue::Place() const { return PlaceOf(path_, node_.Mark()); }

void YamlValue::Throw(const std::string& problem) const {
  throw Error(Place() + ": " +
              (name_.empty() ? "" : "'" + Printable(name_) + "' ") + problem);
}

bool YamlValue::Has(const std::string& key) const {
  return Find(key).has_value();
}

std::optional<YamlValue> YamlValue::Find(const std::string& key) const {
  if (!node_.IsMap()) return std::nullopt;
  std::optional<YamlValue> found;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar() || entry.first.Scalar() != key ||
        entry.second.IsNull()) {
      continue;
    }
    if (found) {
      YamlValue(path_, key, entry.second).Throw("is there twice; remove one");
    }
    found = YamlValue(path_, key, entry.second);
  }
  return found;
}

std::optional<YamlValue> YamlValue::FindAny(
    const std::vector<std::string>& keys) const {
  for (const std::string& key : keys) {
    if (auto value = Find(key)) return value;
  }
  return std::nullopt;
}

YamlValue YamlValue::operator[](const std::string& key) const {
  if (auto value = Find(key)) return *std::move(value);
  Throw("lacks the key '" + key + "'; add it");
}

std::vector<std::pair<std::string, YamlValue>> YamlValue::Items() const {
  std::vector<std::pair<std::string, YamlValue>> items;
  std::set<std::string> keys;
  for (const auto& entry : node_) {
    if (node_.IsSequence()) {
      items.emplace_back("", YamlValue(path_, name_, entry));
    } else if (entry.first.IsScalar()) {
      const std::string& key = entry.first.Scalar();
      items.emplace_back(key, YamlValue(path_, key, entry.second));
      if (!keys.insert(key).second) {
        items.back().second.Throw("is there twice; remove one");
      }
    }
  }
  return items;
}

std::string YamlValue::Text() const {
  if (!node_.IsScalar()) Throw("is not a text; give one");
  if (const auto problem = WhyUnusable(node_.Scalar())) {
    Throw(*problem + "; give a text in UTF-8");
  }
  return node_.Scalar();
}

double YamlValue::Number() const {
  std::vector<double> numbers;
  AppendNumbers(node_, 0, &numbers);
  if (numbers.size() != 1) Throw("is not a number; give one");
  return numbers[0];
}

void YamlValue::AppendNumbers(const YAML::Node& node, int depth,
                              std::vector<double>* numbers) const {
  if (depth > kMaxDepth || numbers->size() > kMaxNumNumbers) {
    Throw("is not a vector or matrix of at most " +
          std::to_string(kMaxNumNumbers) + " numbers");
  }
  if (node.IsSequence()) {
    for (const auto& item : node) AppendNumbers(item, depth + 1, numbers);
    return;
  }
  const YamlValue value(path_, name_, node);
  if (!node.IsScalar()) value.Throw("is not a list of numbers; give one");
  const std::string& word = node.Scalar();
  const auto number =
      ParseDouble(!word.empty() && word[0] == '+' ? word.substr(1) : word);
  if (!number) {
    value.Throw("has '" + Printable(word) +
                "' where a finite number should be; correct it");
  }
  numbers->push_back(*number);
}

std::vector<double> YamlValue::Numbers() const {
  std::vector<double> numbers;
  if (const auto data = Find("data")) {
    AppendNumbers(data->node_, 0, &numbers);
    const auto rows = Find("rows"), cols = Find("cols");
    if (rows && cols &&
        rows->Number() * cols->Number() !=
            static_cast<double>(numbers.size())) {
      Throw("has " + std::to_string(numbers.size()) + " numbers; give " +
            std::to_string(std::lround(rows->Number() * cols->Number())) +
            ", the product of rows and cols");
    }
  } else {
    AppendNumbers(node_, 0, &numbers);
  }
  return numbers;
}

std::vector<double> YamlValue::Numbers(size_t size) const {
  std::vector<double> numbers = Numbers();
  if (numbers.size() != size) {
    Throw("has " + std::to_string(numbers.size()) + " numbers; give " +
          std::to_string(size));
  }
  return numbers;
}

Rigid3 YamlValue::Pose() const {
  const std::vector<double> numbers = Numbers();
  if (numbers.size() != 12 && numbers.size() != 16) {
    Throw("has " + std::to_string(numbers.size()) +
          " numbers; give a matrix of 4 rows and 4 columns");
  }
  const auto pose = RigidFromNumbers(numbers);
  if (!pose) {
    Throw(
        "is not a rigid transform, that is, a rotation, a translation and, in "
        "a fourth row, 0 0 0 1; correct it");
  }
  return *pose;
}

int YamlValue::Size() const {
  const double size = Number();
  if (!(size >= 1.0 && size <= kMaxImageSide_px) ||
      size != static_cast<int>(size)) {
    Throw("is not a size in pixels; give a positive integer");
  }
  return static_cast<int>(size);
}

std::pair<int, int> YamlValue::ImageSize() const {
  const auto sides = Items();
  if (!IsSequence() || sides.size() != 2) {
    Throw("is not the size of an image; give [width, height]");
  }
  return {sides[0].second.Size(), sides[1].second.Size()};
}

}  // namespace mgsfm
