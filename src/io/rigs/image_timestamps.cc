// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/image_timestamps.h"

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/natural_order.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "files/output_file.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "rigs/image_name_times.h"

namespace mgsfm {
namespace {

[[noreturn]] void Throw(const std::filesystem::path& path,
                        const std::string& problem) {
  throw Error("'" + path.string() + "' " + problem);
}

class TimestampReader {
 public:
  TimestampReader(const std::filesystem::path& path, OtherImages others,
                  const std::vector<std::string>& names)
      : lines_(path, "'" + path.string() + "' (image_timestamps_path)"),
        others_(others),
        times_s_(names.size()) {
    for (size_t i = 0; i < names.size(); ++i) {
      idx_of_name_[names[i]] = static_cast<int>(i);
    }
  }

  // Per image.
  std::vector<std::optional<double>> Read() {
    while (lines_.NextContent()) TakeLine();
    return times_s_;
  }

 private:
  void TakeLine();
  double TimeOf(const NamedWords& line) const;

  TextLines lines_;
  const OtherImages others_;
  std::vector<std::optional<double>> times_s_;
  std::map<std::string, int> idx_of_name_;
};

double TimestampReader::TimeOf(const NamedWords& line) const {
  const std::string_view word = line.words.front();
  const std::optional<double> time_s = ParseDouble(word);
  if (!time_s) {
    lines_.Throw("has '" + Printable(word) + "' as the time of '" + line.name +
                 "'; give a finite number of seconds");
  }
  if (const auto problem = WhyNoTime(*time_s)) {
    lines_.Throw("has '" + Printable(word) + "' as the time of '" + line.name +
                 "', which " + *problem);
  }
  return *time_s;
}

// Names may have blanks: the last word is the time.
void TimestampReader::TakeLine() {
  const auto line = SplitNamedWords(lines_.line(), 1);
  if (!line) lines_.Throw("expected 'image_name SECONDS'");
  const double time_s = TimeOf(*line);
  const auto found = idx_of_name_.find(line->name);
  if (found == idx_of_name_.end()) {
    if (others_ == OtherImages::kIgnore) return;
    lines_.Throw(
        "names the image '" + line->name +
        "', which the database does not have; delete the line, or correct the "
        "name");
  }
  std::optional<double>& known_s = times_s_[found->second];
  if (known_s) {
    lines_.Throw("names '" + line->name + "' again; delete one of the lines");
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

// The median time between frames; nullopt if there is one frame only.
std::optional<double> FrameInterval(const Scene& scene) {
  std::vector<double> times_s, intervals_s;
  for (const Frame& frame : scene.frames) {
    double first_s = std::numeric_limits<double>::infinity();
    for (const int image_idx : frame.image_idxs) {
      first_s = std::min(first_s, *scene.images[image_idx].timestamp_s);
    }
    times_s.push_back(first_s);
  }
  std::sort(times_s.begin(), times_s.end());
  for (size_t i = 1; i < times_s.size(); ++i) {
    intervals_s.push_back(times_s[i] - times_s[i - 1]);
  }
  if (intervals_s.empty()) return std::nullopt;
  return Median(std::move(intervals_s));
}

// Throws Error if the images of frames are farther apart than frames are.
void CheckFrameTimes(const std::filesystem::path& path, const Scene& scene) {
  std::vector<double> spreads_s;
  int widest_idx = -1;
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    double first_s = std::numeric_limits<double>::infinity(), last_s = -first_s;
    for (const int image_idx : scene.frames[f].image_idxs) {
      first_s = std::min(first_s, *scene.images[image_idx].timestamp_s);
      last_s = std::max(last_s, *scene.images[image_idx].timestamp_s);
    }
    if (widest_idx < 0 || last_s - first_s > spreads_s[widest_idx]) {
      widest_idx = static_cast<int>(f);
    }
    spreads_s.push_back(last_s - first_s);
  }
  const std::optional<double> interval_s = FrameInterval(scene);
  const double spread_s = Median(spreads_s);
  if (!interval_s || spread_s <= *interval_s) return;
  const auto text = [](double value_s) {
    return FormatDouble(value_s, std::chars_format::general, 4) + " s";
  };
  Throw(path, "has times of the images of one frame that differ by " +
                  text(spread_s) + " in the median, more than the " +
                  text(*interval_s) +
                  " between frames, such as in the frame '" +
                  scene.frames[widest_idx].name +
                  "'; correct the times, or pair images by time with "
                  "frame_max_time_difference_s");
}

}  // namespace

std::vector<double> ReadImageTimes(const std::filesystem::path& path,
                                   const std::vector<std::string>& names,
                                   OtherImages others) {
  std::vector<double> times_s;
  for (const auto& time_s : TimestampReader(path, others, names).Read()) {
    if (!time_s) {
      Throw(path, "has no time for image '" + names[times_s.size()] +
                      "'; add a line 'image_name SECONDS'");
    }
    times_s.push_back(*time_s);
  }
  return times_s;
}

void CheckImageTimes(const std::filesystem::path& path,
                     const std::vector<std::string>& names) {
  (void)TimestampReader(path, OtherImages::kReject, names).Read();
}

std::optional<std::string> WhyTimesAreNotSeconds(
    const std::filesystem::path& path, const Scene& scene) {
  const double interval_s = FrameInterval(scene).value_or(0.0);
  // Faster than 100 Hz in these units, or slower than 0.1 Hz in seconds.
  constexpr double kMaxInterval = 0.01;
  for (const auto& [unit, per_second] :
       {std::pair("nanoseconds", 1e9), std::pair("microseconds", 1e6),
        std::pair("milliseconds", 1e3)}) {
    if (interval_s <= kMaxInterval * per_second) continue;
    return "'" + path.string() + "': frames are " +
           FormatDouble(interval_s, std::chars_format::general, 4) +
           " s apart in the median; if the times are in " + unit +
           ", give seconds";
  }
  return std::nullopt;
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
  CheckFrameTimes(path, *scene);
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
