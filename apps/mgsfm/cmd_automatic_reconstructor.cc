// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <string>

#include "command.h"
#include "commands.h"
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
  std::string workspace_path;
  std::string image_path;
  DataType data_type = DataType::kVideo;
  ModelFormat output_format = ModelFormat::kBinary;
  FeatureExtractionOptions extraction;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  std::string image_timestamps_path;
  PairMatchingOptions matching;
  SequentialMatchingOptions sequential;
  ExhaustiveMatchingOptions exhaustive;
  VocabularyOptions vocabulary;
  MapperOptions mapper;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("workspace_path", self.workspace_path, Required(), "",
          "Folder for database.db and the models in `sparse`; created if "
          "missing. Features and matches in its database are reused.");
    visit("image_path", self.image_path, Required(), "",
          "Folder of images, with one subfolder per camera of the rig.");
    visit("data_type", self.data_type, AnyValue(), "",
          "video: images in temporal order by name; matches neighbours and "
          "closes loops. individual: matches all pairs of images.");
    visit("output_format", self.output_format, AnyValue(), "",
          "Format of the models: binary or text.");
    FeatureExtractionOptions::Describe(self.extraction, visit);
    SceneLoadingOptions::Describe(self.loading, visit);
    PosePriorOptions::Describe(self.priors, visit);
    visit("image_timestamps_path", self.image_timestamps_path, AnyValue(), "",
          "File with a line `image_name SECONDS` for every image: its time of "
          "exposure. SoftRig.method time_offset needs it.");
    PairMatchingOptions::Describe(self.matching, visit);
    visit.Group("SequentialMatching", self.sequential);
    visit.Group("ExhaustiveMatching", self.exhaustive);
    visit.Group("VocabTree", self.vocabulary);
    MapperOptions::Describe(self.mapper, visit);
  }
};

void Match(const std::string& database_path,
           const AutomaticReconstructorOptions& options,
           const Context& context) {
  MatchingInput input = OpenMatchingInput(
      {database_path, options.loading, options.matching}, context);
  if (options.data_type == DataType::kVideo) {
    MatchSequentially(&input.database, input.scene, options.sequential,
                      options.vocabulary, options.matching, context);
  } else {
    MatchExhaustively(&input.database, input.scene, options.exhaustive,
                      options.matching, context);
  }
}

int RunAutomaticReconstructor(const AutomaticReconstructorOptions& options,
                              const Context& context) {
  if (!std::filesystem::is_directory(options.image_path)) {
    throw Error("--image_path '" + options.image_path + "' is not a folder");
  }
  for (const std::string& name :
       ListImages(options.image_path, options.extraction.image_list_path)) {
    CheckFormat(name, options.output_format);
  }
  const std::filesystem::path workspace = options.workspace_path;
  std::error_code error;
  std::filesystem::create_directories(workspace, error);
  if (!std::filesystem::is_directory(workspace)) {
    throw Error("--workspace_path '" + options.workspace_path +
                "' cannot be created: " + error.message());
  }
  const std::string database_path = (workspace / "database.db").string();
  ExtractInto(database_path, options.image_path, options.extraction, context);
  Match(database_path, options, context);
  return MapDatabase(
      {database_path, (workspace / "sparse").string(), options.image_path,
       options.output_format, options.loading, options.priors, options.mapper,
       OptionsToJsonOf(options), options.image_timestamps_path},
      context);
}

}  // namespace

Command AutomaticReconstructorCommand() {
  return MakeResumableCommand(
      "automatic_reconstructor",
      "Reconstructs models from folders of images, in one command.",
      RunAutomaticReconstructor);
}

}  // namespace mgsfm
