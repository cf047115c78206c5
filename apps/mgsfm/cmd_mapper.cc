// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "mapper_run.h"

namespace mgsfm {
namespace {

struct MapperCommandOptions {
  std::string database_path;
  std::string output_path;
  std::string image_path;
  std::string input_path;
  std::string image_list_path;
  ModelFormat output_format = ModelFormat::kBinary;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  std::string image_timestamps_path;
  BaselineOptions baseline;
  MapperOptions mapper;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("database_path", self.database_path, Required(), "",
          "COLMAP database with verified matches. It is only read.");
    visit(
        "output_path", self.output_path, Required(), "",
        "Folder for the models 0, 1, ... and report.json. Those of an earlier "
        "run are replaced when the new ones are complete; other files stay.");
    visit("image_path", self.image_path, AnyValue(), "",
          "Folder of the images, to colour the points. Without it, all points "
          "are black.");
    visit("input_path", self.input_path, AnyValue(), "",
          "Folder of a model to extend: adds the frames of the database that "
          "it lacks.");
    visit("image_list_path", self.image_list_path, AnyValue(), "",
          "File with one image name per line; uses only these images and those "
          "of the model to extend.");
    visit("output_format", self.output_format, AnyValue(), "",
          "Format of the models: binary or text.");
    SceneLoadingOptions::Describe(self.loading, visit);
    PosePriorOptions::Describe(self.priors, visit);
    visit("image_timestamps_path", self.image_timestamps_path, AnyValue(), "",
          "File with a line `image_name SECONDS` for every image: its time of "
          "exposure. SoftRig.method time_offset needs it.");
    BaselineOptions::Describe(self.baseline, visit);
    MapperOptions::Describe(self.mapper, visit);
    visit.Group("Mapper", self.mapper.extension);
  }
};

int RunMapperCommand(const MapperCommandOptions& options,
                     const Context& context) {
  return MapDatabase(
      {options.database_path, options.output_path, options.image_path,
       options.output_format, options.loading, options.priors, options.mapper,
       OptionsToJsonOf(options), options.image_timestamps_path,
       options.input_path, options.image_list_path, options.baseline},
      context);
}

}  // namespace

Command MapperCommand() {
  return MakeCommand("mapper",
                     "Reconstructs models from the matches of a database.",
                     RunMapperCommand);
}

}  // namespace mgsfm
