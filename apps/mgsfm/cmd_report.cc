// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "command.h"
#include "commands.h"
#include "evaluation/truth_comparison.h"
#include "files/file_operations.h"
#include "files/model_files.h"
#include "mapper_run.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/model_scene.h"
#include "mgsfm/report_page/figures.h"
#include "mgsfm/report_page/report_page.h"
#include "models/model_placement.h"
#include "models/point_colors.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ReportCommandOptions {
  Option<std::string> input_path{
      "input_path", "", Required(),
      "Show the model in this folder. The report.json of its run is read if it "
      "is there or in the folder above."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Write this HTML file."};
  Option<std::string> database_path{"database_path", "",
                                    "Show unregistered images and rejected "
                                    "pairs from this database of the model."};
  Option<std::string> image_path{
      "image_path", "",
      "Show the images in this folder, and take the colors of points from "
      "them if the model has none."};
  Option<std::string> compare_path{
      "compare_path", "",
      "Compare with the model in this folder of the same images."};
  Option<std::string> gt_path{"gt_path", "",
                              "Compare with these true poses: a folder "
                              "(colmap) or a file (kitti, tum)."};
  Option<TruthFormat> gt_format{
      "gt_format", TruthFormat::kColmap,
      "State the format of the true poses, as for model_evaluator."};
  Option<std::string> calib_path{
      "calib_path", "", "Compare with this true rig, as for model_evaluator."};
  Option<double> max_size_mb{
      "max_size", 10.0, AtLeast(1.0), "MB",
      "Limit the size of the file by selecting points, tracks and thumbnails."};
  Option<std::string> figures{
      "figures", "",
      "Write the trajectory, the rig, the residual maps, the view graph and, "
      "with --gt_path, the errors as SVG files into this folder."};
  Option<bool> side_files{"side_files", false,
                          "Write the points that do not fit into the page to "
                          "files beside it, which the page loads on request."};
  SceneLoadingOptions loading;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, database_path, image_path, compare_path,
          gt_path, gt_format, calib_path, max_size_mb, side_files, figures,
          loading);
  }
};

// A model in the scene of its database if known, otherwise in its own scene.
struct ShownModel {
  Scene scene;
  Reconstruction reconstruction;
  std::optional<ViewGraph> view_graph;
};

ShownModel LoadShownModel(const ReportCommandOptions& options,
                          const Context& context) {
  const Model model = ReadModel(*options.input_path);
  if (options.database_path->empty()) {
    if (model.poses.images.empty()) return {};
    ModelScene loaded =
        MakeModelScene(model, *options.input_path, options.loading, context);
    return {std::move(loaded.scene), std::move(loaded.reconstruction), {}};
  }
  LoadedScene loaded =
      LoadScene(options.database_path, options.loading, context);
  if (model.poses.images.empty()) {
    Reconstruction none{loaded.scene.cameras, {}, {}, {}, {}};
    none.sensor_from_rig.resize(loaded.scene.sensors.size());
    none.rig_from_world.resize(loaded.scene.frames.size());
    return {std::move(loaded.scene), std::move(none),
            std::move(loaded.view_graph)};
  }
  const auto place = [&] {
    return PlaceModel(model, *options.input_path, options.database_path,
                      !model.points.empty(), &loaded.scene);
  };
  PlacedModel placed = place();
  if (!placed.is_rigid) {
    loaded.scene = SeparateImages(std::move(loaded.scene));
    placed = place();
  }
  return {std::move(loaded.scene), std::move(placed.reconstruction),
          std::move(loaded.view_graph)};
}

// The report of the run, and the entry of the model in it.
struct RunReport {
  std::string json;
  size_t model_idx = 0;
};

RunReport FindReport(const fs::path& model_path) {
  const fs::path folder = fs::weakly_canonical(model_path);
  RunReport report;
  fs::path path = folder / kReportFileName;
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) {
    const std::string number = folder.filename().string();
    constexpr size_t kMaxDigits = 9;  // any such number fits unsigned long
    if (!IsModelFolderName(number) || number.size() > kMaxDigits) return report;
    path = folder.parent_path() / kReportFileName;
    report.model_idx = std::stoul(number);
  }
  report.json = fs::is_regular_file(path, ignored) ? ReadFile(path) : "";
  return report;
}

