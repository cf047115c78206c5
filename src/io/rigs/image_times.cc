// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/image_times.h"

#include <re2/re2.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>

#include "base/nanoseconds.h"
#include "base/natural_order.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "files/file_operations.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

constexpr size_t kMaxFractionDigits = 9;  // nanoseconds

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

int64_t ToInt(std::string_view digits) {
  int64_t value = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return value;
}

// "25" is 0.25 s.
int64_t FractionNs(std::string_view digits) {
  int64_t value = ToInt(digits);
  for (size_t i = digits.size(); i < kMaxFractionDigits; ++i) value *= 10;
  return value;
}

// The digits that start at `begin`.
std::string_view DigitsAt(std::string_view text, size_t begin) {
  size_t end = begin;
  while (end < text.size() && IsDigit(text[end])) ++end;
  return text.substr(begin, end - begin);
}

// The decimals after the separator at `begin`; empty if there are none.
std::string_view DecimalsAt(std::string_view text, size_t begin) {
  if (begin >= text.size()) return {};
  const std::string_view digits = DigitsAt(text, begin + 1);
  const size_t size = digits.size();
  if (size > kMaxFractionDigits) return {};
  const bool fits = text[begin] == '.' ||
                    (text[begin] == '_' && size % 3 == 0) ||
                    (text[begin] == '-' && size == kMaxFractionDigits);
  return fits ? digits : std::string_view();
}

// Whether a number follows that may be a fraction without leading zeros, or a
// counter: ROS's tools write 5 ns after second 7 as 7-5.
bool IsFollowedByNumber(std::string_view text, size_t begin) {
  return begin < text.size() && (text[begin] == '_' || text[begin] == '-') &&
         !DigitsAt(text, begin + 1).empty();
}

// Nanoseconds per unit of a UNIX time; nullopt if it is not a UNIX time.
std::optional<int64_t> UnitOfUnixTime(std::string_view digits) {
  constexpr int64_t kFirst = 100'000'000;             // 1973, in seconds
  constexpr int64_t kFirstOfSeconds = 1'000'000'000;  // 2001; 123456789 is none
  constexpr int64_t kLast = 4'200'000'000;            // 2103
  if (digits.size() > 19 || digits.front() == '0') return std::nullopt;
  const int64_t value = ToInt(digits);
  for (int64_t per_second = 1; per_second <= kNsPerSecond; per_second *= 1000) {
    const int64_t first =
        per_second == 1 ? kFirstOfSeconds : kFirst * per_second;
    if (value >= first && value < kLast * per_second) {
      return kNsPerSecond / per_second;
    }
  }
  return std::nullopt;
}

std::optional<int64_t> FindUnixTime(std::string_view stem) {
  std::optional<int64_t> time_ns;
  for (size_t i = 0; i < stem.size(); ++i) {
    if (!IsDigit(stem[i])) continue;
    const std::string_view digits = DigitsAt(stem, i);
    i += digits.size();
    const std::optional<int64_t> unit_ns = UnitOfUnixTime(digits);
    if (!unit_ns) continue;
    time_ns = ToInt(digits) * *unit_ns;
    if (*unit_ns != kNsPerSecond) continue;
    const std::string_view decimals = DecimalsAt(stem, i);
    if (decimals.empty() && IsFollowedByNumber(stem, i)) return std::nullopt;
    if (decimals.empty()) continue;
    *time_ns += FractionNs(decimals);
    i += decimals.size();
  }
  return time_ns;
}

// Days since 1970-01-01 of the Gregorian calendar, whose leap days come at the
// end of years that start in March.
int64_t DaysSince1970(int64_t year, int64_t month, int64_t day) {
  const int64_t y = month <= 2 ? year - 1 : year;
  const int64_t month_from_march = (month + 9) % 12;
  const int64_t day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
  return 365 * y + y / 4 - y / 100 + y / 400 + day_of_year - 719468;
}

std::optional<int64_t> FindDate(const std::string& stem) {
  static const RE2 kPattern(
      R"((?:^|\D)((?:19|20)\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d))"
      R"([-_T .]?([0-2]\d)[-_:.]?([0-5]\d)[-_:.]?([0-5]\d))"
      R"((?:[._]?(\d{3}|\d{6}|\d{9})|\.(\d{1,9}))?(?:\D|$))");
  int64_t year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
  std::string fraction, decimals;
  const auto decimal = [](int64_t* value) { return RE2::Arg(value); };
  if (!RE2::PartialMatch(stem, kPattern, decimal(&year), decimal(&month),
                         decimal(&day), decimal(&hour), decimal(&minute),
                         decimal(&second), &fraction, &decimals)) {
    return std::nullopt;
  }
  if (month < 1 || month > 12 || day < 1 || day > 31 || hour > 23) {
    return std::nullopt;
  }
  const int64_t days = DaysSince1970(year, month, day);
  const int64_t seconds = ((days * 24 + hour) * 60 + minute) * 60 + second;
  return seconds * kNsPerSecond + FractionNs(fraction + decimals);
}

