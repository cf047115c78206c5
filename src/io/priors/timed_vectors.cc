// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <map>
#include <string_view>

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "priors/position_files.h"

namespace mgsfm {
namespace {

struct TimeUnit {
  const char* key;
  double seconds;
};
constexpr std::array<TimeUnit, 4> kTimeUnits = {
    {{"time", 1.0}, {"time_ms", 1e-3}, {"time_us", 1e-6}, {"time_ns", 1e-9}}};
using ThreeKeys = std::array<const char*, 3>;
constexpr ThreeKeys kCoordinates = {"x", "y", "z"};
constexpr ThreeKeys kGeodetic = {"latitude", "longitude", "altitude"};
constexpr ThreeKeys kDeviations = {"std_x", "std_y", "std_z"};

// The columns of a CSV file by their keys.
class CsvColumns {
 public:
  // `lines` is at the line with the names.
  CsvColumns(const TextLines& lines, const std::string& columns)
      : lines_(lines) {
    std::string_view line = lines.line();
    if (!line.empty() && line.front() == '#') line.remove_prefix(1);
    const auto names = SplitCsv(line);
    if (!names) lines.Throw("has a quote that is not closed");
    for (const std::string& name : *names) {
      names_.emplace_back(TrimBlanks(name));
    }
    for (const std::string& item : SplitList(columns)) {
      const size_t equal = item.find('=');
      if (equal == std::string::npos) Throw("'" + item + "' is no KEY=COLUMN");
      const std::string key(TrimBlanks(item.substr(0, equal)));
      CheckKey(key);
      column_of_key_[key] = ColumnOf(
          std::string(TrimBlanks(std::string_view(item).substr(equal + 1))));
    }
  }

  std::optional<size_t> Find(const std::string& key) const {
    const auto found = column_of_key_.find(key);
    if (found != column_of_key_.end()) return found->second;
    const auto name = std::find(names_.begin(), names_.end(), key);
    if (name == names_.end()) return std::nullopt;
    return static_cast<size_t>(name - names_.begin());
  }

  // All of the keys, or none.
  std::vector<size_t> FindAll(const ThreeKeys& keys) const {
    std::vector<size_t> found;
    for (const char* key : keys) {
      if (const auto column = Find(key)) found.push_back(*column);
    }
    if (!found.empty() && found.size() != keys.size()) {
      Throw("only some of '" + std::string(keys[0]) + "', '" + keys[1] +
            "' and '" + keys[2] + "' have a column");
    }
    return found;
  }

  [[noreturn]] void Throw(const std::string& problem) const {
    lines_.Throw(problem +
                 "; set ref_columns to KEY=COLUMN, ...; the columns "
                 "are '" +
                 Joined(names_, "', '") + "'");
  }

 private:
  void CheckKey(const std::string& key) const {
    const bool is_time = AnyOf(
        kTimeUnits, [&](const TimeUnit& unit) { return key == unit.key; });
    if (is_time || Contains(kCoordinates, key) || Contains(kGeodetic, key) ||
        Contains(kDeviations, key)) {
      return;
    }
    Throw("'" + key +
          "' is no key; they are time, time_ms, time_us, time_ns, x, y, z, "
          "latitude, longitude, altitude, std_x, std_y and std_z");
  }
  size_t ColumnOf(const std::string& column) const {
    const auto name = std::find(names_.begin(), names_.end(), column);
    if (name != names_.end()) return static_cast<size_t>(name - names_.begin());
    const auto number = ParseDouble(column);
    for (size_t i = 0; number && i < names_.size(); ++i) {
      if (*number == static_cast<double>(i + 1)) return i;
    }
    Throw("there is no column '" + column + "'");
  }

