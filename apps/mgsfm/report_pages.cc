// SPDX-License-Identifier: BSD-3-Clause
#include "report_pages.h"

#include <exception>
#include <system_error>
#include <utility>

#include "files/file_operations.h"
#include "files/model_files.h"
#include "mgsfm/report_page/report_page.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

std::string MakePage(const std::string& title, const std::string& image_path,
                     const MapperInput& input, const MapperResult& result,
                     size_t model_idx, const std::string& report_json,
                     const Context& context) {
  const MapperModel& model = result.models[model_idx];
  const bool has_separate_images =
      model.soft_rig_images && model.soft_rig_images->summary.is_usable;
  const auto make = [&](const Scene& scene, const Reconstruction& poses) {
    ReportPageInput page{title, scene, poses};
    page.view_graph = &input.view_graph;
    page.report_json = report_json;
    page.model_idx = model_idx;
    page.image_path = image_path;
    if (!has_separate_images) page.frame_confidence = model.confidence.of_frame;
    return MakeReportPage(page, ReportPageOptions(), context);
  };
  if (!has_separate_images) return make(input.scene, model.reconstruction);
  return make(SeparateImages(input.scene),
              SeparateImages(model.reconstruction,
                             model.soft_rig_images->cam_from_world));
}

}  // namespace

std::string WriteReportPages(const fs::path& output_path,
                             const std::string& image_path,
                             const MapperInput& input,
                             const MapperResult& result,
                             const std::string& report_json,
                             const Context& context) {
  std::string first_page;
  for (size_t i = 0; i < result.models.size(); ++i) {
    const fs::path folder = output_path / std::to_string(i);
    const fs::path path = folder / kReportPageFileName;
    try {
      std::string page = MakePage(folder.string(), image_path, input, result, i,
                                  report_json, context);
      ReplaceFile(path, page);
      if (i == 0) first_page = std::move(page);
    } catch (const std::exception& error) {
      std::error_code ignored;
      fs::remove(path, ignored);
      context.Warning("the model is complete, but its page '" + path.string() +
                      "' was not written: " + error.what());
      break;
    }
  }
  return first_page;
}

}  // namespace mgsfm