std::optional<int64_t> FindSeconds(const std::string& stem) {
  static const RE2 kPattern(R"((\d{1,9})\.(\d{3,9}))");
  std::string whole, decimals;
  if (!RE2::FullMatch(stem, kPattern, &whole, &decimals)) return std::nullopt;
  return ToInt(whole) * kNsPerSecond + FractionNs(decimals);
}

[[noreturn]] void Throw(const std::filesystem::path& path,
                        const std::string& problem) {
  throw Error("'" + path.string() + "' " + problem);
}

// The time of each image that the file names.
std::vector<std::optional<double>> ReadTimes(
    const std::filesystem::path& path, const std::vector<std::string>& names,
    UnknownImages others) {
  TextLines lines(path, "'" + path.string() + "' (image_timestamps_path)");
  std::map<std::string, size_t> idx_of_name;
  for (size_t i = 0; i < names.size(); ++i) idx_of_name[names[i]] = i;
  std::vector<std::optional<double>> times_s(names.size());
  while (lines.NextContent()) {
    // Names may have blanks: the last word is the time.
    const auto line = SplitNamedWords(lines.line(), 1);
    if (!line) lines.Throw("expected 'image_name SECONDS'");
    const std::string_view word = line->words.front();
    const std::string text =
        "has '" + Printable(word) + "' as the time of '" + line->name + "'";
    const std::optional<double> time_s = ParseDouble(word);
    if (!time_s) lines.Throw(text + "; give a finite number of seconds");
    if (const auto problem = WhyNoTime(*time_s)) {
      lines.Throw(text + ", which " + *problem);
    }
    const auto found = idx_of_name.find(line->name);
    if (found == idx_of_name.end()) {
      if (others == UnknownImages::kIgnore) continue;
      lines.Throw("names the image '" + line->name +
                  "', which the database does not have; delete the line, or "
                  "correct the name");
    }
    std::optional<double>& known_s = times_s[found->second];
    if (known_s) {
      lines.Throw("names '" + line->name + "' again; delete one of the lines");
    }
    known_s = time_s;
  }
  return times_s;
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

// The times of the first and the last image of a frame, which has images.
std::pair<double, double> TimesOf(const Scene& scene, const Frame& frame) {
  const auto [first, last] = std::minmax_element(
      frame.image_idxs.begin(), frame.image_idxs.end(), [&](int a, int b) {
        return *scene.images[a].timestamp_s < *scene.images[b].timestamp_s;
      });
  return {*scene.images[*first].timestamp_s, *scene.images[*last].timestamp_s};
}

// The median time between frames; nullopt if there is one frame only.
std::optional<double> FrameInterval(const Scene& scene) {
  std::vector<double> times_s;
  for (const Frame& frame : scene.frames) {
    times_s.push_back(TimesOf(scene, frame).first);
  }
  std::sort(times_s.begin(), times_s.end());
  return MedianDifference(times_s);
}

// Throws Error if images within frames are farther apart than frames are.
void CheckFrameTimes(const std::filesystem::path& path, const Scene& scene) {
  std::vector<double> spreads_s;
  int widest_idx = -1;
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    const auto [first_s, last_s] = TimesOf(scene, scene.frames[f]);
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

std::optional<int64_t> TimeInName(const std::string& image_name) {
  const std::string stem = SplitPath(WithoutExtension(image_name)).back();
  if (const auto time_ns = FindUnixTime(stem)) return time_ns;
  if (const auto time_ns = FindDate(stem)) return time_ns;
  return FindSeconds(stem);
}

std::optional<std::string> WhyNoTime(double time_s) {
  // UNIX times in milliseconds exceed this bound. Nanoseconds up to it fit into
  // 64 bits.
  constexpr double kMaxTime_s = 7.3e9;
  if (std::abs(time_s) < kMaxTime_s) return std::nullopt;
  return "is beyond the year 2200; give times in seconds";
}

std::optional<int64_t> TimeOrNumberInStem(const std::string& stem) {
  // The function expects an extension.
  if (const auto time_ns = TimeInName(stem + ".image")) return time_ns;
  if (stem.find_first_not_of("0123456789.") != std::string::npos) {
    return std::nullopt;
  }
  const std::optional<double> time_s = ParseDouble(stem);
  // Larger numbers do not fit into 64 bits of nanoseconds.
  if (!time_s || *time_s >= 9e9) return std::nullopt;
  return std::llround(*time_s * kNsPerSecond);
}

std::vector<double> ReadImageTimes(const std::filesystem::path& path,
                                   const std::vector<std::string>& names,
                                   UnknownImages others) {
  std::vector<double> times_s;
  for (const auto& time_s : ReadTimes(path, names, others)) {
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
  (void)ReadTimes(path, names, UnknownImages::kReject);
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
                         UnknownImages others) {
  const std::vector<double> times_s =
      ReadImageTimes(path, Transformed(scene->images, &Image::name), others);
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
