// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/text_tools.h"
#include "cmd_images.h"
#include "cmd_matching.h"
#include "command.h"
#include "commands.h"
#include "files/image_reading.h"
#include "files/staged_output.h"
#include "geometry/so3.h"
#include "imaging/image_splitting.h"
#include "live_view.h"
#include "mapper_run.h"
#include "matching/fisheye_detection.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "mgsfm/matching/matching.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/priors/pose_priors.h"
#include "models/rows_to_scene.h"
#include "priors/body_calibration.h"
#include "priors/position_files.h"
#include "rigs/image_times.h"
#include "video/video_sampling.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

Camera CameraOf(CameraId id, const ImageSize& size) {
  const auto width = static_cast<double>(size.width);
  const auto height = static_cast<double>(size.height);
  return {id,
          CameraModelId::kSimplePinhole,
          static_cast<int>(size.width),
          static_cast<int>(size.height),
          {std::max(width, height), 0.5 * width, 0.5 * height},
          false};
}

// One camera per folder, with the size of its first image. Files before it are
// not images and will be rejected.
DatabaseContents RowsOf(const std::string& image_path,
                        const std::vector<std::string>& names) {
  DatabaseContents rows;
  rows.path = image_path;
  std::map<std::string, CameraId> camera_of_folder;
  for (const std::string& name : names) {
    const std::string folder = FolderOfName(name);
    if (camera_of_folder.count(folder) == 0) {
      const auto size = ReadImageSizeOf(fs::path(image_path) / name);
      if (!size) continue;
      const CameraId id(static_cast<uint32_t>(rows.cameras.size() + 1));
      rows.cameras.push_back(CameraOf(id, *size));
      camera_of_folder.emplace(folder, id);
    }
    rows.images.push_back(
        {ImageId(static_cast<uint32_t>(rows.images.size() + 1)),
         name,
         camera_of_folder.at(folder),
         {}});
  }
  return rows;
}

// Throws the Error that the rigs would cause after feature extraction: names of
// cameras, folders or image sizes that do not fit the configuration,
// calibration or rule. Does nothing if intrinsics or times decide.
void CheckRigsOfImages(const std::string& image_path,
                       const std::vector<std::string>& names,
                       const SceneLoadingOptions& loading) {
  const std::string& rule = loading.rig_name_rule;
  const bool has_rule = rule != "auto" && rule != "none";
  if (!has_rule && !loading.HasKnownRig()) return;
  if (loading.PairsFramesByTime()) return;
  DatabaseContents rows = RowsOf(image_path, names);
  if (rows.images.empty()) return;
  (void)BuildSceneOfRows("image folder", std::move(rows), loading, Context());
}

// Throws the Error that files with times, positions and gravity would cause
// after the matching, for malformed lines and names of unknown images.
void CheckValuesOfImages(const std::vector<std::string>& names,
                         const std::string& image_timestamps_path,
                         PosePriorOptions priors) {
  Scene scene;
  for (const std::string& name : names) {
    const auto id = static_cast<uint32_t>(scene.images.size() + 1);
    scene.images.push_back({ImageId(id), name, 0, 0, 0, {}});
  }
  // The sensors of the body are not known yet.
  if (!priors.body_calibration->empty()) {
    CheckBodyCalibration(priors.body_calibration);
    priors.body_calibration = std::string();
  }
  if (!image_timestamps_path.empty()) {
    CheckImageTimes(image_timestamps_path, names);
  }
  // Trajectories also need the frames.
  const std::string& positions = priors.ref_images_path;
  if (!positions.empty() && priors.ref_columns->empty() &&
      DetectPositionFormat(positions) == PositionFileFormat::kNamed) {
    (void)ReadPositionPriors(scene, "", priors);
  }
  if (!priors.gravity_path->empty() &&
      !HasTimedVectors(scene, priors.gravity_path)) {
    (void)ReadGravity(scene, "", priors);
  }
}

// Kind of images, under COLMAP's names.
enum class DataType { kVideo, kIndividual, kPanorama, kDualFisheye };

}  // namespace

