// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/report_page.h"

#include <algorithm>

#include "base/ranges.h"
#include "evaluation/evaluation_plot.h"
#include "mgsfm/base/error.h"
#include "mgsfm/report_page/figures.h"
#include "report_page/charts.h"
#include "report_page/encoding.h"
#include "report_page/sections.h"

// The assembler includes the file, which costs the compiler nothing.
asm(R"(
  .pushsection .rodata
  .global mgsfm_page_asset_begin
  .global mgsfm_page_asset_end
mgsfm_page_asset_begin:
  .incbin ")" MGSFM_PAGE_ASSET_PATH R"("
mgsfm_page_asset_end:
  .byte 0
  .popsection
)");

extern "C" {
extern const char mgsfm_page_asset_begin[];
extern const char mgsfm_page_asset_end[];
}

namespace mgsfm {
namespace {

// The page without content, which web/build.mjs makes from web/src. It has the
// marks <!--pictures-->, <!--policy-->, <!--title-->, <!--summary-->,
// <!--details-->, and in elements of their own /*header*/ and /*arrays*/.
std::string_view PageAsset() {
  return {mgsfm_page_asset_begin,
          static_cast<size_t>(mgsfm_page_asset_end - mgsfm_page_asset_begin)};
}

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
  const PageModel model =
      MakePageModel(input, ParseReport(input.report_json, context), context);
  PageParts parts{SummarySection(model), DetailSections(model), {}};
  num_used_bytes += parts.summary.size() + parts.details.size();
  ReportPageOptions left = options;
  left.max_bytes -= std::min(options.max_bytes, num_used_bytes);
  parts.data = MakeSceneData(model, left, context);
  return parts;
}

std::string FillPage(const std::string& title, const char* policy,
                     const PageParts& parts, bool has_photos = false) {
  return FillTemplate(PageAsset(),
                      {{"<!--pictures-->", has_photos ? kItsFolder : kNowhere},
                       {"<!--policy-->", policy},
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
                  parts, !input.image_url.empty());
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

std::vector<Figure> MakeFigures(const ReportPageInput& input,
                                const Context& context) {
  const PageModel model =
      MakePageModel(input, ParseReport(input.report_json, Context()), context);
  std::vector<Figure> figures = {{"trajectory", TrajectoryChart(model)},
                                 {"rig", RigChart(model)},
                                 {"residuals", ErrorMapChart(model)},
                                 {"view_graph", ViewGraphChart(model)}};
  if (input.truth) {
    figures.push_back({"errors", EvaluationToSvg(input.truth->images,
                                                 input.truth->evaluation)});
  }
  EraseIf(&figures, [](const Figure& figure) { return figure.svg.empty(); });
  return figures;
}

}  // namespace mgsfm
