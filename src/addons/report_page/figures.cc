// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/figures.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "evaluation/error_statistics.h"
#include "evaluation/evaluation_plot.h"
#include "report_page/charts.h"
#include "report_page/page_model.h"
#include "report_page/trajectory_chart.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

Json ModelEntry(const Json& report, size_t model_idx) {
  const Json& models = GetArray(report, "models");
  return model_idx < models.size() ? models[model_idx] : Json::object();
}

}  // namespace

std::vector<Figure> MakeFigures(const ReportPageInput& input,
                                const Context& context) {
  const Projector projector(input.scene, input.reconstruction);
  const ModelStatistics statistics =
      ComputeStatistics(input.scene, input.reconstruction, projector, context);
  PageModel model{input, projector, statistics,
                  Json::parse(input.report_json, nullptr, false),
                  Json::object()};
  if (!model.report.is_object()) model.report = Json::object();
  model.model_report = ModelEntry(model.report, input.model_idx);
  std::vector<Figure> figures = {{"trajectory", TrajectoryChart(model)},
                                 {"rig", RigChart(model)},
                                 {"residuals", ErrorMapChart(model)},
                                 {"view_graph", ViewGraphChart(model)}};
  if (input.truth) {
    EvaluationLabels labels;
    labels.length_unit = LengthUnitName(input.truth->evaluation);
    figures.push_back(
        {"errors", EvaluationToSvg(input.truth->images, input.truth->evaluation,
                                   labels)});
  }
  std::vector<Figure> shown;
  for (Figure& figure : figures) {
    if (!figure.svg.empty()) shown.push_back(std::move(figure));
  }
  return shown;
}

}  // namespace mgsfm
