// SPDX-License-Identifier: BSD-3-Clause
#include "mapper_run.h"

#include <algorithm>
#include <ctime>
#include <exception>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <system_error>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "bundle_adjustment/covariance_report.h"
#include "command.h"
#include "database/database_reader.h"
#include "files/file_operations.h"
#include "files/model_files.h"
#include "files/staged_output.h"
#include "fixed_region_masks.h"
#include "live_view.h"
#include "mapper/run_summary.h"
#include "mapper/stage.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/base/version.h"
#include "mgsfm/report_page/report_page.h"
#include "mgsfm/rigs/rig_config.h"
#include "models/model_placement.h"
#include "models/point_colors.h"
#include "partition_run.h"
#include "priors/body_calibration.h"
#include "program.h"
#include "rigs/image_times.h"
#include "scene/item_lists.h"

namespace mgsfm {

namespace {

namespace fs = std::filesystem;

// A soft rig has one pose per image. Then each image is a frame of its own, so
// that the tables agree.
bool HasSeparateImages(const MapperModel& model) {
  return model.soft_rig_images && model.soft_rig_images->summary.is_usable;
}

template <class Use>
auto UsePoses(const Scene& scene, const MapperModel& model, const Use& use) {
  if (!HasSeparateImages(model)) return use(scene, model.reconstruction);
  return use(SeparateImages(scene),
             SeparateImages(model.reconstruction,
                            model.soft_rig_images->cam_from_world));
}

// The poses of a model and those with its images at their measured positions.
std::optional<PoseComparison> ComparePositions(const Scene& scene,
                                               const Reconstruction& model,
                                               const PositionPriors& priors) {
  PoseComparison comparison;
  for (const Frame& frame : scene.frames) {
    for (const int i : frame.image_idxs) {
      const auto pose = model.CamFromWorld(scene, i);
      if (!pose || !priors.images[i]) continue;
      const Eigen::Vector3d residual =
          priors.images[i]->position - priors.images[i]->PointInWorld(*pose);
      const Rigid3 moved{pose->rotation,
                         pose->translation - pose->rotation * residual};
      comparison.images.push_back({scene.images[i].name, true, moved, *pose});
    }
  }
  if (comparison.images.empty()) return std::nullopt;
  EvaluationOptions options;
  options.alignment = Alignment::kNone;
  comparison.evaluation = Evaluate(comparison.images, true, {}, options);
  comparison.evaluation.rotation_deg.reset();  // positions only
  return comparison;
}

std::string MakePage(const ModelPage& shown, const Context& context) {
  const MapperInput& input = shown.input;
  const MapperModel& model = shown.model;
  const PositionPriors positions = model.PositionsOf(input.position_priors);
  return UsePoses(
      input.scene, model, [&](const Scene& scene, const Reconstruction& poses) {
        ReportPageInput page{shown.folder.string(), scene, poses};
        page.view_graph = &input.view_graph;
        page.report_json = shown.report_json;
        page.model_idx = shown.model_idx;
        page.image_path = shown.image_path;
        page.image_url = PageUrl(shown.image_path, shown.folder);
        if (model.IsAtPositions()) {
          page.is_east_north_up =
              input.position_priors.origin_wgs84.has_value();
          page.positions = ComparePositions(scene, poses, positions);
        }
        if (!HasSeparateImages(model)) {
          page.frame_confidence = model.confidence.of_frame;
        }
        return MakeReportPage(page, ReportPageOptions(), context);
      });
}

// Writes report.html into the folder of each model of a run. Returns the page
// of the first model, or "".
std::string WriteReportPages(const fs::path& output_path,
                             const std::string& image_path,
                             const MapperInput& input,
                             const MapperResult& result,
                             const std::string& report_json,
                             const Context& context) {
  std::string first_page;
  for (size_t i = 0; i < result.models.size(); ++i) {
    context.ReportProgress("report page", i, result.models.size());
    const std::string page =
        WriteReportPage({output_path / std::to_string(i), image_path, input,
                         result.models[i], i, report_json},
                        context);
    if (page.empty()) break;
    if (i == 0) first_page = page;
  }
  return first_page;
}

// Delays and readout times need the times of images: those of a file or,
// without one, those in the names.
void SetTimestamps(SoftRig method, Scene* scene) {
  if (method == SoftRig::kAuto || method == SoftRig::kNone ||
      method == SoftRig::kSoft) {
    return;
  }
  for (Image& image : scene->images) {
    if (image.timestamp_s) continue;
    const auto time_ns = TimeInName(image.name);
    if (!time_ns) {
      throw Error("--SoftRig.method " + std::string(EnumName(method)) +
                  " needs the times of images, but the name of '" + image.name +
                  "' has none; set --image_timestamps_path");
    }
    image.timestamp_s = static_cast<double>(*time_ns) / kNsPerSecond;
  }
}

void LogInput(const LoadedInput& input, const Context& context) {
  const Scene& scene = input.mapper.scene;
  context.Info(Formatted("read %zu images in %zu frames, %zu pairs; rigs: %s",
                         scene.images.size(), scene.frames.size(),
                         input.mapper.view_graph.pairs.size(),
                         input.rig_source.c_str()));
}

void LogPositions(const PositionPriors& positions, const Context& context) {
  if (positions.IsEmpty()) return;
  context.Info(std::string("positions are ") +
               (positions.origin_wgs84 ? "latitudes, longitudes and altitudes"
                                       : "Cartesian") +
               " (ref_is_gps)");
}

// The names of the images to use; empty: all.
std::set<std::string> ListImages(const std::string& list_path,
                                 const std::optional<Model>& model) {
  if (list_path.empty()) return {};
  const std::vector<std::string> listed = ReadImageList(list_path);
  std::set<std::string> names(listed.begin(), listed.end());
  if (names.empty()) {
    throw Error("'" + list_path + "' (--image_list_path) lists no image");
  }
  if (!model) return names;
  for (const ModelImage& image : model->poses.images) names.insert(image.name);
  return names;
}

void IgnoreRigs(LoadedScene* loaded) {
  loaded->scene = SeparateImages(std::move(loaded->scene));
  loaded->rig_source = "ignored, each image is a rig of its own";
}

// Logs the final lines of a run; the last one names the page, if it has one.
void LogSummary(const MapperRun& run, const Scene& scene,
                const MapperResult& result, bool has_page,
                const Context& context) {
  for (const std::string& line : DescribeRun(SummarizeRun(scene, result))) {
    context.Info(line);
  }
  const fs::path output(run.output_path);
  context.Info("written: models in " + output.string() + ", details in " +
               (output / "report.json").string());
  if (!run.mapper.compute_covariances) {
    context.Info(
        "next: repeat with --compute_covariances 1 for the accuracy of all "
        "poses");
  }
  if (has_page) {
    context.Info("open in a browser: " +
                 (output / "0" / kReportPageFileName).string());
  }
}

// A model extended without registration keeps its origin.
void KeepGeoOrigin(const fs::path& input_path, const MapperResult& result,
                   const fs::path& output_path) {
  const fs::path origin = input_path / "geo_origin.json";
  if (input_path.empty() || !fs::is_regular_file(origin)) return;
  for (size_t i = 0; i < result.models.size(); ++i) {
    const auto& priors = result.models[i].position_priors;
    if (priors && priors->is_registered) continue;
    fs::copy_file(origin, output_path / std::to_string(i) / "geo_origin.json");
  }
}

}  // namespace

void WriteMapperModel(const fs::path& folder, const MapperInput& input,
                      const MapperModel& model, ModelFormat format,
                      const Context& context) {
  fs::create_directory(folder);
  UsePoses(input.scene, model,
           [&](const Scene& scene, const Reconstruction& poses) {
             WriteModel(folder, scene, poses, format, context);
           });
  WriteRigConfig((folder / "rig_config.json").string(), input.scene,
                 model.reconstruction);
  const auto& origin_wgs84 = input.position_priors.origin_wgs84;
  if (model.IsAtPositions() && origin_wgs84) {
    WriteGeoOrigin((folder / "geo_origin.json").string(), *origin_wgs84);
  }
  if (model.covariances && model.covariances->is_usable) {
    WriteFile(folder / "covariances.csv",
              CovariancesToCsv(input.scene, *model.covariances));
  }
  if (!model.confidence.of_frame.empty()) {
    WriteFile(folder / "frames.csv", FramesToCsv(input.scene, model));
  }
}

std::string WriteReportPage(const ModelPage& shown, const Context& context) {
  const fs::path path = shown.folder / kReportPageFileName;
  try {
    std::string page = MakePage(shown, context);
    ReplaceFile(path, page);
    return page;
  } catch (const std::exception& error) {
    std::error_code ignored;
    fs::remove(path, ignored);
    context.Warning("the model is complete, but its page '" + path.string() +
                    "' was not written: " + error.what());
    return "";
  }
}

std::vector<size_t> FindImages(const Scene& model, const Scene& database,
                               const std::string& database_path) {
  const auto idx_of_name = IndexByName(database.images);
  std::vector<size_t> idxs;
  for (const Image& image : model.images) {
    const auto found = idx_of_name.find(image.name);
    if (found == idx_of_name.end()) {
      throw Error("the database '" + database_path + "' has no image '" +
                  image.name +
                  "' of the model; give the database of its images");
    }
    idxs.push_back(found->second);
  }
  return idxs;
}

namespace {

// The images of the database, of which priors may be a part of the input.
// nullopt if the input has all of them in their order, if there are no priors,
// or if files of times or rigs lack the other images.
std::optional<Scene> AllImages(const MapperRun& run, const Scene& scene,
                               const Context& context) {
  const std::vector<std::string> names =
      Transformed(scene.images, &Image::name);
  const bool has_all_in_order =
      ReadImageNames(run.database_path).size() == names.size() &&
      std::is_sorted(names.begin(), names.end());
  if (has_all_in_order || !run.priors.HaveAny()) return std::nullopt;
  DatabaseSelection selection;
  selection.has_keypoints = false;
  selection.has_pair = [](const std::string&, const std::string&) {
    return false;
  };
  Context quiet = context;  // the run has logged its input
  quiet.log = nullptr;
  DatabaseContents contents = ReadDatabase(run.database_path, quiet, selection);
  try {
    return LoadScene(std::move(contents), run.loading, quiet).scene;
  } catch (const Error& error) {
    context.Info(
        "the origin of positions is that of the listed images, as the others "
        "cannot be read: " +
        std::string(error.what()));
    return std::nullopt;
  }
}

}  // namespace

void CheckAntenna(const Scene& scene, const PositionPriors& positions,
                  const PosePriorOptions& options) {
  if (positions.IsEmpty()) {
    throw Error(
        "estimate_antenna needs positions; set use_prior_position or "
        "ref_images_path, or omit it");
  }
  std::set<int> sensor_idxs;
  for (size_t i = 0; i < positions.images.size(); ++i) {
    if (positions.images[i]) sensor_idxs.insert(scene.images[i].sensor_idx);
  }
  if (sensor_idxs.size() > 1 && options.body_calibration->empty()) {
    throw Error(
        "estimate_antenna: several cameras have positions, whose antenna is "
        "one point of a body; give its axes with body_calibration");
  }
}

void ReadPriors(const MapperRun& run, const Context& context,
                MapperInput* input) {
  const auto read = [&](const Scene& scene) {
    input->position_priors =
        ReadPositionPriors(scene, run.database_path, run.priors);
    input->gravity_priors = ReadGravity(scene, run.database_path, run.priors);
    const std::string& body_path = run.priors.body_calibration;
    if (body_path.empty()) return;
    const BodyFrame body = ReadBody(scene, body_path);
    if (!body.warning.empty()) context.Warning(body.warning);
  };
  const std::optional<Scene> all = AllImages(run, input->scene, context);
  if (!all) {
    read(input->scene);
  } else {
    read(*all);
    const std::vector<size_t> idxs =
        FindImages(input->scene, *all, run.database_path);
    SelectImages(idxs, &input->position_priors.images);
    SelectImages(idxs, &input->gravity_priors.images);
  }
  if (run.mapper.estimate_antenna) {
    CheckAntenna(input->scene, input->position_priors, run.priors);
  }
  LogPositions(input->position_priors, context);
}

std::string PageUrl(const std::string& image_path,
                    const fs::path& page_folder) {
  if (image_path.empty()) return "";
  const fs::path folder = page_folder.empty() ? "." : page_folder;
  return fs::proximate(image_path, folder).generic_string() + "/";
}

namespace {

// As a JSON object by the full names of the options.
std::string ChangedOptions(const std::string& json,
                           const std::string& default_json) {
  using Json = nlohmann::ordered_json;
  const Json defaults = Json::parse(default_json).flatten();
  const Json values = Json::parse(json).flatten();
  Json changed = Json::object();
  for (const auto& [path, value] : values.items()) {
    if (defaults.contains(path) && defaults[path] == value) continue;
    std::string name = path.substr(1);
    std::replace(name.begin(), name.end(), '/', '.');
    changed[name] = value;
  }
  return changed.dump();
}

std::string DateText() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M UTC", &utc);
  return text;
}

}  // namespace

