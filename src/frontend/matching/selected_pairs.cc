// SPDX-License-Identifier: BSD-3-Clause
#include "matching/selected_pairs.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "database/sqlite_snapshot.h"
#include "files/file_operations.h"
#include "matching/database_words.h"
#include "matching/match_list.h"
#include "matching/pair_lists.h"
#include "matching/pair_matching.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/error.h"
#include "mgsfm/priors/pose_priors.h"

namespace mgsfm {
namespace {

ImagePairList RetrievedPairs(const FeatureDatabase& database,
                             const Scene& scene,
                             const VocabularyOptions& vocabulary,
                             int max_num_features,
                             const FrameRetrievalOptions& options,
                             const Context& context) {
  const internal::ImageWords words = internal::FindImageWords(
      database, scene, vocabulary, max_num_features, context);
  const WordIndex index(words.num_words, words.images);
  return RetrievePairs(MakeFrameSequences(scene), words.images, index, options,
                       context);
}

// Positions in meters if they are GPS, otherwise in the unit of the database.
std::vector<std::optional<Eigen::Vector3d>> ReadPositions(
    const FeatureDatabase& database, const Scene& scene, PositionKind kind,
    const Context& context) {
  const std::string source = "database '" + database.path() + "'";
  const std::vector<PosePriorRow> rows = database.ReadPosePriors();
  if (rows.empty()) {
    throw Error(source +
                " has no position priors (table pose_priors), which come from "
                "the GPS tags of the images; use another matcher");
  }
  PosePriorOptions options;
  options.use_prior_position = true;
  options.ref_is_gps = kind;
  options.overwrite_priors_covariance = true;  // it has no effect on pairs
  const PositionPriors priors =
      MakePositionPriors(scene, rows, source, options);
  context.Info(source + " has " +
               (priors.origin_wgs84 ? "latitudes and longitudes of images"
                                    : "Cartesian positions of images"));
  std::vector<std::optional<Eigen::Vector3d>> positions;
  for (const auto& prior : priors.images) {
    positions.push_back(prior ? std::optional(prior->position) : std::nullopt);
  }
  return positions;
}

void Append(const ImagePairList& others, ImagePairList* pairs) {
  pairs->insert(pairs->end(), others.begin(), others.end());
}

}  // namespace

ImagePairList SelectExhaustively(const Scene& scene) {
  const int num_images = static_cast<int>(scene.images.size());
  ImagePairList pairs;
  for (int i = 0; i < num_images; ++i) {
    for (int j = i + 1; j < num_images; ++j) pairs.push_back({i, j});
  }
  return pairs;
}

ImagePairList SelectSequentially(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const SequentialMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const PairMatchingOptions& matching,
                                 const Context& context) {
  const std::vector<FrameSequence> sequences = MakeFrameSequences(scene);
  ImagePairList pairs = ProbePairs(sequences, options.pairs);
  {
    const TemporaryFolder folder;
    FeatureDatabase probes(folder.path() + "/probes.db",
                           FeatureDatabase::OpenMode::kOrCreate);
    PairMatcher matcher({database, probes}, scene, matching, context);
    matcher.Run(pairs, "matching of probe frames");
    Append(OverlappingSensorPairs(
               sequences, options.pairs,
               [&](const auto& pair) { return matcher.IsVerified(pair); }),
           &pairs);
  }
  Append(SameSensorPairs(sequences, options.pairs), &pairs);
  if (options.loop_detection) {
    Append(SelectLoops(database, scene, options, vocabulary, context), &pairs);
  }
  internal::SortUnique(&pairs);
  return pairs;
}

ImagePairList SelectLoops(const FeatureDatabase& database, const Scene& scene,
                          const SequentialMatchingOptions& options,
                          const VocabularyOptions& vocabulary,
                          const Context& context) {
  // Nearer frames are matched already, up to the overlap.
  const FrameRetrievalOptions retrieval{
      options.loop_detection_period, options.loop_detection_num_images,
      options.loop_detection_num_images_after_verification,
      2 * options.pairs.overlap + 1};
  return RetrievedPairs(database, scene, vocabulary,
                        options.loop_detection_max_num_features, retrieval,
                        context);
}

ImagePairList SelectByVocabulary(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const VocabTreeMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const Context& context) {
  FrameRetrievalOptions retrieval;
  retrieval.num_images = options.num_images;
  retrieval.num_images_after_verification =
      options.num_images_after_verification;
  return RetrievedPairs(database, scene, vocabulary, options.max_num_features,
                        retrieval, context);
}

ImagePairList SelectSpatially(const FeatureDatabase& database,
                              const Scene& scene,
                              const SpatialMatchingOptions& options,
                              const Context& context) {
  const auto positions =
      ReadPositions(database, scene, options.is_gps, context);
  return SpatialPairs(scene, positions, options, context);
}

ImagePairList SelectListed(const Scene& scene, const std::string& list_path) {
  std::vector<std::string> names;
  for (const Image& image : scene.images) names.push_back(image.name);
  return ReadPairList(TextLines(list_path), names);
}

void WritePairList(const ImagePairList& pairs, const Scene& scene,
                   const std::string& list_path) {
  std::string text;
  for (const ImageIdxPair& pair : pairs) {
    text += scene.images[pair.image_idx1].name + ' ' +
            scene.images[pair.image_idx2].name + '\n';
  }
  ReplaceFile(list_path, text);
}

ImagePairList SelectMatched(const FeatureDatabase& database,
                            const Scene& scene) {
  const internal::ImageIdxs image_idxs(scene);
  ImagePairList pairs;
  for (const PairCount& row : database.CountMatches()) {
    if (const auto pair = image_idxs.Find(row)) pairs.push_back(*pair);
  }
  internal::SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm
