// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "io/models/rig_configuration.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {
namespace {

struct RigConfiguratorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "COLMAP database. Replaces its rigs and frames; keeps features and "
      "matches."};
  SceneLoadingOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, rigs);
  }
};

int RunRigConfigurator(const RigConfiguratorOptions& options,
                       const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kExisting);
  const RigConfigurationSummary summary =
      ConfigureRigs(options.rigs, &database, context);
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