template <>
struct EnumTable<DataType> {
  static constexpr std::pair<std::string_view, DataType> kNames[] = {
      {"video", DataType::kVideo},
      {"individual", DataType::kIndividual},
      {"panorama", DataType::kPanorama},
      {"dual_fisheye", DataType::kDualFisheye}};
};

namespace {

struct AutomaticReconstructorOptions {
  Option<std::string> workspace_path{
      "workspace_path", "", Required(),
      "Keep database.db and the models in `sparse` in this folder, which is "
      "created if missing. Features and matches in its database are reused."};
  Option<std::string> image_path{"image_path", "",
                                 "Read the images of this folder, with one "
                                 "subfolder per camera of the rig."};
  Option<std::string> video_path{
      "video_path", "",
      "Use these videos instead of images, one per camera of the rig, "
      "separated by spaces or commas. As in video_sampler, images are "
      "extracted into the folder `videos` of the workspace."};
  Option<std::string> recording_path{
      "recording_path", "",
      "Use the images of this recording instead: ROS 1 bags, MCAP or .db3 "
      "files "
      "of ROS 2, or folders of them, separated by spaces or commas. As in "
      "recording_importer, they are written into the folder `recording` of the "
      "workspace; its calibration and times make the rig, unless options say "
      "otherwise."};
  Option<DataType> data_type{
      "data_type", DataType::kVideo,
      "Choose the kind of images. video: in temporal order by name; matches "
      "neighbors and closes loops. individual: matches all pairs of images. "
      "panorama, dual_fisheye: a video whose images are first split into the "
      "folder `views` of the workspace, as in image_splitter."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Write models in binary or text format."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into its folder."};
  Option<bool> adopt_fisheyes{
      "adopt_fisheyes", true,
      "Use OPENCV_FISHEYE for cameras without given intrinsics or "
      "ImageReader.camera_model if their image pairs contradict a perspective "
      "camera and agree with a fisheye. 0: only warn about them."};
  LiveViewOptions live;
  VideoSamplingOptions video;
  RecordingImportOptions recording;
  SplittingOptions splitting;
  FeatureExtractionOptions extraction;
  MatchingInputOptions input;  // of the database in the workspace
  PosePriorOptions priors;
  SequentialMatchingOptions sequential;
  ExhaustiveMatchingOptions exhaustive;
  VocabularyOptions vocabulary;
  BaselineOptions baseline;
  MapperOptions mapper;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(workspace_path, image_path, video_path, recording_path, data_type,
          output_format, write_report, adopt_fisheyes, live, extraction,
          input.loading, priors, input.matching);
    visit.Group("Video", video);
    visit.Group("Recording", recording);
    visit.Group("Splitting", splitting);
    visit.Group("SequentialMatching", sequential);
    visit.Group("ExhaustiveMatching", exhaustive);
    visit.Group("VocabTree", vocabulary);
    visit(baseline.method, mapper);
  }
};

MatchingInput MatchImages(const AutomaticReconstructorOptions& options,
                          const Context& context) {
  MatchingInput input = OpenMatchingInput(options.input, context);
  // Bad priors are known before the matching.
  const std::string& database_path = options.input.database_path;
  const PositionPriors positions =
      ReadPositionPriors(input.scene, database_path, options.priors);
  if (options.mapper.estimate_antenna) {
    CheckAntenna(input.scene, positions, options.priors);
  }
  (void)ReadGravity(input.scene, database_path, options.priors);
  if (options.data_type == DataType::kIndividual) {
    MatchExhaustively(&input.database, input.scene, options.exhaustive,
                      options.input.matching, context);
  } else {
    MatchSequentially(&input.database, input.scene, options.sequential,
                      options.vocabulary, options.input.matching, context);
  }
  return input;
}

