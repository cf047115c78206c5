// SPDX-License-Identifier: BSD-3-Clause
#include "extraction_run.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>

#include "base/format.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {
namespace {

void LogSummary(const FeatureExtractionSummary& summary,
                const Context& context) {
  const std::string rate =
      Formatted(" in %.1f s, %.3g images/s", summary.seconds,
                static_cast<double>(summary.num_extracted) /
                    std::max(summary.seconds, 1e-9));
  context.Info(std::to_string(summary.num_features) + " features of " +
               std::to_string(summary.num_extracted) + " images" + rate + "; " +
               std::to_string(summary.num_present) +
               " images already had features, " +
               std::to_string(summary.num_rejected) + " were rejected");
}

}  // namespace

void ExtractInto(const std::string& database_path,
                 const std::string& image_path,
                 const FeatureExtractionOptions& options,
                 const std::optional<Share>& share, const Context& context) {
  const bool is_new = !std::filesystem::exists(database_path);
  std::optional<FeatureDatabase> database(std::in_place, database_path,
                                          FeatureDatabase::OpenMode::kOrCreate);
  try {
    LogSummary(share
                   ? ExtractFeatureShard(image_path, options, *share,
                                         &*database, context)
                   : ExtractFeatures(image_path, options, &*database, context),
               context);
  } catch (const Error&) {
    // A failed run leaves no empty database.
    const bool is_empty =
        is_new && database->ReadStructure(context).images.empty();
    database.reset();
    std::error_code ignored;
    if (is_empty) std::filesystem::remove(database_path, ignored);
    throw;
  }
}

}  // namespace mgsfm
