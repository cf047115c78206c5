// SPDX-License-Identifier: BSD-3-Clause
#include "matching_input.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>
#include <utility>

#include "base/grouped_warnings.h"
#include "command.h"
#include "matching/fisheye_detection.h"
#include "matching/pair_matching.h"
#include "matching/pair_selection.h"
#include "mgsfm/base/error.h"
#include "models/rows_to_scene.h"

namespace mgsfm {
namespace {

void MatchShareInto(const MatchingInputOptions& options,
                    const MatchingInput& input, const ImagePairList& pairs,
                    const Share& share, const Context& context) {
  const std::string& path = options.shard_path;
  const bool is_new = !std::filesystem::exists(path);
  std::optional<FeatureDatabase> shard(std::in_place, path,
                                       FeatureDatabase::OpenMode::kOrCreate);
  try {
    const PairMatchingSummary summary =
        MatchShare(input.database, input.scene, pairs, share, options.matching,
                   &*shard, context);
    context.Info("share " + share.ToString() + ": " +
                 std::to_string(summary.num_verified) + " of " +
                 std::to_string(summary.num_pairs) + " pairs verified, " +
                 std::to_string(summary.num_done) + " were in the database; " +
                 std::to_string(pairs.size()) + " pairs in all shares");
  } catch (const Error&) {
    // A failed run leaves no empty shard.
    const bool is_empty = is_new && shard->CountMatches().empty();
    shard.reset();
    std::error_code ignored;
    if (is_empty) std::filesystem::remove(path, ignored);
    throw;
  }
}

}  // namespace

MatchingInput OpenMatchingInput(const MatchingInputOptions& options,
                                const Context& context,
                                FeatureDatabase::OpenMode mode) {
  FeatureDatabase database(options.database_path, mode);
  DatabaseContents contents = database.ReadStructure(context);
  if (contents.images.empty()) {
    throw Error("database '" + *options.database_path +
                "' has no images; run feature_extractor first");
  }
  SceneOfRows rows = BuildSceneOfRows("database", std::move(contents),
                                      options.loading, context);
  context.Info(std::to_string(rows.scene.images.size()) + " images in " +
               std::to_string(rows.scene.frames.size()) +
               " frames; rigs: " + rows.rig_source);
  return {std::move(database), std::move(rows.scene)};
}

void WarnOfFisheyes(const MatchingInput& input,
                    const PairMatchingOptions& options,
                    const Context& context) {
  GroupedWarnings warnings;
  for (const FisheyeFinding& finding : FindFisheyes(
           input.database, input.scene, options.two_view_geometry, context)) {
    warnings.Add(Describe(finding));
  }
  warnings.Log(context);
}

int RunMatcher(
    const MatchingInputOptions& options, const Context& context,
    const std::function<void(MatchingInput*)>& match,
    const std::function<ImagePairList(const MatchingInput&)>& select) {
  if (options.shard->empty() != options.shard_path->empty()) {
    throw Error(
        "--shard and --shard_path belong together: the share of the "
        "pairs, and the database for their matches");
  }
  if (!options.shard->empty() && !options.output_pairs_path->empty()) {
    throw Error(
        "--output_pairs_path only selects pairs, and --shard matches "
        "them; set one of them");
  }
  if (options.shard->empty() && options.output_pairs_path->empty()) {
    MatchingInput input = OpenMatchingInput(options, context);
    match(&input);
    WarnOfFisheyes(input, options.matching, context);
    return kExitSuccess;
  }
  const std::optional<Share> share =
      options.shard->empty() ? std::nullopt
                             : std::optional(ParseShare(options.shard));
  const MatchingInput input =
      OpenMatchingInput(options, context, FeatureDatabase::OpenMode::kReadOnly);
  const ImagePairList pairs = select(input);
  if (share) {
    MatchShareInto(options, input, pairs, *share, context);
    return kExitSuccess;
  }
  input.database.CheckUnchanged();
  WritePairList(pairs, input.scene, options.output_pairs_path);
  context.Info(std::to_string(pairs.size()) + " pairs selected");
  return kExitSuccess;
}

}  // namespace mgsfm