void Match(const AutomaticReconstructorOptions& options,
           const Context& context) {
  {
    MatchingInput input = MatchImages(options, context);
    const bool has_chosen_model = *options.extraction.reader.camera_model !=
                                  *ImageReaderOptions().camera_model;
    if (!options.adopt_fisheyes || has_chosen_model) {
      WarnOfFisheyes(input, options.input.matching, context);
      return;
    }
    const std::vector<FisheyeFinding> fisheyes = FindFisheyes(
        input.database, input.scene, options.input.matching, context);
    if (fisheyes.empty()) return;
    AdoptFisheyes(fisheyes, input.scene, &input.database);
    for (const FisheyeFinding& finding : fisheyes) {
      context.Info(
          DescribeEvidence(finding) +
          "; the model OPENCV_FISHEYE is used, unless a calibration or "
          "--adopt_fisheyes 0 is given");
    }
  }
  // The matches are in the database; their verification depends on the lens.
  (void)MatchImages(options, context);
}

// Matching and mapping both read the rigs; messages about them are logged once.
Context WithoutRepetitions(const Context& context) {
  Context once = context;
  const auto seen = std::make_shared<std::set<std::string>>();
  once.log = [seen, log = context.log](LogLevel level,
                                       const std::string& text) {
    if (log && seen->insert(text).second) log(level, text);
  };
  return once;
}

std::vector<std::string> NamesOf(const AutomaticReconstructorOptions& options) {
  return ListImages(options.image_path, options.extraction.image_list_path,
                    options.extraction.reader.mask_path,
                    options.extraction.reader.camera_mask_path);
}

// Splits the images; options of later steps refer to the result.
void UseViews(const fs::path& views_path, CombinedImages kind,
              const Context& context, AutomaticReconstructorOptions* options) {
  ImageReaderOptions& reader = options->extraction.reader;
  const bool is_panorama = kind == CombinedImages::kPanorama;
  const ImageRunSummary summary = SplitImages(
      {*options->image_path,
       NamesOf(*options),
       {*reader.mask_path, *reader.camera_mask_path},
       *reader.camera_params_path,
       views_path,
       is_panorama ? *options->input.loading.rig_config_path : std::string()},
      kind, options->splitting, context);
  context.Info("split " + Describe(summary) + "; the models are of " +
               (views_path / "images").string());
  options->image_path = (views_path / "images").string();
  options->extraction.image_list_path = "";
  if (!reader.mask_path->empty() || !reader.camera_mask_path->empty()) {
    reader.camera_mask_path = "";
    reader.mask_path = (views_path / "masks").string();
  }
  if (is_panorama) {
    reader.camera_params_path = (views_path / "cameras.txt").string();
    options->input.loading.rig_config_path =
        (views_path / "rig_config.json").string();
  } else if (reader.camera_params->empty()) {
    // Equidistant until refined.
    reader.camera_model = "OPENCV_FISHEYE";
    reader.default_focal_length_factor =
        1.0 / DegToRad(options->splitting.fisheye_field_of_view_deg);
  }
}

void CheckSource(const AutomaticReconstructorOptions& options) {
  const int num_sources = (options.image_path->empty() ? 0 : 1) +
                          (options.video_path->empty() ? 0 : 1) +
                          (options.recording_path->empty() ? 0 : 1);
  if (num_sources != 1) {
    throw Error(num_sources > 1
                    ? "set only one of --image_path, --video_path and "
                      "--recording_path"
                    : "option image_path is required: a folder of images; or "
                      "set video_path or recording_path");
  }
  CheckImagePath(options.image_path);
}

// Checks the paths that are read only after the time-consuming feature
// extraction.
void CheckPaths(const AutomaticReconstructorOptions& options) {
  const ImageReaderOptions& reader = options.extraction.reader;
  const SceneLoadingOptions& loading = options.input.loading;
  const PosePriorOptions& priors = options.priors;
  const std::pair<const char*, std::string> paths[] = {
      {"rig_config_path", loading.rig_config_path},
      {"calibration_path", loading.calibration_path},
      {"image_timestamps_path", loading.image_timestamps_path},
      {"ref_images_path", priors.ref_images_path},
      {"body_calibration", priors.body_calibration},
      {"gravity_path", priors.gravity_path},
      {"ImageReader.mask_path", reader.mask_path},
      {"ImageReader.camera_mask_path", reader.camera_mask_path},
      {"VocabTree.vocab_tree_path", options.vocabulary.vocab_tree_path}};
  for (const auto& [option, path] : paths) {
    std::error_code ignored;
    if (path.empty() || fs::exists(path, ignored)) continue;
    for (const std::string& item : SplitList(path)) {
      if (fs::exists(item, ignored)) continue;
      throw Error("'" + item + "' (--" + option +
                  ") does not exist; check the path");
    }
  }
}

