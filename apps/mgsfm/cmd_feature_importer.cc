// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <optional>
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
      "COLMAP database to add to; created if missing."};
  FeatureImportOptions import;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, import);
  }
};

int RunFeatureImporter(const FeatureImporterOptions& options,
                       const Context& context) {
  const std::string& path = options.database_path;
  const bool is_new = !std::filesystem::exists(path);
  std::optional<FeatureDatabase> database(std::in_place, path,
                                          FeatureDatabase::OpenMode::kOrCreate);
  FeatureImportSummary summary;
  try {
    summary = ImportFeatures(options.import, &*database, context);
  } catch (...) {
    // A failed run leaves no empty database.
    database.reset();
    std::error_code ignored;
    if (is_new) std::filesystem::remove(path, ignored);
    throw;
  }
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
