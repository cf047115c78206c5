// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "mgsfm/features/feature_import.h"

namespace mgsfm {
namespace {

struct FeatureImporterOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add features to this COLMAP database, which is created if missing."};
  FeatureImportOptions import;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, import);
  }
};

int RunFeatureImporter(const FeatureImporterOptions& options,
                       const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kOrCreate);
  const FeatureImportSummary summary =
      ImportFeatures(options.import, &database, context);
  context.Info(std::to_string(summary.num_features) + " features of " +
               std::to_string(summary.num_images - summary.num_present) +
               " images, " + std::to_string(summary.num_present) +
               " images already had features; " +
               std::to_string(summary.num_matches) + " matches of " +
               std::to_string(summary.num_pairs) + " pairs");
  context.Info("next: verify the matches with geometric_verifier");
  return kExitSuccess;
}

}  // namespace

Command FeatureImporterCommand() {
  return MakeCommand(
      "feature_importer",
      "Imports features and matches of other programs, in hloc's format.",
      RunFeatureImporter);
}

}  // namespace mgsfm
