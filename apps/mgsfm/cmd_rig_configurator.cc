// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <string>
#include <vector>

#include "command.h"
#include "commands.h"
#include "exif_times.h"
#include "mapper_run.h"
#include "mgsfm/database/feature_database.h"
#include "models/rows_to_scene.h"

namespace mgsfm {
namespace {

struct RigConfiguratorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Replace the rigs and frames of this COLMAP database; its features and "
      "matches stay."};
  Option<std::string> image_path{
      "image_path", "",
      "Read the EXIF times of the images in this folder if "
      "frame_max_time_difference_s needs them and a name has none, and write "
      "them to timestamps.txt beside the database."};
  SceneLoadingOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, rigs);
  }
};

// The rigs with times from the EXIF tags of images, if they are needed.
SceneLoadingOptions WithExifTimes(const RigConfiguratorOptions& options,
                                  const FeatureDatabase& database,
                                  const Context& context) {
  SceneLoadingOptions rigs = options.rigs;
  if (options.image_path->empty()) return rigs;
  CheckImagePath(options.image_path);
  std::vector<std::string> names;
  for (const ImageRow& image : database.ReadStructure(context).images) {
    names.push_back(image.name);
  }
  const std::filesystem::path path = *options.database_path;
  UseExifTimes(options.image_path, names, path.parent_path() / "timestamps.txt",
               context, &rigs);
  return rigs;
}

int RunRigConfigurator(const RigConfiguratorOptions& options,
                       const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kExisting);
  const RigConfigurationSummary summary = ConfigureRigs(
      WithExifTimes(options, database, context), &database, context);
  context.Info("rigs from " + summary.rig_source + ": " +
               std::to_string(summary.num_rigs) + " rigs of " +
               std::to_string(summary.num_sensors) + " cameras, " +
               std::to_string(summary.num_frames) + " frames, " +
               std::to_string(summary.num_images) + " images");
  return kExitSuccess;
}

}  // namespace

Command RigConfiguratorCommand() {
  return MakeCommand("rig_configurator",
                     "Writes rigs and frames to a database.",
                     RunRigConfigurator);
}

}  // namespace mgsfm
