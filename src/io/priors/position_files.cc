// SPDX-License-Identifier: BSD-3-Clause
#include "priors/position_files.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <string_view>

#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "priors/timed_samples.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

using Poses = std::vector<std::pair<int, Rigid3>>;

// The image of the reference sensor, or else the first image.
int MainImage(const Scene& scene, const Frame& frame) {
  for (const int image_idx : frame.image_idxs) {
    if (scene.IsReference(scene.images[image_idx].sensor_idx)) return image_idx;
  }
  return frame.image_idxs.front();
}

Poses PosesByFrame(const Scene& scene, const std::string& path) {
  const std::vector<Rigid3> poses = ReadKittiPoses(path);
  if (poses.size() != scene.frames.size()) {
    throw Error("'" + path + "' has " + std::to_string(poses.size()) +
                " poses, but there are " + std::to_string(scene.frames.size()) +
                " frames; give one line of 12 numbers for each frame");
  }
  const std::vector<int> order = OrderOfFrames(scene);
  Poses of_frames;
  for (size_t i = 0; i < order.size(); ++i) {
    of_frames.emplace_back(order[i], poses[i]);
  }
  return of_frames;
}

double TimeOf(const Image& image, const std::string& path) {
  if (image.timestamp_s) return *image.timestamp_s;
  if (const auto time_ns = TimeInName(image.name)) {
    return 1e-9 * static_cast<double>(*time_ns);
  }
  throw Error("'" + path + "' has poses by time, but image '" + image.name +
              "' has no time in its name; set image_timestamps_path");
}

// Calls `use` with each frame, its main image and its place in the samples.
template <class Sample, class Use>
void ForEachFrame(const Scene& scene, const std::string& path,
                  const std::vector<Sample>& samples, double clock_offset_s,
                  const Use& use) {
  const double max_gap_s = MaxGapSeconds(samples);
  bool has_any = false;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const int image_idx = MainImage(scene, scene.frames[i]);
    const double time_s =
        TimeOf(scene.images[image_idx], path) + clock_offset_s;
    const auto place = FindBetween(samples, max_gap_s, time_s);
    if (!place) continue;
    has_any = true;
    use(static_cast<int>(i), image_idx, *place);
  }
  if (has_any) return;
  const std::string times =
      samples.empty()
          ? ""
          : Formatted(", which are %.3f to %.3f s", samples.front().timestamp_s,
                      samples.back().timestamp_s);
  throw Error("'" + path + "' has no value at the time of any image" + times +
              "; give both on one clock, for instance with "
              "image_timestamps_path or prior_clock_offset_s");
}

Poses PosesByTime(const Scene& scene, const std::string& path,
                  const std::vector<TimedPose>& poses, double clock_offset_s) {
  Poses of_frames;
  ForEachFrame(scene, path, poses, clock_offset_s,
               [&](int frame_idx, int /*image_idx*/, const auto& place) {
                 of_frames.emplace_back(frame_idx, Interpolate(place));
               });
  return of_frames;
}

bool IsEurocLine(std::string_view line) {
  const std::vector<std::string> fields = SplitFields(line, ',');
  // Its times are whole nanoseconds.
  return fields.size() >= 8 &&
         fields[0].find_first_not_of("0123456789") == std::string::npos &&
         std::all_of(fields.begin(), fields.end(), [](const auto& field) {
           return ParseDouble(field).has_value();
         });
}

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

std::vector<NamedVector> ReadNamedVectors(const Scene& scene,
                                          const std::string& path,
                                          const std::string& columns,
                                          const std::string& option,
                                          UnknownImages others) {
  const auto idx_of_name = IndexByName(scene.images);
  TextLines lines(path, "'" + path + "' (" + option + ")");
  std::vector<NamedVector> vectors;
  Mask is_named(scene.images.size(), false);
  while (lines.NextContent()) {
    const auto split = SplitNamedWords(lines.line(), 3);
    if (!split) lines.Throw("expected 'image_name " + columns + "'");
    const std::string& name = split->name;
    NamedVector vector;
    vector.line_number = lines.number();
    for (int k = 0; k < 3; ++k) vector.value[k] = lines.Number(split->words[k]);
    const auto found = idx_of_name.find(name);
    if (found == idx_of_name.end()) {
      if (others == UnknownImages::kIgnore) continue;
      lines.Throw("names the image '" + name +
                  "', which the database does not have; delete the line, or "
                  "correct the name");
    }
    vector.image_idx = found->second;
    if (is_named[vector.image_idx]) {
      lines.Throw("names '" + name + "' again; delete one of the lines");
    }
    is_named[vector.image_idx] = true;
    vectors.push_back(vector);
  }
  return vectors;
}

PositionFileFormat DetectPositionFormat(const std::string& path) {
  TextLines lines(path, "'" + path + "' (ref_images_path)");
  if (lines.NextContent()) {
    const auto numbers = ParseNumbers(lines.line());
    const size_t num_numbers = numbers ? numbers->size() : 0;
    if (num_numbers == 12) return PositionFileFormat::kKitti;
    if (num_numbers == 8) return PositionFileFormat::kTum;
    if (IsEurocLine(lines.line())) return PositionFileFormat::kEuroc;
  }
  if (std::filesystem::path(path).extension() == ".csv") {
    return PositionFileFormat::kCsv;
  }
  return PositionFileFormat::kNamed;
}

Poses ReadTrajectoryPoses(const Scene& scene, const std::string& path,
                          PositionFileFormat format, double clock_offset_s) {
  if (format == PositionFileFormat::kKitti) return PosesByFrame(scene, path);
  const bool is_tum = format == PositionFileFormat::kTum;
  MGSFM_CHECK(is_tum || format == PositionFileFormat::kEuroc);
  return PosesByTime(scene, path,
                     is_tum ? ReadTumPoses(path) : ReadEurocPoses(path),
                     clock_offset_s);
}

std::vector<std::pair<int, TimedVector>> InterpolateVectors(
    const Scene& scene, const std::string& path,
    const std::vector<TimedVector>& vectors, double clock_offset_s) {
  std::vector<std::pair<int, TimedVector>> of_images;
  ForEachFrame(scene, path, vectors, clock_offset_s,
               [&](int /*frame_idx*/, int image_idx, const auto& place) {
                 of_images.emplace_back(image_idx, Interpolate(place));
               });
  return of_images;
}

std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format,
    double clock_offset_s) {
  std::vector<std::pair<int, Eigen::Vector3d>> positions;
  for (const auto& [frame_idx, pose] :
       ReadTrajectoryPoses(scene, path, format, clock_offset_s)) {
    positions.emplace_back(MainImage(scene, scene.frames[frame_idx]),
                           pose.Center());
  }
  return positions;
}

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
