// SPDX-License-Identifier: BSD-3-Clause
#include <optional>
#include <string>

#include "command.h"
#include "commands.h"
#include "extraction_run.h"

namespace mgsfm {
namespace {

struct FeatureExtractorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add features to this COLMAP database, which is created if missing. "
      "Images that have features there are skipped."};
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Read the images of this folder and its subfolders."};
  Option<std::string> shard{
      "shard", "",
      "Extract share i of n, as in 3/8, into a database of its own, which "
      "database_merger joins with the others. Set it to use several processes "
      "or machines."};
  FeatureExtractionOptions extraction;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, shard, extraction);
  }
};

int RunFeatureExtractor(const FeatureExtractorOptions& options,
                        const Context& context) {
  std::optional<Share> share;
  if (!options.shard->empty()) share = ParseShare(options.shard);
  ExtractInto(options.database_path, options.image_path, options.extraction,
              share, context);
  return kExitSuccess;
}

}  // namespace

Command FeatureExtractorCommand() {
  return MakeResumableCommand("feature_extractor",
                              "Extracts SIFT features from images.",
                              RunFeatureExtractor);
}

}  // namespace mgsfm
