// SPDX-License-Identifier: BSD-3-Clause
#include "cmd_matching.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/ranges.h"
#include "command.h"
#include "commands.h"
#include "matching/fisheye_detection.h"
#include "matching/image_retrieval.h"
#include "matching/pair_matching.h"
#include "matching/pair_selection.h"
#include "mgsfm/base/error.h"
#include "mgsfm/matching/matching.h"
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
    context.Info(
        Formatted("share %s: %zu of %zu pairs verified, %zu were in the "
                  "database; %zu pairs in all shares",
                  share.ToString().c_str(), summary.num_verified,
                  summary.num_pairs, summary.num_done, pairs.size()));
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
  context.Info(Formatted("%zu images in %zu frames; rigs: %s",
                         rows.scene.images.size(), rows.scene.frames.size(),
                         rows.rig_source.c_str()));
  return {std::move(database), std::move(rows.scene)};
}

void WarnOfFisheyes(const MatchingInput& input,
                    const PairMatchingOptions& options,
                    const Context& context) {
  GroupedWarnings warnings;
  for (const FisheyeFinding& finding :
       FindFisheyes(input.database, input.scene, options, context)) {
    warnings.Add(Describe(finding));
  }
  warnings.Log(context);
}

namespace {

// The two ways to run a matching command: match(&input) matches all pairs into
// the database; or a share of the pairs that select(input) returns is matched
// into a shard. Returns an ExitCode.
template <class MatchPairs, class SelectPairs>
int RunMatcher(const MatchingInputOptions& options, const Context& context,
               const MatchPairs& match, const SelectPairs& select) {
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
  std::optional<Share> share;
  if (!options.shard->empty()) share = ParseShare(options.shard);
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

// The options of a matching command: the common ones and those of its method,
// which can match all pairs of a database and select them.
template <class Method>
struct MatcherOptions {
  MatchingInputOptions input;
  Method method;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input, method);
  }
};

template <class Method>
int RunMatcherOf(const MatcherOptions<Method>& options,
                 const Context& context) {
  const PairMatchingOptions& matching = options.input.matching;
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        options.method.Match(&input->database, input->scene, matching, context);
      },
      [&](const MatchingInput& input) {
        return options.method.Select(input, matching, context);
      });
}

struct ExhaustiveMethod {
  ExhaustiveMatchingOptions exhaustive;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit.Group("ExhaustiveMatching", exhaustive);
  }
  void Match(FeatureDatabase* database, const Scene& scene,
             const PairMatchingOptions& matching,
             const Context& context) const {
    MatchExhaustively(database, scene, exhaustive, matching, context);
  }
  ImagePairList Select(const MatchingInput& input, const PairMatchingOptions&,
                       const Context&) const {
    return SelectExhaustively(input.scene);
  }
};

struct SequentialMethod {
  SequentialMatchingOptions sequential;
  VocabularyOptions vocabulary;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit.Group("SequentialMatching", sequential);
    visit.Group("VocabTree", vocabulary);
  }
  void Match(FeatureDatabase* database, const Scene& scene,
             const PairMatchingOptions& matching,
             const Context& context) const {
    MatchSequentially(database, scene, sequential, vocabulary, matching,
                      context);
  }
  ImagePairList Select(const MatchingInput& input,
                       const PairMatchingOptions& matching,
                       const Context& context) const {
    return SelectSequentially(input.database, input.scene, sequential,
                              vocabulary, matching, context);
  }
};

struct VocabTreeMethod {
  VocabTreeMatchingOptions retrieval;
  VocabularyOptions vocabulary;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit.Group("VocabTreeMatching", retrieval);
    visit.Group("VocabTree", vocabulary);
  }
  void Match(FeatureDatabase* database, const Scene& scene,
             const PairMatchingOptions& matching,
             const Context& context) const {
    MatchByVocabulary(database, scene, retrieval, vocabulary, matching,
                      context);
  }
  ImagePairList Select(const MatchingInput& input, const PairMatchingOptions&,
                       const Context& context) const {
    return SelectByVocabulary(input.database, input.scene, retrieval,
                              vocabulary, context);
  }
};

struct SpatialMethod {
  SpatialMatchingOptions spatial;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit.Group("SpatialMatching", spatial);
  }
  void Match(FeatureDatabase* database, const Scene& scene,
             const PairMatchingOptions& matching,
             const Context& context) const {
    MatchSpatially(database, scene, spatial, matching, context);
  }
  ImagePairList Select(const MatchingInput& input, const PairMatchingOptions&,
                       const Context& context) const {
    return SelectSpatially(input.database, input.scene, spatial, context);
  }
};

struct ImportMethod {
  Option<std::string> match_list_path{"match_list_path", "", Required(),
                                      "Read pairs or matches from this text "
                                      "file; see docs/reference/formats.md."};
  Option<MatchListType> match_type{
      "match_type", MatchListType::kPairs,
      "Choose the content of the file: pairs to match, raw matches to verify, "
      "or inlier matches that are imported as they are."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(match_list_path, match_type);
  }
  void Match(FeatureDatabase* database, const Scene& scene,
             const PairMatchingOptions& matching,
             const Context& context) const {
    ImportMatches(database, scene, match_list_path, match_type, matching,
                  context);
  }
  ImagePairList Select(const MatchingInput& input, const PairMatchingOptions&,
                       const Context&) const {
    return SelectListed(input.scene, match_list_path);
  }
};

