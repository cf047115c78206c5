// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/matching/matching.h"

#include <algorithm>
#include <optional>
#include <string_view>

#include "base/ranges.h"
#include "matching/frame_pair_verification.h"
#include "matching/key_frames.h"
#include "matching/match_list.h"
#include "matching/pair_matching.h"
#include "matching/pair_selection.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

PairMatchingSummary operator+(const PairMatchingSummary& a,
                              const PairMatchingSummary& b) {
  return {a.num_pairs + b.num_pairs, a.num_done + b.num_done,
          a.num_verified + b.num_verified};
}

// Matches lists of pairs and logs the totals.
class Run {
 public:
  Run(FeatureDatabase* database, const Scene& scene,
      const PairMatchingOptions& options, const Context& context)
      : matcher_({*database, *database}, scene, options, context),
        database_(database),
        scene_(scene),
        options_(options),
        context_(context) {}

  void Match(const ImagePairList& pairs, std::string_view stage,
             std::optional<ProgressSpan> span = std::nullopt) {
    summary_ = summary_ + matcher_.Run(pairs, stage, span);
  }

  // Verifies pairs of frames jointly; all pairs must be matched.
  void VerifyUnits(const ImagePairList& pairs) {
    if (!options_.rig_verification.rig_verification) return;
    const FramePairSummary units = VerifyUnitsOfPairs(
        pairs, scene_, options_, {*database_, *database_}, context_);
    if (units.num_frame_pairs == 0) return;
    context_.Info(
        "rig verification of " + std::to_string(units.num_frame_pairs) +
        " frame pairs: " + std::to_string(units.num_changed) +
        " image pairs follow the rig motion, " +
        std::to_string(units.num_gained) + " of them not verified before, " +
        std::to_string(units.num_rejected) + " rejected");
  }

  // Logs the totals under `name`.
  PairMatchingSummary Finish(const std::string& name) const {
    const size_t num_new = summary_.num_pairs - summary_.num_done;
    const double seconds = std::max(timer_.Seconds(), 1e-3);
    context_.Info(
        name + ": " + std::to_string(summary_.num_verified) + " of " +
        std::to_string(summary_.num_pairs) + " pairs verified, " +
        std::to_string(summary_.num_done) + " were in the database, " +
        std::to_string(std::lround(num_new / seconds)) + " new pairs/s");
    return summary_;
  }

  PairMatchingSummary MatchAll(const ImagePairList& pairs, const char* name) {
    Match(pairs, name);
    VerifyUnits(pairs);
    return Finish(name);
  }

  const PairMatcher& matcher() const { return matcher_; }

 private:
  PairMatcher matcher_;
  FeatureDatabase* database_;
  const Scene& scene_;
  const PairMatchingOptions& options_;
  const Context& context_;
  PairMatchingSummary summary_;
  Timer timer_;
};

ImagePairList Without(const ImagePairList& pairs, const ImagePairList& others) {
  ImagePairList left;
  std::set_difference(pairs.begin(), pairs.end(), others.begin(), others.end(),
                      std::back_inserter(left));
  return left;
}

ImagePairList Join(const ImagePairList& pairs, const ImagePairList& others) {
  ImagePairList all;
  std::set_union(pairs.begin(), pairs.end(), others.begin(), others.end(),
                 std::back_inserter(all));
  return all;
}

void LogKeyFrames(const std::vector<FrameSequence>& key_frames,
                  const Scene& scene, const Context& context) {
  size_t num_key_frames = 0;
  for (const FrameSequence& sequence : key_frames) {
    num_key_frames += sequence.images.size();
  }
  if (num_key_frames == scene.frames.size()) return;
  context.Info(std::to_string(num_key_frames) + " of " +
               std::to_string(scene.frames.size()) +
               " frames are key frames; the others see hardly anything new and "
               "are matched with their neighbors only");
}

// Throws Error if a match refers to a missing keypoint.
void CheckListedMatches(const FeatureDatabase& database, const Scene& scene,
                        const std::vector<ListedMatches>& lists) {
  std::vector<std::optional<size_t>> num_keypoints(scene.images.size());
  const auto count = [&](int image_idx) {
    auto& number = num_keypoints[image_idx];
    if (!number) {
      number = database.ReadKeypoints(scene.images[image_idx].id).size();
    }
    return *number;
  };
  for (const ListedMatches& list : lists) {
    const auto [idx1, idx2] = list.images;
    CheckMatches(scene, list.images, list.matches, count(idx1), count(idx2));
  }
}

// Writes the lists of pairs without a row.
void WriteListedMatches(const Scene& scene,
                        const std::vector<ListedMatches>& lists,
                        MatchListType type, FeatureDatabase* database) {
  DatabaseTransaction transaction(database);
  for (const ListedMatches& list : lists) {
    const auto [id1, id2] = IdsOf(scene, list.images);
    if (!database->HasMatches(id1, id2)) {
      database->WriteMatches(id1, id2, list.matches);
    }
    if (type == MatchListType::kInliers &&
        !database->HasTwoViewGeometry(id1, id2)) {
      ImagePair pair;
      pair.config = TwoViewConfig::kUncalibrated;
      pair.matches = list.matches;
      database->WriteTwoViewGeometry(MakePairRow(id1, id2, pair));
    }
  }
  transaction.Commit();
}

}  // namespace

PairMatchingSummary MatchExhaustively(FeatureDatabase* database,
                                      const Scene& scene,
                                      const ExhaustiveMatchingOptions& options,
                                      const PairMatchingOptions& matching,
                                      const Context& context) {
  Run run(database, scene, matching, context);
  const int num_images = static_cast<int>(scene.images.size());
  ProgressSpan span{0, scene.images.size() * (scene.images.size() - 1) / 2};
  for (int i = 0; i < num_images; i += options.block_size) {
    const int end_i = std::min(i + options.block_size, num_images);
    for (int j = i; j < num_images; j += options.block_size) {
      const int end_j = std::min(j + options.block_size, num_images);
      const ImagePairList pairs = BlockPairs(i, end_i, j, end_j);
      run.Match(pairs, "exhaustive matching", span);
      span.num_before += pairs.size();
    }
  }
  run.VerifyUnits(SelectExhaustively(scene));
  return run.Finish("exhaustive matching");
}

PairMatchingSummary MatchSequentially(FeatureDatabase* database,
                                      const Scene& scene,
                                      const SequentialMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context) {
  Run run(database, scene, matching, context);
  ImagePairList done;
  const auto match = [&](const ImagePairList& pairs, std::string_view stage) {
    run.Match(Without(pairs, done), stage);
    done = Join(done, pairs);
  };
  const auto [key_frames, neighbors] = SelectNeighbors(
      scene, options.pairs, {match, [&](const ImageIdxPair& pair) {
                               return run.matcher().NumInliers(pair);
                             }});
  LogKeyFrames(key_frames, scene, context);
  match(neighbors, "sequential matching");
  PairMatchingSummary summary = run.Finish("sequential matching");
  if (!options.loop_detection) {
    run.VerifyUnits(done);
    return summary;
  }
  const ImagePairList loops = Without(
      SelectLoops(*database, scene, key_frames, options, vocabulary, context),
      done);
  Run loop_run(database, scene, matching, context);
  loop_run.Match(loops, "loop detection");
  loop_run.VerifyUnits(Join(done, loops));
  return summary + loop_run.Finish("loop detection");
}

PairMatchingSummary MatchByVocabulary(FeatureDatabase* database,
                                      const Scene& scene,
                                      const VocabTreeMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context) {
  return Run(database, scene, matching, context)
      .MatchAll(
          SelectByVocabulary(*database, scene, options, vocabulary, context),
          "vocabulary tree matching");
}

PairMatchingSummary MatchSpatially(FeatureDatabase* database,
                                   const Scene& scene,
                                   const SpatialMatchingOptions& options,
                                   const PairMatchingOptions& matching,
                                   const Context& context) {
  return Run(database, scene, matching, context)
      .MatchAll(SelectSpatially(*database, scene, options, context),
                "spatial matching");
}

PairMatchingSummary ImportMatches(FeatureDatabase* database, const Scene& scene,
                                  const std::string& match_list_path,
                                  MatchListType type,
                                  const PairMatchingOptions& matching,
                                  const Context& context) {
  ImagePairList pairs;
  if (type == MatchListType::kPairs) {
    pairs = SelectListed(scene, match_list_path);
  } else {
    const auto lists = ReadMatchList(TextLines(match_list_path),
                                     Transformed(scene.images, &Image::name));
    CheckListedMatches(*database, scene, lists);
    WriteListedMatches(scene, lists, type, database);
    pairs = Transformed(lists, &ListedMatches::images);
  }
  Run run(database, scene, matching, context);
  run.Match(pairs, "matching of the list");
  if (type != MatchListType::kInliers) run.VerifyUnits(pairs);
  return run.Finish("matching of the list");
}

PairMatchingSummary VerifyMatches(FeatureDatabase* database, const Scene& scene,
                                  const PairMatchingOptions& matching,
                                  const Context& context) {
  return Run(database, scene, matching, context)
      .MatchAll(SelectMatched(*database, scene), "verification");
}

}  // namespace mgsfm