// The column of a table, by the name in its first line.
size_t ColumnOf(const TextLines& lines, const std::vector<std::string>& names,
                const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    lines.Throw("expected a column '" + name +
                "'; remove the file, or map again");
  }
  return static_cast<size_t>(found - names.begin());
}

struct ConfidenceRow {
  std::string num_images;
  double confidence = 0.0;
};

// The rows of a table by the names of frames; frames without a confidence are
// left out.
std::map<std::string, ConfidenceRow> ReadConfidenceTable(const fs::path& path) {
  TextLines lines(path);
  lines.Next();
  const auto names =
      SplitCsv(lines.line()).value_or(std::vector<std::string>());
  const size_t frame = ColumnOf(lines, names, "frame");
  const size_t num_images = ColumnOf(lines, names, "num_images");
  const size_t confidence = ColumnOf(lines, names, "confidence");
  std::map<std::string, ConfidenceRow> row_of_name;
  while (lines.Next()) {
    if (lines.line().empty()) continue;
    const auto fields = SplitCsv(lines.line());
    if (!fields || fields->size() != names.size()) {
      lines.Throw("expected " + std::to_string(names.size()) +
                  " fields; remove the file, or map again");
    }
    if ((*fields)[confidence].empty()) continue;
    const auto value = ParseDouble((*fields)[confidence]);
    if (!value || *value < 0.0 || *value > 1.0) {
      lines.Throw("has '" + Printable((*fields)[confidence]) +
                  "' as a confidence; remove the file, or map again");
    }
    row_of_name[(*fields)[frame]] = {(*fields)[num_images], *value};
  }
  return row_of_name;
}

// The confidence of frames in frames.csv beside the model. Frames that are not
// listed there have none.
std::vector<std::optional<double>> ReadConfidence(const fs::path& model_path,
                                                  const Scene& scene,
                                                  const Context& context) {
  const fs::path path = model_path / "frames.csv";
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return {};
  const auto row_of_name = ReadConfidenceTable(path);
  if (row_of_name.empty()) return {};
  std::vector<std::optional<double>> confidence;
  size_t num_found = 0;
  for (const Frame& frame : scene.frames) {
    const auto found = row_of_name.find(frame.name);
    const bool is_found =
        found != row_of_name.end() &&
        found->second.num_images == std::to_string(frame.image_idxs.size());
    num_found += is_found ? 1 : 0;
    confidence.push_back(is_found ? std::optional(found->second.confidence)
                                  : std::nullopt);
  }
  if (num_found < row_of_name.size()) {
    context.Warning(Formatted(
        "'%s' has %zu of %zu frames that the model does not have, or "
        "has with other images; it is of another model",
        path.c_str(), row_of_name.size() - num_found, row_of_name.size()));
  }
  return confidence;
}

// The report beside or above a model may be of an earlier run.
void WarnOfOtherReport(const RunReport& report, const Scene& scene,
                       const Context& context) {
  const auto json = nlohmann::json::parse(report.json, nullptr, false);
  if (!json.is_object() || !json.contains("models")) return;
  const nlohmann::json& models = json["models"];
  if (!models.is_array() || report.model_idx >= models.size()) return;
  const nlohmann::json& model = models[report.model_idx];
  if (!model.is_object()) return;
  const auto num_images = model.find("num_images");
  if (num_images == model.end() || !num_images->is_number_unsigned()) return;
  if (num_images->get<size_t>() == scene.images.size()) return;
  context.Warning(
      Formatted("report.json describes %s images, but the model has %zu; check "
                "that it belongs to the run of this model",
                num_images->dump().c_str(), scene.images.size()));
}