int RunMatchesImporter(const MatcherOptions<ImportMethod>& options,
                       const Context& context) {
  const bool has_part = !options.input.shard->empty() ||
                        !options.input.output_pairs_path->empty();
  if (has_part && options.method.match_type != MatchListType::kPairs) {
    throw Error(
        "--shard matches pairs; set --match_type pairs, or import the "
        "matches without --shard");
  }
  return RunMatcherOf(options, context);
}

struct GeometricVerifierOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add two-view geometries to this COLMAP database with matches; pairs "
      "that have them are skipped."};
  // Those for descriptors are not read.
  MatchingInputOptions input;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, input.shard, input.shard_path, input.output_pairs_path,
          input.loading);
    visit.Group("TwoViewGeometry", input.matching.two_view_geometry);
    visit.Group("FeatureMatching", input.matching.rig_verification);
  }
};

int RunGeometricVerifier(const GeometricVerifierOptions& options,
                         const Context& context) {
  MatchingInputOptions input_options = options.input;
  input_options.database_path = options.database_path;
  return RunMatcher(
      input_options, context,
      [&](MatchingInput* input) {
        VerifyMatches(&input->database, input->scene, options.input.matching,
                      context);
      },
      [&](const MatchingInput& input) {
        return SelectMatched(input.database, input.scene);
      });
}

struct VocabTreeBuilderOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Read the features of this database, which is not changed."};
  Option<std::string> vocab_tree_path{"vocab_tree_path", "", Required(),
                                      "Write the tree to this file."};
  Option<int> max_num_images{
      "max_num_images", -1, AtLeast(-1), "images",
      "Train on this many images, spaced evenly by name; -1 uses all."};
  Option<int> max_num_features{
      "max_num_features", 2000, AtLeast(-1), "features",
      "Sample from this many features per image, the largest first; -1 uses "
      "all."};
  VocabularyTrainingOptions training;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, vocab_tree_path, max_num_images, max_num_features,
          training);
  }
};

// Images by name, without rigs: the tree depends on the features only.
Scene ReadSample(const FeatureDatabase& database, int max_num_images,
                 const Context& context) {
  DatabaseContents contents = database.ReadStructure(context);
  std::vector<ImageRow> images = std::move(contents.images);
  SortBy(&images, &ImageRow::name);
  const size_t size = images.size();
  const size_t num_chosen =
      max_num_images < 0 ? size
                         : std::min(size, static_cast<size_t>(max_num_images));
  Scene scene;
  for (size_t k = 0; k < num_chosen; ++k) {
    const ImageRow& image = images[k * size / num_chosen];
    scene.images.push_back({image.id, image.name, 0, 0, 0, {}, {}});
  }
  return scene;
}

int RunVocabTreeBuilder(const VocabTreeBuilderOptions& options,
                        const Context& context) {
  const FeatureDatabase database(options.database_path,
                                 FeatureDatabase::OpenMode::kReadOnly);
  const Scene scene = ReadSample(database, options.max_num_images, context);
  std::optional<Vocabulary> vocabulary;
  if (!scene.images.empty()) {
    vocabulary = TrainVocabulary(database, scene, options.training,
                                 options.max_num_features, context);
  }
  if (!vocabulary) {
    throw Error("database '" + *options.database_path +
                "' has no features; run feature_extractor first");
  }
  database.CheckUnchanged();
  vocabulary->Write(options.vocab_tree_path);
  context.Info(Formatted("%d visual words from %zu images",
                         vocabulary->num_words(), scene.images.size()));
  return kExitSuccess;
}

}  // namespace

std::vector<Command> MatchingCommands() {
  return {
      MakeResumableCommand(
          "sequential_matcher",
          "Matches consecutive images of a moving rig and closes loops.",
          RunMatcherOf<SequentialMethod>),
      MakeResumableCommand("exhaustive_matcher", "Matches all pairs of images.",
                           RunMatcherOf<ExhaustiveMethod>),
      MakeResumableCommand("vocab_tree_matcher",
                           "Matches each image with the most similar ones.",
                           RunMatcherOf<VocabTreeMethod>),
      MakeResumableCommand("spatial_matcher",
                           "Matches images with nearby position priors.",
                           RunMatcherOf<SpatialMethod>),
      MakeCommand("vocab_tree_builder",
                  "Trains a vocabulary tree for image retrieval.",
                  RunVocabTreeBuilder),
      MakeResumableCommand("matches_importer",
                           "Imports pairs or matches from a text file.",
                           RunMatchesImporter),
      MakeResumableCommand(
          "geometric_verifier",
          "Verifies the matches of a database, for any kind of features.",
          RunGeometricVerifier)};
}

}  // namespace mgsfm
