// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "command.h"
#include "commands.h"
#include "exif_times.h"
#include "extraction_run.h"
#include "mapper_run.h"
#include "matching_input.h"
#include "mgsfm/base/error.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

// Kind of images, under COLMAP's names.
enum class DataType { kVideo, kIndividual };

}  // namespace

template <>
struct EnumTable<DataType> {
  static constexpr std::pair<std::string_view, DataType> kNames[] = {
      {"video", DataType::kVideo}, {"individual", DataType::kIndividual}};
};

namespace {

struct AutomaticReconstructorOptions {
  Option<std::string> workspace_path{
      "workspace_path", "", Required(),
      "Folder for database.db and the models in `sparse`; created if missing. "
      "Features and matches in its database are reused."};
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Folder of images, with one subfolder per camera of the rig."};
  Option<DataType> data_type{
      "data_type", DataType::kVideo,
      "video: images in temporal order by name; matches neighbours and closes "
      "loops. individual: matches all pairs of images."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Format of the models: binary or text."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into its folder."};
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
    visit(workspace_path, image_path, data_type, output_format, write_report,
          extraction, loading, priors, matching);
    visit.Group("SequentialMatching", sequential);
    visit.Group("ExhaustiveMatching", exhaustive);
    visit.Group("VocabTree", vocabulary);
    visit(mapper);
  }
};

void Match(const std::string& database_path,
           const AutomaticReconstructorOptions& options,
           const Context& context) {
  MatchingInputOptions input_options;
  input_options.database_path = database_path;
  input_options.loading = options.loading;
  input_options.matching = options.matching;
  MatchingInput input = OpenMatchingInput(input_options, context);
  if (options.data_type == DataType::kVideo) {
    MatchSequentially(&input.database, input.scene, options.sequential,
                      options.vocabulary, options.matching, context);
  } else {
    MatchExhaustively(&input.database, input.scene, options.exhaustive,
                      options.matching, context);
  }
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

int RunAutomaticReconstructor(const AutomaticReconstructorOptions& given,
                              const Context& terminal) {
  const Context context = WithoutRepetitions(terminal);
  AutomaticReconstructorOptions options = given;
  if (!std::filesystem::is_directory(*options.image_path)) {
    throw Error("--image_path '" + *options.image_path + "' is not a folder");
  }
  const std::vector<std::string> names =
      ListImages(options.image_path, options.extraction.image_list_path);
  for (const std::string& name : names) {
    CheckFormat(name, options.output_format);
  }
  const std::filesystem::path workspace = *options.workspace_path;
  std::error_code error;
  std::filesystem::create_directories(workspace, error);
  if (!std::filesystem::is_directory(workspace)) {
    throw Error("--workspace_path '" + *options.workspace_path +
                "' cannot be created: " + error.message());
  }
  const std::string database_path = (workspace / "database.db").string();
  UseExifTimes(options.image_path, names, workspace / "timestamps.txt", context,
               &options.loading);
  ExtractInto(database_path, options.image_path, options.extraction, context);
  Match(database_path, options, context);
  MapperRun run{database_path,      (workspace / "sparse").string(),
                options.image_path, options.output_format,
                options.loading,    options.priors,
                options.mapper,     OptionsToJsonOf(options)};
  run.write_report = options.write_report;
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
