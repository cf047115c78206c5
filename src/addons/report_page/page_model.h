// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/report_page/report_page.h"
#include "report_page/statistics.h"

namespace mgsfm {

// The common input of all parts of the page.
struct PageModel {
  const ReportPageInput& input;
  const Projector& projector;
  const ModelStatistics& statistics;
  // The report of the run, and its entry for the model; empty objects if there
  // is none.
  nlohmann::ordered_json report;
  nlohmann::ordered_json model_report;
};

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

// The indices of the frames in [first name, last name].
inline std::optional<std::pair<int, int>> FrameRange(
    const nlohmann::ordered_json& names,
    const std::map<std::string, int>& frame_of_name) {
  if (!names.is_array() || names.size() != 2 || !names[0].is_string() ||
      !names[1].is_string()) {
    return std::nullopt;
  }
  const auto first = frame_of_name.find(names[0].get<std::string>());
  const auto last = frame_of_name.find(names[1].get<std::string>());
  if (first == frame_of_name.end() || last == frame_of_name.end()) {
    return std::nullopt;
  }
  return std::make_pair(first->second, last->second);
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

// "m" if the report states that the model is metric, else "units".
inline std::string LengthUnit(const PageModel& model) {
  const nlohmann::ordered_json& models =
      GetArray(Get(model.report, "summary"), "models");
  const size_t i = model.input.model_idx;
  const bool is_metric =
      i < models.size() &&
      GetText(models[i], "unit_of_length").compare(0, 6, "metric") == 0;
  return is_metric ? "m" : "units";
}

}  // namespace mgsfm
