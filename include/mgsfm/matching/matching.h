// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/pair_matching.h"
#include "mgsfm/matching/pair_selection.h"
#include "mgsfm/matching/vocabulary.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// From the features in a database to verified pairs in it, by different ways to
// choose the pairs. All of them go on where an interrupted run stopped. `scene`
// is made of the database (FeatureDatabase::ReadStructure and LoadScene), as
// frames and sensors matter.

struct ExhaustiveMatchingOptions {
  int block_size = 50;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("block_size", self.block_size, AtLeast(1), "images",
          "Images are matched in blocks of this size with each other, so that "
          "few need be in memory at a time.");
  }
};

struct SequentialMatchingOptions {
  SequentialPairOptions pairs;
  bool loop_detection = true;
  int loop_detection_period = 1;
  int loop_detection_num_images = 50;
  int loop_detection_num_images_after_verification = 10;
  int loop_detection_max_num_features = 2000;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("overlap", self.pairs.overlap, AtLeast(1), "frames",
          "Images are matched with those of so many frames that follow.");
    visit("quadratic_overlap", self.pairs.quadratic_overlap, AnyValue(), "",
          "And with those 2^k frames later, for k below the overlap; mostly in "
          "vain if loops are found otherwise.");
    visit("expand_rig_images", self.pairs.expand_rig_images, AnyValue(), "",
          "Match images of different cameras of a rig, too, of the same frame "
          "and of those that follow.");
    visit("num_probe_frames", self.pairs.num_probe_frames, AtLeast(1), "frames",
          "Frames from which all pairs of cameras are tried, to learn which of "
          "them see the same things, and how many frames later.");
    visit("min_probe_ratio", self.pairs.min_probe_ratio, Between(0.0, 1.0), "",
          "Pairs of cameras that were verified in a smaller share of those "
          "frames are not matched in the others.");
    visit("loop_detection", self.loop_detection, AnyValue(), "",
          "Find frames of the same place by the words of a vocabulary that is "
          "made from the images themselves.");
    visit("loop_detection_period", self.loop_detection_period, AtLeast(1),
          "frames", "Look for loops from every so manieth frame.");
    visit("loop_detection_num_images", self.loop_detection_num_images,
          AtLeast(1), "frames", "Most similar frames that are looked at.");
    visit("loop_detection_num_images_after_verification",
          self.loop_detection_num_images_after_verification, AtLeast(0),
          "frames",
          "Of these, the frames with most words at consistent places are "
          "matched; 0: all, without regard to places.");
    visit("loop_detection_max_num_features",
          self.loop_detection_max_num_features, AtLeast(-1), "features",
          "Largest features of an image that are used to find loops; -1: "
          "all.");
  }
};

struct VocabTreeMatchingOptions {
  int num_images = 100;
  int num_images_after_verification = 0;
  int max_num_features = -1;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("num_images", self.num_images, AtLeast(1), "frames",
          "Most similar frames that each frame is matched with.");
    visit("num_images_after_verification", self.num_images_after_verification,
          AtLeast(0), "frames",
          "Of these, only the frames with most words at consistent places; "
          "0: all.");
    visit("max_num_features", self.max_num_features, AtLeast(-1), "features",
          "Largest features of an image that are used to compare them; -1: "
          "all.");
  }
};

PairMatchingSummary MatchExhaustively(FeatureDatabase* database,
                                      const Scene& scene,
                                      const ExhaustiveMatchingOptions& options,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

// The pairs of one camera in sequence; those of different cameras of a rig, see
// OverlappingSensorPairs; and loops: pairs of frames of a sequence farther
// apart than twice the overlap, and of different sequences.
PairMatchingSummary MatchSequentially(FeatureDatabase* database,
                                      const Scene& scene,
                                      const SequentialMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

PairMatchingSummary MatchByVocabulary(FeatureDatabase* database,
                                      const Scene& scene,
                                      const VocabTreeMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

// By the positions in the database. Throws Error if there are none.
PairMatchingSummary MatchSpatially(FeatureDatabase* database,
                                   const Scene& scene,
                                   const SpatialMatchingOptions& options,
                                   const PairMatchingOptions& matching,
                                   const Context& context);

enum class MatchListType {
  kPairs,    // pairs, to be matched and verified
  kRaw,      // matches, to be verified
  kInliers,  // verified matches, taken as they are
};

template <>
struct EnumTable<MatchListType> {
  static constexpr std::pair<std::string_view, MatchListType> kNames[] = {
      {"pairs", MatchListType::kPairs},
      {"raw", MatchListType::kRaw},
      {"inliers", MatchListType::kInliers}};
};

// Reads a file, see match_list.h. Pairs that the database has already are left
// alone. Throws Error, naming the line, for what it cannot read, and naming the
// pair for matches of no keypoint; the database is not changed then.
PairMatchingSummary ImportMatches(FeatureDatabase* database, const Scene& scene,
                                  const std::string& match_list_path,
                                  MatchListType type,
                                  const PairMatchingOptions& matching,
                                  const Context& context);

}  // namespace mgsfm
