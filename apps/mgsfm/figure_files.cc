// SPDX-License-Identifier: BSD-3-Clause
#include "figure_files.h"

#include <exception>

#include "files/file_operations.h"
#include "mgsfm/report_page/figures.h"

namespace mgsfm {

namespace fs = std::filesystem;

void WriteFigures(const fs::path& folder, const ReportPageInput& page,
                  const Context& context) {
  fs::create_directories(folder);
  for (const Figure& figure : MakeFigures(page, context)) {
    context.CheckInterrupted();
    ReplaceFile(folder / (figure.name + ".svg"), figure.svg);
  }
  context.Info("figures: " + folder.string());
}

void WriteFiguresOfModels(const fs::path& folder, const MapperInput& input,
                          const MapperResult& result,
                          const std::string& report_json,
                          const Context& context) {
  for (size_t i = 0; i < result.models.size(); ++i) {
    const fs::path of_model = folder / std::to_string(i);
    ReportPageInput page{of_model.string(), input.scene,
                         result.models[i].reconstruction};
    page.view_graph = &input.view_graph;
    page.report_json = report_json;
    page.model_idx = i;
    try {
      WriteFigures(of_model, page, context);
    } catch (const std::exception& error) {
      context.Warning("the model is complete, but its figures in '" +
                      of_model.string() +
                      "' were not written: " + error.what());
      return;
    }
  }
}

}  // namespace mgsfm