  const TextLines& lines_;
  std::vector<std::string> names_;
  std::map<std::string, size_t> column_of_key_;
};

double NumberAt(const TextLines& lines, const std::vector<std::string>& fields,
                size_t column) {
  const std::string field = column < fields.size() ? fields[column] : "";
  const auto number = ParseDouble(TrimBlanks(field));
  if (!number) {
    lines.Throw("has '" + Printable(field) + "' in column " +
                std::to_string(column + 1) +
                " where a finite number should be; correct or delete the line");
  }
  return *number;
}

// Sorts by time. Throws Error for a repeated time.
void SortByTime(const std::string& path, std::vector<TimedVector>* vectors) {
  const auto is_earlier = [](const TimedVector& a, const TimedVector& b) {
    return a.timestamp_s < b.timestamp_s;
  };
  std::stable_sort(vectors->begin(), vectors->end(), is_earlier);
  const auto repeated = std::adjacent_find(
      vectors->begin(), vectors->end(),
      [&](const auto& a, const auto& b) { return !is_earlier(a, b); });
  if (repeated == vectors->end()) return;
  throw Error("'" + path + "' has the time " +
              FormatDouble(repeated->timestamp_s, std::chars_format::fixed, 9) +
              " s twice; delete one of the lines");
}

}  // namespace

std::vector<TimedVector> ReadTimedPositions(const std::string& path,
                                            const std::string& columns) {
  TextLines lines(path, "'" + path + "' (ref_images_path)");
  do {
    if (!lines.Next()) lines.Throw("has no line with the names of columns");
  } while (lines.line().empty());
  const CsvColumns names(lines, columns);
  std::optional<std::pair<size_t, double>> time;  // column and unit
  for (const auto& [key, seconds] : kTimeUnits) {
    const auto column = names.Find(key);
    if (!column) continue;
    if (time) names.Throw("several columns are times");
    time.emplace(*column, seconds);
  }
  std::vector<size_t> position = names.FindAll(kCoordinates);
  if (position.empty()) position = names.FindAll(kGeodetic);
  const std::vector<size_t> deviations = names.FindAll(kDeviations);
  if (!time) names.Throw("no column is the time");
  if (position.empty()) names.Throw("no columns are the position");
  std::vector<TimedVector> vectors;
  while (lines.NextContent()) {
    const auto fields = SplitCsv(lines.line());
    if (!fields) lines.Throw("has a quote that is not closed");
    TimedVector vector;
    vector.timestamp_s = time->second * NumberAt(lines, *fields, time->first);
    Eigen::Vector3d deviation;
    for (int k = 0; k < 3; ++k) {
      vector.value[k] = NumberAt(lines, *fields, position[k]);
      if (deviations.empty()) continue;
      deviation[k] = NumberAt(lines, *fields, deviations[k]);
      if (deviation[k] > 0.0) continue;
      lines.Throw("has a standard deviation that is not positive");
    }
    if (!deviations.empty()) {
      vector.covariance = deviation.cwiseAbs2().asDiagonal();
    }
    vectors.push_back(vector);
  }
  SortByTime(path, &vectors);
  return vectors;
}

bool HasTimedVectors(const Scene& scene, const std::string& path) {
  TextLines lines(path);
  if (!lines.NextContent()) return false;
  const auto numbers = ParseNumbers(lines.line());
  if (!numbers || numbers->size() != 4) return false;
  const std::string_view first = SplitWords(lines.line()).front();
  return NoneOf(scene.images,
                [&](const Image& image) { return image.name == first; });
}

std::vector<TimedVector> ReadTimedVectors(const std::string& path) {
  TextLines lines(path);
  std::vector<TimedVector> vectors;
  while (lines.NextContent()) {
    const auto numbers = ParseNumbers(lines.line());
    if (!numbers || numbers->size() != 4) {
      lines.Throw("expected 'SECONDS X Y Z'");
    }
    vectors.push_back({(*numbers)[0],
                       {(*numbers)[1], (*numbers)[2], (*numbers)[3]},
                       std::nullopt});
  }
  SortByTime(path, &vectors);
  return vectors;
}

}  // namespace mgsfm
