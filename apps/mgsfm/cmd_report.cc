// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <utility>

#include "base/file_reading.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "extension/model_placement.h"
#include "figure_files.h"
#include "io/files/file_operations.h"
#include "io/files/model_files.h"
#include "mapper_run.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/models/model_scene.h"
#include "mgsfm/report_page/report_page.h"
#include "true_trajectory.h"
#include "truth_comparison.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ReportCommandOptions {
  Option<std::string> input_path{
      "input_path", "", Required(),
      "Folder of the model to show. The report.json of its run is read if it "
      "is there or in the folder above."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "HTML file to write."};
  Option<std::string> database_path{
      "database_path", "",
      "Database of the model: shows images that are not registered and pairs "
      "that were rejected."};
  Option<std::string> image_path{"image_path", "",
                                 "Folder of the images, for thumbnails."};
  Option<std::string> compare_path{
      "compare_path", "",
      "Folder of another model of the same images to compare with."};
  Option<std::string> gt_path{
      "gt_path", "", "True poses: a folder (colmap) or a file (kitti, tum)."};
  Option<TruthFormat> gt_format{
      "gt_format", TruthFormat::kColmap,
      "Format of the true poses, as for model_evaluator."};
  Option<std::string> calib_path{"calib_path", "",
                                 "True rig, as for model_evaluator."};
  Option<double> max_size_mb{
      "max_size", 10.0, AtLeast(1.0), "MB",
      "Maximum size of the file; limits points, tracks and thumbnails."};
  Option<std::string> figures{
      "figures", "",
      "Folder for the trajectory, the rig, the residual maps, the view graph "
      "and, with --gt_path, the errors as SVG and PNG files."};
  Option<bool> side_files{
      "side_files", false,
      "Write the points that do not fit into files beside the page, from which "
      "it loads them on request."};
  SceneLoadingOptions loading;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, database_path, image_path, compare_path,
          gt_path, gt_format, calib_path, max_size_mb, side_files, figures,
          loading);
  }
};

// A model in the scene of its database, if that is known, else in its own.
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
    Reconstruction none{loaded.scene.cameras, {}, {}, {}};
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

// The columns `frame` and `confidence` of a file that the mapper writes.
std::map<std::string, double> ReadConfidenceFile(const fs::path& path) {
  TextInput file(ReadFile(path));
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> columns = SplitFields(line);
  const auto column = [&](const char* name) {
    return static_cast<size_t>(std::find(columns.begin(), columns.end(), name) -
                               columns.begin());
  };
  std::map<std::string, double> confidence_of_name;
  for (int number = 2; std::getline(file, line); ++number) {
    std::vector<std::string> fields = SplitFields(line);
    fields.resize(columns.size() + 1);
    const auto value = ParseDouble(fields[column("confidence")]);
    if (!value || column("frame") == columns.size()) {
      throw Error("'" + path.string() + "', line " + std::to_string(number) +
                  ": it needs the columns `frame` and `confidence` with a "
                  "number; remove the file or write the model again");
    }
    confidence_of_name[fields[column("frame")]] = *value;
  }
  return confidence_of_name;
}

// The confidence of frames in frames.csv beside the model. Frames not listed
// there have none.
std::vector<std::optional<double>> ReadConfidence(const fs::path& model_path,
                                                  const Scene& scene) {
  const fs::path path = model_path / "frames.csv";
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return {};
  const std::map<std::string, double> confidence_of_name =
      ReadConfidenceFile(path);
  if (confidence_of_name.empty()) return {};
  std::vector<std::optional<double>> confidence;
  for (const Frame& frame : scene.frames) {
    const auto found = confidence_of_name.find(frame.name);
    confidence.push_back(found == confidence_of_name.end()
                             ? std::nullopt
                             : std::optional<double>(found->second));
  }
  return confidence;
}

PoseComparison Compare(const std::string& label, const TruthSource& source) {
  TruthComparison compared = CompareWithTruth(source);
  EvaluationOptions options;
  options.is_metric = compared.is_metric;
  Evaluation evaluation = Evaluate(compared.images, compared.has_true_poses,
                                   compared.sensors, options);
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

int RunReportCommand(const ReportCommandOptions& options,
                     const Context& context) {
  CheckUsage(options);
  const ShownModel model = LoadShownModel(options, context);
  const RunReport report = FindReport(*options.input_path);
  ReportPageInput page{options.input_path, model.scene, model.reconstruction};
  if (model.view_graph) page.view_graph = &*model.view_graph;
  page.report_json = report.json;
  page.model_idx = report.model_idx;
  page.image_path = options.image_path;
  page.frame_confidence = ReadConfidence(*options.input_path, model.scene);
  if (!options.gt_path->empty()) {
    TruthSource source{options.input_path, options.gt_path, options.gt_format,
                       options.calib_path, options.database_path};
    source.rig_name_rule = options.loading.rig_name_rule;
    page.truth = Compare(options.gt_path, source);
  }
  if (!options.compare_path->empty()) {
    TruthSource source{options.compare_path, options.input_path};
    source.rig_name_rule = options.loading.rig_name_rule;
    page.other = Compare(options.compare_path, source);
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
