// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "extraction_run.h"

namespace mgsfm {
namespace {

struct FeatureExtractorOptions {
  std::string database_path;
  std::string image_path;
  FeatureExtractionOptions extraction;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("database_path", self.database_path, Required(), "",
          "COLMAP database to add to; created if missing. Images that have "
          "features there are skipped.");
    visit("image_path", self.image_path, Required(), "",
          "Folder of images, searched recursively.");
    FeatureExtractionOptions::Describe(self.extraction, visit);
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