RunDescription DescribeInput(const MapperRun& run, const Context& context) {
  RunDescription description;
  description.version = Version();
  description.database_path = run.database_path;
  description.input_path = run.input_path;
  description.options_json = run.options_json;
  description.changed_options_json =
      ChangedOptions(run.options_json, run.default_options_json);
  description.command = ThisCall().command;
  description.commit = ThisCall().commit;
  description.date = DateText();
  description.random_seed = context.random_seed;
  return description;
}

void CheckImagePath(const std::string& image_path) {
  if (!image_path.empty() && !fs::is_directory(image_path)) {
    throw Error("--image_path '" + image_path + "' is not a folder");
  }
}

void ColorModels(const Scene& scene, const std::string& image_path,
                 const Context& context, MapperResult* result) {
  if (image_path.empty()) return;
  for (MapperModel& model : result->models) {
    const std::vector<UncoloredImage> unused =
        ColorPoints(scene, image_path, context, &model.reconstruction);
    if (unused.empty()) continue;
    context.Warning(
        Formatted("%zu images give no colors: image '%s' %s; points that only "
                  "such images see stay black",
                  unused.size(), unused.front().name.c_str(),
                  unused.front().problem.c_str()));
  }
}

void LogMissingColors(const std::string& image_path, const Context& context) {
  if (!image_path.empty()) return;
  context.Info(
      "all points are black because no image folder was given; pass "
      "--image_path to color them");
}

