// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/report_page.h"

#include <algorithm>

#include "mgsfm/base/error.h"
#include "mgsfm/base/version.h"
#include "report_page/encoding.h"
#include "report_page/page_asset.h"
#include "report_page/page_model.h"
#include "report_page/scene_data.h"
#include "report_page/sections.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

// Replaces the marks of the template, each of which occurs once, in order.
std::string FillTemplate(
    std::string_view page,
    const std::vector<std::pair<std::string, std::string>>& contents) {
  std::string filled;
  size_t begin = 0;
  for (const auto& [mark, content] : contents) {
    const size_t at = page.find(mark, begin);
    MGSFM_CHECK(at != std::string_view::npos);
    filled += page.substr(begin, at - begin);
    filled += content;
    begin = at + mark.size();
  }
  filled += page.substr(begin);
  return filled;
}

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

Json ParseReport(const std::string& text, const Context& context) {
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

Json ModelEntry(const Json& report, size_t model_idx) {
  const Json& models = Get(report, "models");
  if (!models.is_array() || model_idx >= models.size()) return Json::object();
  return models[model_idx];
}

// Sources of scripts and data that the page may use, besides itself.
constexpr char kNowhere[] = "";
constexpr char kItsServer[] = "; connect-src 'self'";
constexpr char kItsFolder[] = " 'self' file:";

// The parts of a page, which fill the template or are sent one by one.
struct PageParts {
  std::string summary;
  std::string details;
  SceneData data;
};

PageParts MakeParts(const ReportPageInput& input, size_t num_used_bytes,
                    const ReportPageOptions& options, const Context& context) {
  const Projector projector(input.scene, input.reconstruction);
  const ModelStatistics statistics =
      ComputeStatistics(input.scene, input.reconstruction, projector, context);
  PageModel model{input, projector, statistics,
                  ParseReport(input.report_json, context), Json::object()};
  model.model_report = ModelEntry(model.report, input.model_idx);
  PageParts parts{SummarySection(model), DetailSections(model), {}};
  num_used_bytes += parts.summary.size() + parts.details.size();
  ReportPageOptions left = options;
  left.max_bytes -= std::min(options.max_bytes, num_used_bytes);
  parts.data = MakeSceneData(model, left, context);
  return parts;
}

std::string FillPage(const std::string& title, const char* policy,
                     const PageParts& parts) {
  return FillTemplate(PageAsset(), {{"<!--policy-->", policy},
                                    {"<!--title-->", title},
                                    {"<!--heading-->", title},
                                    {"<!--summary-->", parts.summary},
                                    {"<!--details-->", parts.details},
                                    {"/*header*/", parts.data.header_json},
                                    {"/*arrays*/", parts.data.arrays_base64}});
}

std::string TitleOf(const std::string& title) {
  constexpr size_t kMaxBytes = 500;  // longer titles do not fit a heading
  return EscapeHtml(Shorten(title, kMaxBytes));
}

}  // namespace

std::string MakeReportPage(const ReportPageInput& input,
                           const ReportPageOptions& options,
                           const Context& context) {
  const std::string title = TitleOf(input.title);
  const PageParts parts =
      MakeParts(input, PageAsset().size() + 2 * title.size(), options, context);
  return FillPage(title, parts.data.has_side_files ? kItsFolder : kNowhere,
                  parts);
}

std::string MakeLivePage(const std::string& title) {
  return FillPage(TitleOf(title), kItsServer,
                  {"", "", {R"({"is_live":true})", "", false}});
}

std::string MakeLiveModel(const ReportPageInput& input,
                          const ReportPageOptions& options,
                          const Context& context) {
  const PageParts parts = MakeParts(input, 0, options, context);
  return "{\"summary\":" + ToScriptJson(parts.summary) +
         ",\"details\":" + ToScriptJson(parts.details) +
         ",\"header\":" + parts.data.header_json + ",\"arrays\":\"" +
         parts.data.arrays_base64 + "\"}";
}

}  // namespace mgsfm
