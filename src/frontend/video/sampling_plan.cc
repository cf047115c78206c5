// SPDX-License-Identifier: BSD-3-Clause
#include "video/sampling_plan.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

int NearestTo(int64_t instant_ns, const std::vector<int64_t>& times_ns) {
  const auto after =
      std::lower_bound(times_ns.begin(), times_ns.end(), instant_ns);
  const auto idx = static_cast<int>(after - times_ns.begin());
  if (after == times_ns.begin()) return idx;
  if (after == times_ns.end()) return idx - 1;
  return instant_ns - *(after - 1) <= *after - instant_ns ? idx - 1 : idx;
}

}  // namespace

std::vector<int> SelectByRate(const std::vector<int64_t>& times_ns,
                              double rate_hz) {
  MGSFM_CHECK(rate_hz > 0.0);
  std::vector<int> selected;
  if (times_ns.empty()) return selected;
  const auto length_ns =
      static_cast<double>(times_ns.back() - times_ns.front());
  const auto num_steps = static_cast<int64_t>(length_ns * rate_hz / 1e9);
  for (int64_t k = 0; k <= num_steps; ++k) {
    const auto offset_ns = static_cast<int64_t>(
        std::llround(static_cast<double>(k) * 1e9 / rate_hz));
    const int nearest = NearestTo(times_ns.front() + offset_ns, times_ns);
    if (selected.empty() || nearest > selected.back()) {
      selected.push_back(nearest);
    }
  }
  return selected;
}

std::vector<std::optional<int>> SelectAtInstants(
    const std::vector<int64_t>& instants_ns,
    const std::vector<int64_t>& times_ns, int64_t max_difference_ns) {
  std::vector<std::optional<int>> selected(instants_ns.size());
  if (times_ns.empty()) return selected;
  const auto difference = [&](size_t i, int idx) {
    return std::abs(instants_ns[i] - times_ns[idx]);
  };
  std::optional<size_t> last;  // the last instant with an image
  for (size_t i = 0; i < instants_ns.size(); ++i) {
    const int nearest = NearestTo(instants_ns[i], times_ns);
    if (difference(i, nearest) > max_difference_ns) continue;
    if (last && selected[*last] == nearest) {
      if (difference(*last, nearest) <= difference(i, nearest)) continue;
      selected[*last].reset();
    }
    selected[i] = nearest;
    last = i;
  }
  return selected;
}

std::optional<int64_t> MedianInterval(const std::vector<int64_t>& times_ns) {
  if (times_ns.size() < 2) return std::nullopt;
  std::vector<int64_t> intervals;
  for (size_t i = 1; i < times_ns.size(); ++i) {
    intervals.push_back(times_ns[i] - times_ns[i - 1]);
  }
  return UpperMedian(intervals);
}

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr char kPlanName[] = "video_sampling.json";
constexpr int64_t kNanosecondsPerMillisecond = 1'000'000;

bool AreDistinct(const std::vector<std::string>& names) {
  return std::set<std::string>(names.begin(), names.end()).size() ==
         names.size();
}

Json ToJson(const SamplingPlan& plan) {
  Json frames = Json::array();
  for (const SampledFrame& frame : plan.frames) {
    Json times = Json::array();
    for (const auto& time_ns : frame.times_ns) {
      times.push_back(time_ns ? Json(*time_ns) : Json());
    }
    frames.push_back({{"name", frame.name}, {"times_ns", std::move(times)}});
  }
  return {{"folders", plan.folders},
          {"offsets_ns", plan.offsets_ns},
          {"frames", std::move(frames)}};
}

SamplingPlan PlanOf(const Json& json) {
  SamplingPlan plan;
  plan.folders = json.at("folders").get<std::vector<std::string>>();
  plan.offsets_ns = json.at("offsets_ns").get<std::vector<int64_t>>();
  for (const Json& item : json.at("frames")) {
    SampledFrame frame{item.at("name").get<std::string>(), {}};
    for (const Json& time : item.at("times_ns")) {
      frame.times_ns.push_back(
          time.is_null() ? std::nullopt : std::optional(time.get<int64_t>()));
    }
    plan.frames.push_back(std::move(frame));
  }
  return plan;
}

}  // namespace

std::vector<std::string> NamesOfTimes(const std::vector<int64_t>& times_ns) {
  const auto format = [&](int64_t per_unit, int num_decimals) {
    return Transformed(times_ns, [&](int64_t time_ns) {
      const int64_t units =
          (time_ns - times_ns.front() + per_unit / 2) / per_unit;
      const int64_t per_second = kNsPerSecond / per_unit;
      return Formatted("%06lld.%0*lld",
                       static_cast<long long>(units / per_second), num_decimals,
                       static_cast<long long>(units % per_second));
    });
  };
  std::vector<std::string> names = format(kNanosecondsPerMillisecond, 3);
  return AreDistinct(names) ? names : format(1, 9);
}

std::vector<std::string> FoldersOfVideos(const std::vector<fs::path>& paths) {
  std::vector<std::string> stems, folders;
  for (const fs::path& path : paths) {
    stems.push_back(path.stem());
    folders.push_back(fs::absolute(path).parent_path().filename());
  }
  if (AreDistinct(stems)) return stems;
  if (AreDistinct(folders)) return folders;
  throw Error("videos '" + paths.front().string() +
              "' and others have equal names; name each after its camera, such "
              "as front.mp4 and left.mp4");
}

std::optional<SamplingPlan> ReadPlan(const fs::path& output_path,
                                     const std::string& settings) {
  const fs::path path = output_path / kPlanName;
  const bool is_continued = fs::is_regular_file(path);
  if (is_continued) {
    try {
      const Json json = Json::parse(ReadFile(path));
      if (json.at("settings") == Json::parse(settings)) {
        return PlanOf(json.at("plan"));
      }
    } catch (const nlohmann::json::exception&) {
      throw Error("'" + path.string() +
                  "' is damaged; remove it and the images beside it");
    }
  }
  const fs::path images = output_path / "images";
  if (fs::is_directory(images) && !fs::is_empty(images)) {
    throw Error("'" + images.string() + "' holds images " +
                (is_continued ? "of other videos or settings"
                              : "that this program did not write") +
                "; remove them or choose another folder");
  }
  return std::nullopt;
}

void WritePlan(const fs::path& output_path, const std::string& settings,
               const SamplingPlan& plan) {
  fs::create_directories(output_path);
  const Json json = {{"settings", Json::parse(settings)},
                     {"plan", ToJson(plan)}};
  ReplaceFile(output_path / kPlanName, json.dump(1) + "\n");
}

}  // namespace mgsfm