LoadedInput LoadMapperInput(const MapperRun& run, StartUse use,
                            const Context& context) {
  std::optional<Model> model;
  if (!run.input_path.empty()) model = ReadModel(run.input_path);
  const auto names = ListImages(run.image_list_path, model);
  DatabaseContents contents = ReadDatabase(run.database_path, context, {names});
  if (!names.empty()) {
    KeepListedImages(names, run.image_list_path, &contents);
  }
  LoadedScene loaded = LoadScene(std::move(contents), run.loading, context);
  const bool is_single = run.baseline.method == MapperMethod::kSingle;
  if (is_single) IgnoreRigs(&loaded);
  if (!run.rig_split.split_rig_at->empty()) {
    loaded.scene =
        SplitRig(std::move(loaded.scene), *run.rig_split.split_rig_at);
    loaded.rig_source += ", split at frame " + *run.rig_split.split_rig_at;
  }
  LoadedInput input;
  if (model) {
    const auto place = [&] {
      return PlaceModel(*model, run.input_path, run.database_path,
                        use.takes_points, &loaded.scene);
    };
    PlacedModel placed = place();
    if (use.holds_poses && !placed.is_rigid) {
      context.Info("the images of the model do not move as rigid units");
      IgnoreRigs(&loaded);
      placed = place();
    }
    input.mapper.existing_model = std::move(placed.reconstruction);
  }
  input.mapper.expects_rigs =
      !is_single && *run.loading.rig_name_rule != "none";
  input.mapper.scene = std::move(loaded.scene);
  input.mapper.view_graph = std::move(loaded.view_graph);
  input.rig_source = std::move(loaded.rig_source);
  return input;
}

