// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "extraction_run.h"

namespace mgsfm {
namespace {

struct FeatureExtractorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "COLMAP database to add to; created if missing. Images that have "
      "features there are skipped."};
  Option<std::string> image_path{"image_path", "", Required(),
                                 "Folder of images, searched recursively."};
  FeatureExtractionOptions extraction;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, extraction);
  }
};

int RunFeatureExtractor(const FeatureExtractorOptions& options,
                        const Context& context) {
  ExtractInto(options.database_path, options.image_path, options.extraction,
              context);
  return kExitSuccess;
}

}  // namespace

Command FeatureExtractorCommand() {
  return MakeResumableCommand("feature_extractor",
                              "Extracts SIFT features from images.",
                              RunFeatureExtractor);
}

}  // namespace mgsfm
