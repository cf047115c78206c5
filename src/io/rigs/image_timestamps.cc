// SPDX-License-Identifier: BSD-3-Clause
#include "io/rigs/image_timestamps.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/file_reading.h"
#include "base/natural_order.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "io/files/output_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr char kBlanks[] = " \t\r";

[[noreturn]] void Throw(const std::filesystem::path& path,
                        const std::string& problem) {
  throw Error("'" + path.string() + "' " + problem);
}

class TimestampReader {
 public:
  TimestampReader(const std::filesystem::path& path, OtherImages others,
                  const std::vector<std::string>& names)
      : path_(path), others_(others), names_(names), times_s_(names.size()) {
    for (size_t i = 0; i < names.size(); ++i) {
      idx_of_name_[names[i]] = static_cast<int>(i);
    }
  }

  std::vector<double> Read() {
    TextInput file(
        ReadFile(path_, "'" + path_.string() + "' (image_timestamps_path)"));
    std::string line;
    for (int number = 1; std::getline(file, line); ++number) {
      const size_t begin = line.find_first_not_of(kBlanks);
      if (begin == std::string::npos || line[begin] == '#') continue;
      line = line.substr(begin, line.find_last_not_of(kBlanks) + 1 - begin);
      TakeLine(line, "line " + std::to_string(number));
    }
    std::vector<double> times_s;
    for (size_t i = 0; i < names_.size(); ++i) {
      if (!times_s_[i]) {
        Throw(path_, "has no time for image '" + names_[i] +
                         "'; add a line 'image_name SECONDS'");
      }
      times_s.push_back(*times_s_[i]);
    }
    return times_s;
  }

 private:
  void TakeLine(const std::string& line, const std::string& where);

  const std::filesystem::path path_;
  const OtherImages others_;
  const std::vector<std::string>& names_;
  std::vector<std::optional<double>> times_s_;
  std::map<std::string, int> idx_of_name_;
};

// Names may have blanks: the last word is the time.
void TimestampReader::TakeLine(const std::string& line,
                               const std::string& where) {
  const size_t blank = line.find_last_of(kBlanks);
  if (blank == std::string::npos) {
    Throw(path_, where + " is not 'image_name SECONDS'");
  }
  const std::string word = line.substr(blank + 1);
  const std::string name =
      line.substr(0, line.find_last_not_of(kBlanks, blank) + 1);
  const std::optional<double> time_s = ParseDouble(word);
  if (!time_s) {
    Throw(path_, where + " has '" + word + "' as the time of '" + name +
                     "'; give a finite number of seconds");
  }
  const auto found = idx_of_name_.find(name);
  if (found == idx_of_name_.end()) {
    if (others_ == OtherImages::kIgnore) return;
    Throw(
        path_,
        where + " names the image '" + name +
            "', which the database does not have; delete the line, or correct "
            "the name");
  }
  std::optional<double>& known_s = times_s_[found->second];
  if (known_s) {
    Throw(path_,
          where + " names '" + name + "' again; delete one of the lines");
  }
  known_s = time_s;
}

void CheckOrder(const std::filesystem::path& path, const Scene& scene,
                int rig_idx) {
  std::vector<int> frame_idxs;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (scene.frames[i].rig_idx == rig_idx) {
      frame_idxs.push_back(static_cast<int>(i));
    }
  }
  const auto name_of = [&](int frame_idx) -> const std::string& {
    return scene.frames[frame_idx].name;
  };
  std::stable_sort(frame_idxs.begin(), frame_idxs.end(), [&](int a, int b) {
    return IsNaturallyBefore(name_of(a), name_of(b));
  });
  const auto image_name = [&](int frame_idx) {
    return "'" + scene.images[scene.frames[frame_idx].image_idxs[0]].name + "'";
  };
  for (size_t k = 1; k < frame_idxs.size(); ++k) {
    const int before = frame_idxs[k - 1], after = frame_idxs[k];
    if (TimeOfFrame(scene, before) < TimeOfFrame(scene, after)) continue;
    Throw(path,
          "has the frame of image " + image_name(after) +
              " not later than that of " + image_name(before) +
              ", which is before it by its name; correct the times, or name "
              "images in the order in which they were taken");
  }
}

}  // namespace

std::vector<double> ReadImageTimes(const std::filesystem::path& path,
                                   const std::vector<std::string>& names,
                                   OtherImages others) {
  return TimestampReader(path, others, names).Read();
}

void ReadImageTimestamps(const std::filesystem::path& path, Scene* scene,
                         OtherImages others) {
  std::vector<std::string> names;
  for (const Image& image : scene->images) names.push_back(image.name);
  const std::vector<double> times_s = ReadImageTimes(path, names, others);
  for (size_t i = 0; i < times_s.size(); ++i) {
    scene->images[i].timestamp_s = times_s[i];
  }
  for (size_t r = 0; r < scene->rigs.size(); ++r) {
    CheckOrder(path, *scene, static_cast<int>(r));
  }
}

void WriteImageTimestamps(const std::filesystem::path& path,
                          const Scene& scene) {
  std::string lines = "# image_name SECONDS\n";
  for (const Image& image : scene.images) {
    if (!image.timestamp_s) continue;
    lines += image.name + ' ' +
             FormatDouble(*image.timestamp_s, std::chars_format::fixed, 9) +
             '\n';
  }
  WriteFile(path, lines);
}

}  // namespace mgsfm