PoseComparison Compare(const std::string& label, const TruthSource& source,
                       const Context& context) {
  TruthComparison compared = CompareWithTruth(source);
  EvaluationOptions options;
  options.is_metric = compared.is_metric;
  Evaluation evaluation = Evaluate(compared.images, compared.has_true_poses,
                                   compared.sensors, options);
  WarnOfFewPoses(compared, evaluation, options.alignment, context);
  return {label, std::move(compared.images), std::move(evaluation)};
}

void CheckUsage(const ReportCommandOptions& options) {
  CheckImagePath(options.image_path);
  if (options.gt_format == TruthFormat::kRig) {
    throw Error("--gt_format rig has no poses; choose another one");
  }
  if (fs::is_directory(*options.output_path)) {
    throw Error("--output_path '" + *options.output_path +
                "' is a folder; name a file in it, such as report.html");
  }
}

// Writes the figures of a model (mgsfm/report_page/figures.h) as NAME.svg.
void WriteFigures(const fs::path& folder, const ReportPageInput& page,
                  const Context& context) {
  fs::create_directories(folder);
  for (const Figure& figure : MakeFigures(page, context)) {
    context.CheckInterrupted();
    ReplaceFile(folder / (figure.name + ".svg"), figure.svg);
  }
  context.Info("figures: " + folder.string());
}

// Colors the points of a model without colors, if its images are known.
void AddMissingColors(const std::string& image_path, ShownModel* model,
                      const Context& context) {
  const bool has_colors = AnyOf(
      model->reconstruction.points,
      [](const Point3D& point) { return point.color != Point3D().color; });
  if (has_colors || image_path.empty()) return;
  ColorPoints(model->scene, image_path, context, &model->reconstruction);
}

int RunReportCommand(const ReportCommandOptions& options,
                     const Context& context) {
  CheckUsage(options);
  ShownModel model = LoadShownModel(options, context);
  const RunReport report = FindReport(*options.input_path);
  if (!model.view_graph) WarnOfOtherReport(report, model.scene, context);
  AddMissingColors(options.image_path, &model, context);
  ReportPageInput page{options.input_path, model.scene, model.reconstruction};
  if (model.view_graph) page.view_graph = &*model.view_graph;
  page.report_json = report.json;
  page.model_idx = report.model_idx;
  page.image_path = options.image_path;
  page.image_url =
      PageUrl(options.image_path, fs::path(*options.output_path).parent_path());
  page.is_east_north_up =
      fs::is_regular_file(fs::path(*options.input_path) / "geo_origin.json");
  page.frame_confidence =
      ReadConfidence(*options.input_path, model.scene, context);
  if (!options.gt_path->empty()) {
    TruthSource source{options.input_path, options.gt_path, options.gt_format,
                       options.calib_path, options.database_path};
    source.rig_name_rule = options.loading.rig_name_rule;
    page.truth = Compare(options.gt_path, source, context);
  }
  if (!options.compare_path->empty()) {
    TruthSource source{options.compare_path, options.input_path};
    source.rig_name_rule = options.loading.rig_name_rule;
    page.other = Compare(options.compare_path, source, context);
  }
  constexpr double kBytesPerMb = 1e6;
  ReportPageOptions limits;
  limits.max_bytes = static_cast<size_t>(options.max_size_mb * kBytesPerMb);
  const fs::path output = *options.output_path;
  limits.side_file_stem = output.stem().string();
  if (options.side_files) {
    limits.write_side_file = [&output](const std::string& name,
                                       const std::string& content) {
      ReplaceFile(output.parent_path() / name, content);
    };
  }
  ReplaceFile(*options.output_path, MakeReportPage(page, limits, context));
  if (!options.figures->empty()) WriteFigures(*options.figures, page, context);
  context.Info("open " + *options.output_path + " in a browser");
  return kExitSuccess;
}

}  // namespace

Command ReportCommand() {
  return MakeCommand("report",
                     "Writes an HTML page to inspect a model, which needs no "
                     "network.",
                     RunReportCommand);
}

}  // namespace mgsfm