int MapDatabase(const MapperRun& run, const Context& context) {
  CheckImagePath(run.image_path);
  CheckFixedRegionFolder(run.fixed_region_mask_path);
  // Reports contradictions before anything is read.
  MapperOptions resolved = run.mapper;
  ResolveBaseline(run.baseline, &resolved);
  StagedOutput output(run.output_path);
  RunDescription description = DescribeInput(run, context);

  const RunningStage reading("reading", context);
  LoadedInput input = LoadMapperInput(run, StartUse(), context);
  SetTimestamps(run.mapper.soft_rig.method, &input.mapper.scene);
  const Scene& scene = input.mapper.scene;
  CheckFormat(scene, run.output_format);
  description.rig_source = input.rig_source;
  reading.Finish(&description.times);
  ReadPriors(run, context, &input.mapper);
  LogInput(input, context);
  CheckMemory(input.mapper, run.max_memory_mib);
  if (run.live) input.mapper.observer = run.live->Observe(scene, context);

  MapperResult result =
      RunBaseline(run.baseline, input.mapper, run.mapper, context);
  const RunningStage writing("writing", context);
  ColorModels(scene, run.image_path, writing.context(), &result);
  for (size_t i = 0; i < result.models.size(); ++i) {
    WriteMapperModel(output.StagingDir() / std::to_string(i), input.mapper,
                     result.models[i], run.output_format, context);
  }
  KeepGeoOrigin(run.input_path, result, output.StagingDir());
  writing.Finish(&description.times);
  description.peak_memory_mib = PeakMemoryMib();
  const std::string report_json =
      MapperReportToJson(scene, input.mapper.view_graph, result, description);
  WriteFile(output.StagingDir() / "report.json", report_json);
  context.CheckInterrupted();
  output.Commit();
  std::string first_page;
  if (run.write_report) {
    first_page = WriteReportPages(run.output_path, run.image_path, input.mapper,
                                  result, report_json, context);
  }
  if (!run.fixed_region_mask_path.empty()) {
    WriteFixedRegionMasks(run.fixed_region_mask_path, scene,
                          result.fixed_regions, context);
  }
  if (result.models.empty()) {
    context.log(LogLevel::kError,
                "no model could be reconstructed; see " +
                    (fs::path(run.output_path) / "report.json").string());
    return kExitNotSolvable;
  }
  LogMissingColors(run.image_path, context);
  LogSummary(run, scene, result, !first_page.empty(), context);
  if (run.live) run.live->Finish(first_page);
  return kExitSuccess;
}

}  // namespace mgsfm
