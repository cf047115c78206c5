// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "command.h"
#include "commands.h"
#include "early_checks.h"
#include "exif_times.h"
#include "extraction_run.h"
#include "files/staged_output.h"
#include "geometry/so3.h"
#include "image_run_summary.h"
#include "imaging/image_splitting.h"
#include "live_view.h"
#include "mapper_run.h"
#include "matching/lens_check.h"
#include "matching_input.h"
#include "mgsfm/base/error.h"
#include "mgsfm/matching/matching.h"
#include "video/video_sampling.h"
#include "video_run.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

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
      "separated by blanks or commas. Images are extracted, as by "
      "video_sampler, into the folder `videos` of the workspace."};
  Option<DataType> data_type{
      "data_type", DataType::kVideo,
      "Choose the kind of images. video: in temporal order by name; matches "
      "neighbors and closes loops. individual: matches all pairs of images. "
      "panorama, dual_fisheye: a video whose images are first split, as by "
      "image_splitter, into the folder `views` of the workspace."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Write models in binary or text format."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into its folder."};
  Option<bool> adopt_fisheyes{
      "adopt_fisheyes", true,
      "Use the model OPENCV_FISHEYE for cameras without given intrinsics or "
      "ImageReader.camera_model whose image pairs contradict a perspective "
      "camera and agree with a fisheye. Otherwise, a warning names them."};
  LiveViewOptions live;
  VideoSamplingOptions video;
  SplittingOptions splitting;
  FeatureExtractionOptions extraction;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  PairMatchingOptions matching;
  SequentialMatchingOptions sequential;
  ExhaustiveMatchingOptions exhaustive;
  VocabularyOptions vocabulary;
  MapperOptions mapper;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(workspace_path, image_path, video_path, data_type, output_format,
          write_report, adopt_fisheyes, live, extraction, loading, priors,
          matching);
    visit.Group("Video", video);
    visit.Group("Splitting", splitting);
    visit.Group("SequentialMatching", sequential);
    visit.Group("ExhaustiveMatching", exhaustive);
    visit.Group("VocabTree", vocabulary);
    visit(mapper);
  }
};

MatchingInput MatchImages(const MatchingInputOptions& input_options,
                          const AutomaticReconstructorOptions& options,
                          const Context& context) {
  MatchingInput input = OpenMatchingInput(input_options, context);
  // What is wrong with them is known before the matching.
  (void)ReadPositionPriors(input.scene, *input_options.database_path,
                           options.priors);
  (void)ReadGravity(input.scene, *input_options.database_path, options.priors);
  if (options.data_type == DataType::kIndividual) {
    MatchExhaustively(&input.database, input.scene, options.exhaustive,
                      options.matching, context);
  } else {
    MatchSequentially(&input.database, input.scene, options.sequential,
                      options.vocabulary, options.matching, context);
  }
  return input;
}

void Match(const std::string& database_path,
           const AutomaticReconstructorOptions& options,
           const Context& context) {
  MatchingInputOptions input_options;
  input_options.database_path = database_path;
  input_options.loading = options.loading;
  input_options.matching = options.matching;
  {
    MatchingInput input = MatchImages(input_options, options, context);
    const bool has_chosen_model = *options.extraction.reader.camera_model !=
                                  *ImageReaderOptions().camera_model;
    if (!options.adopt_fisheyes || has_chosen_model) {
      WarnOfFisheyes(input, options.matching, context);
      return;
    }
    const std::vector<FisheyeFinding> fisheyes =
        FindFisheyes(input.database, input.scene,
                     options.matching.two_view_geometry, context);
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
  (void)MatchImages(input_options, options, context);
}

// Matching and mapping both read the rigs; what they say about them is logged
// once.
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
                    options.extraction.reader.mask_path);
}

