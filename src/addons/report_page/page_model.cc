// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/page_model.h"

#include "mgsfm/base/error.h"
#include "mgsfm/base/version.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

void WarnOfNewerVersion(const std::string& version, const Context& context) {
  try {
    if (version.empty() || !IsNewerVersion(version)) return;
    context.Warning("the report of the run was written by mgsfm " + version +
                    ", which is newer than this " + Version() +
                    "; what has changed is missing in the page");
  } catch (const Error& error) {
    context.Warning(std::string("the report of the run: ") + error.what());
  }
}

}  // namespace

nlohmann::ordered_json ParseReport(const std::string& text,
                                   const Context& context) {
  if (text.empty()) return Json::object();
  Json report = Json::parse(text, nullptr, false);
  if (!report.is_object()) {
    context.Warning(
        "the report of the run is not a JSON object; it is ignored");
    return Json::object();
  }
  WarnOfNewerVersion(GetText(report, "mgsfm_version"), context);
  return report;
}

PageModel MakePageModel(const ReportPageInput& input,
                        nlohmann::ordered_json report, const Context& context) {
  Projector projector(input.scene, input.reconstruction);
  ModelStatistics statistics =
      ComputeStatistics(input.scene, input.reconstruction, projector, context);
  const Json& models = GetArray(report, "models");
  Json entry = input.model_idx < models.size() ? models[input.model_idx]
                                               : Json::object();
  return {input, std::move(projector), std::move(statistics), std::move(report),
          std::move(entry)};
}

std::map<std::string, int> FramesByName(const Scene& scene) {
  std::map<std::string, int> frame_of_name;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    frame_of_name[scene.frames[i].name] = static_cast<int>(i);
  }
  return frame_of_name;
}

std::optional<std::pair<int, int>> FrameRange(
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

std::string LengthUnit(const PageModel& model) {
  const nlohmann::ordered_json& models =
      GetArray(Get(model.report, "summary"), "models");
  const size_t i = model.input.model_idx;
  const bool is_metric =
      i < models.size() &&
      GetText(models[i], "unit_of_length").compare(0, 6, "metric") == 0;
  return is_metric ? "m" : "units";
}

std::set<std::pair<int, int>> SeamPlaces(const PageModel& model) {
  const auto frame_of_name = FramesByName(model.input.scene);
  std::set<std::pair<int, int>> places;
  for (const Json& seam : GetArray(model.model_report, "seams")) {
    std::map<int, std::pair<int, const char*>> stretches;  // by first frame
    for (const char* side : {"frames_before", "frames_after"}) {
      for (const Json& names : GetArray(seam, side)) {
        const auto range = FrameRange(names, frame_of_name);
        if (range) stretches[range->first] = {range->second, side};
      }
    }
    const std::pair<int, const char*>* last = nullptr;
    for (const auto& [first, stretch] : stretches) {
      if (last && last->second != stretch.second) {
        places.emplace(last->first, first);
      }
      last = &stretch;
    }
  }
  return places;
}

}  // namespace mgsfm
