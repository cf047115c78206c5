// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/report_page/report_page.h"
#include "report_page/statistics.h"

namespace mgsfm {

// The common input of all parts of the page.
struct PageModel {
  const ReportPageInput& input;
  Projector projector;
  ModelStatistics statistics;
  // The report of the run, and its entry for the model; empty objects if there
  // is none.
  nlohmann::ordered_json report;
  nlohmann::ordered_json model_report;
};

// Warns, and returns an empty object, if the text is none.
nlohmann::ordered_json ParseReport(const std::string& text,
                                   const Context& context);

PageModel MakePageModel(const ReportPageInput& input,
                        nlohmann::ordered_json report, const Context& context);

// The value of a key of an object, else null. Reports may be of other versions,
// so every value may be missing or have another type.
inline const nlohmann::ordered_json& Get(const nlohmann::ordered_json& object,
                                         const char* key) {
  static const nlohmann::ordered_json kNull;
  if (!object.is_object()) return kNull;
  const auto found = object.find(key);
  return found == object.end() ? kNull : *found;
}

// An empty array if the value is none.
inline const nlohmann::ordered_json& GetArray(
    const nlohmann::ordered_json& object, const char* key) {
  static const nlohmann::ordered_json kEmpty = nlohmann::ordered_json::array();
  const nlohmann::ordered_json& value = Get(object, key);
  return value.is_array() ? value : kEmpty;
}

inline std::string GetText(const nlohmann::ordered_json& object,
                           const char* key) {
  const nlohmann::ordered_json& value = Get(object, key);
  return value.is_string() ? value.get<std::string>() : "";
}

inline std::optional<double> GetNumber(const nlohmann::ordered_json& object,
                                       const char* key) {
  const nlohmann::ordered_json& value = Get(object, key);
  if (!value.is_number()) return std::nullopt;
  return value.get<double>();
}

std::map<std::string, int> FramesByName(const Scene& scene);

// The indices of the frames in [first name, last name].
std::optional<std::pair<int, int>> FrameRange(
    const nlohmann::ordered_json& names,
    const std::map<std::string, int>& frame_of_name);

// "m" if the report states that the model is metric, else "units".
std::string LengthUnit(const PageModel& model);

// The places of the seams of the report as pairs of frames [before, after].
// Each side of a seam consists of stretches of frames, and a seam lies where
// stretches of different sides follow each other.
std::set<std::pair<int, int>> SeamPlaces(const PageModel& model);

}  // namespace mgsfm
