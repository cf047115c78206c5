// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>

#include "command.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "mgsfm/features/feature_extraction.h"
#include "mgsfm/io/feature_database.h"

namespace mgsfm {
namespace {

struct FeatureExtractorOptions {
  std::string database_path;
  std::string image_path;
  FeatureExtractionOptions extraction;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("database_path", self.database_path, Required(), "",
          "COLMAP database to add to; made if there is none. Images that have "
          "features there are not done again.");
    visit("image_path", self.image_path, Required(), "",
          "Folder of images; those in its folders are taken, too.");
    FeatureExtractionOptions::Describe(self.extraction, visit);
  }
};

void LogSummary(const FeatureExtractionSummary& summary,
                const Context& context) {
  char rate[64];
  std::snprintf(rate, sizeof(rate), " in %.1f s, %.3g images/s",
                summary.seconds,
                static_cast<double>(summary.num_extracted) /
                    std::max(summary.seconds, 1e-9));
  context.Info(std::to_string(summary.num_features) + " features of " +
               std::to_string(summary.num_extracted) + " images" + rate + "; " +
               std::to_string(summary.num_present) +
               " images had features before, " +
               std::to_string(summary.num_refused) + " were left out");
}

int RunFeatureExtractor(const FeatureExtractorOptions& options,
                        const Context& context) {
  const bool is_new = !std::filesystem::exists(options.database_path);
  std::optional<FeatureDatabase> database(std::in_place, options.database_path,
                                          FeatureDatabase::OpenMode::kOrCreate);
  try {
    LogSummary(ExtractFeatures(options.image_path, options.extraction,
                               &*database, context),
               context);
  } catch (const Error&) {
    // A run that finds nothing to do leaves no empty file.
    const bool is_empty =
        is_new && database->ReadStructure(context).images.empty();
    database.reset();
    std::error_code ignored;
    if (is_empty) std::filesystem::remove(options.database_path, ignored);
    throw;
  }
  return kExitSuccess;
}

}  // namespace

Command FeatureExtractorCommand() {
  return MakeCommandThatGoesOn("feature_extractor",
                               "Finds SIFT features in images.",
                               RunFeatureExtractor);
}

}  // namespace mgsfm