// Splits the images; the options of all that follows refer to the result.
void UseViews(const fs::path& views_path, CombinedImages kind,
              const Context& context, AutomaticReconstructorOptions* options) {
  ImageReaderOptions& reader = options->extraction.reader;
  const bool is_panorama = kind == CombinedImages::kPanorama;
  const ImageRunSummary summary = SplitImages(
      {*options->image_path, NamesOf(*options), *reader.mask_path,
       *reader.camera_params_path, views_path,
       is_panorama ? *options->loading.rig_config_path : std::string()},
      kind, options->splitting, context);
  context.Info("split " + Describe(summary) + "; the models are of " +
               (views_path / "images").string());
  options->image_path = (views_path / "images").string();
  options->extraction.image_list_path = "";
  if (!reader.mask_path->empty()) {
    reader.mask_path = (views_path / "masks").string();
  }
  if (is_panorama) {
    reader.camera_params_path = (views_path / "cameras.txt").string();
    options->loading.rig_config_path =
        (views_path / "rig_config.json").string();
  } else if (reader.camera_params->empty()) {
    // Equidistant, until it is refined.
    reader.camera_model = "OPENCV_FISHEYE";
    reader.default_focal_length_factor =
        1.0 / DegToRad(options->splitting.fisheye_field_of_view_deg);
  }
}

void CheckSource(const AutomaticReconstructorOptions& options) {
  const bool has_images = !options.image_path->empty();
  if (has_images == !options.video_path->empty()) {
    throw Error(has_images ? "set only one of --image_path and --video_path"
                           : "option image_path is required: a folder of "
                             "images; or set video_path");
  }
  if (has_images && !fs::is_directory(*options.image_path)) {
    throw Error("--image_path '" + *options.image_path + "' is not a folder");
  }
}

// Checks the inputs that are read only after the extraction of features, which
// takes long.
void CheckPaths(const AutomaticReconstructorOptions& options) {
  const ImageReaderOptions& reader = options.extraction.reader;
  const SceneLoadingOptions& loading = options.loading;
  const PosePriorOptions& priors = options.priors;
  CheckPathsExist(
      {{"rig_config_path", loading.rig_config_path},
       {"calibration_path", loading.calibration_path},
       {"image_timestamps_path", loading.image_timestamps_path},
       {"ref_images_path", priors.ref_images_path},
       {"gravity_path", priors.gravity_path},
       {"ImageReader.mask_path", reader.mask_path},
       {"ImageReader.camera_mask_path", reader.camera_mask_path},
       {"VocabTree.vocab_tree_path", options.vocabulary.vocab_tree_path}});
}

// The options of all that follows refer to the extracted images.
void UseVideos(const fs::path& output_path, const Context& context,
               AutomaticReconstructorOptions* options) {
  SampleVideosInto(output_path, options->video_path, options->video, context);
  options->image_path = (output_path / "images").string();
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
    UseVideos(workspace / "videos", context, &options);
  }
  const std::vector<std::string> names = NamesOf(options);
  for (const std::string& name : names) {
    CheckFormat(name, options.output_format);
  }
  if (options.data_type == DataType::kPanorama ||
      options.data_type == DataType::kDualFisheye) {
    UseViews(workspace / "views",
             options.data_type == DataType::kPanorama
                 ? CombinedImages::kPanorama
                 : CombinedImages::kDualFisheye,
             context, &options);
  }
  const std::vector<std::string> view_names = NamesOf(options);
  CheckRigsOfImages(options.image_path, view_names, options.loading);
  const std::string database_path = (workspace / "database.db").string();
  // The database of an earlier run may have more images.
  if (!fs::exists(database_path)) {
    CheckValuesOfImages(view_names, options.loading.image_timestamps_path,
                        options.priors);
  }
  std::error_code error;
  fs::create_directories(workspace, error);
  if (!fs::is_directory(workspace)) {
    throw Error("--workspace_path '" + *options.workspace_path +
                "' cannot be created: " + error.message());
  }
  UseExifTimes(options.image_path, names, workspace / "timestamps.txt", context,
               &options.loading);
  { const StagedOutput sparse(workspace / "sparse"); }  // may be written
  ExtractInto(database_path, options.image_path, options.extraction,
              std::nullopt, context);
  Match(database_path, options, context);
  MapperRun run{database_path,      (workspace / "sparse").string(),
                options.image_path, options.output_format,
                options.loading,    options.priors,
                options.mapper,     OptionsToJsonOf(given)};
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