// Options of later steps refer to the images of recordings, which also tell the
// rig.
void UseRecording(const fs::path& output_path, const Context& context,
                  AutomaticReconstructorOptions* options) {
  const RecordingImportSummary summary = ImportRecordingInto(
      output_path, options->recording_path, options->recording, context);
  options->image_path = (output_path / "images").string();
  SceneLoadingOptions& loading = options->input.loading;
  if (!loading.HasKnownRig() && !summary.rig_config_path.empty()) {
    loading.rig_config_path = summary.rig_config_path.string();
  }
  if (!loading.PairsFramesByTime()) {
    loading.frame_max_time_difference_s = summary.max_time_difference_s;
  }
}

void SplitCombinedImages(const fs::path& views, const Context& context,
                         AutomaticReconstructorOptions* options) {
  if (options->data_type == DataType::kPanorama) {
    UseViews(views, CombinedImages::kPanorama, context, options);
  } else if (options->data_type == DataType::kDualFisheye) {
    UseViews(views, CombinedImages::kDualFisheye, context, options);
  }
}

int RunAutomaticReconstructor(const AutomaticReconstructorOptions& given,
                              const Context& terminal) {
  const auto live = LiveView::Start(given.live, given.workspace_path, terminal);
  const Context context =
      WithoutRepetitions(live ? live->Watch(terminal) : terminal);
  AutomaticReconstructorOptions options = given;
  CheckSource(options);
  CheckPaths(options);
  const fs::path workspace = *options.workspace_path;
  if (!options.video_path->empty()) {
    const fs::path videos = workspace / "videos";
    SampleVideosInto(videos, options.video_path, options.video, context);
    options.image_path = (videos / "images").string();
  }
  if (!options.recording_path->empty()) {
    UseRecording(workspace / "recording", context, &options);
  }
  const std::vector<std::string> names = NamesOf(options);
  for (const std::string& name : names) {
    CheckFormat(name, options.output_format);
  }
  SplitCombinedImages(workspace / "views", context, &options);
  const std::vector<std::string> view_names = NamesOf(options);
  CheckRigsOfImages(options.image_path, view_names, options.input.loading);
  options.input.database_path = (workspace / "database.db").string();
  // The database of an earlier run may have more images.
  if (!fs::exists(*options.input.database_path)) {
    CheckValuesOfImages(view_names, options.input.loading.image_timestamps_path,
                        options.priors);
  }
  std::error_code error;
  fs::create_directories(workspace, error);
  if (!fs::is_directory(workspace)) {
    throw Error("--workspace_path '" + *options.workspace_path +
                "' cannot be created: " + error.message());
  }
  UseExifTimes(options.image_path, names, workspace / "timestamps.txt", context,
               &options.input.loading);
  { const StagedOutput sparse(workspace / "sparse"); }  // may be written
  ExtractInto(options.input.database_path, options.image_path,
              options.extraction, std::nullopt, context);
  Match(options, context);
  MapperRun run{options.input.database_path,
                (workspace / "sparse").string(),
                options.image_path,
                options.output_format,
                options.input.loading,
                options.priors,
                options.mapper,
                OptionsToJsonOf(given),
                OptionsToJsonOf(AutomaticReconstructorOptions())};
  run.baseline = options.baseline;
  run.write_report = options.write_report;
  run.live = live.get();
  return MapDatabase(run, context);
}

}  // namespace

Command AutomaticReconstructorCommand() {
  return MakeResumableCommand(
      "automatic_reconstructor",
      "Reconstructs models from folders of images, in one command.",
      RunAutomaticReconstructor);
}

}  // namespace mgsfm
