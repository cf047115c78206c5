// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"
#include "mgsfm/priors/pose_priors.h"

namespace mgsfm {

// ------------------------------------------------- matching and verification

// Names and defaults are COLMAP's, except the default of guided_matching.
struct DescriptorMatchingOptions {
  Option<double> max_ratio{
      "max_ratio", 0.8, GreaterThan(0.0),
      "Reject matches with a larger distance ratio between the best and the "
      "second best match. Decrease it if structures repeat."};
  Option<double> max_distance{"max_distance", 0.7, GreaterThan(0.0), "rad",
                              "Reject matches with a larger distance, the "
                              "angle between the descriptors."};
  Option<bool> cross_check{
      "cross_check", true,
      "Keep a match only if each descriptor is the best match of the other."};
  Option<int> max_num_matches{
      "max_num_matches", 32768, AtLeast(1), "features",
      "Match at most this many features per image; the features after these in "
      "the database are ignored."};
  Option<bool> guided_matching{
      "guided_matching", true,
      "Match the keypoints of the largest scales first; if they show the "
      "motion "
      "of the pair, compare the others only near their epipolar lines."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(max_ratio, max_distance, cross_check, max_num_matches,
          guided_matching);
  }
};

// Names are COLMAP's.
struct TwoViewGeometryOptions {
  Option<int> min_num_inliers{"min_num_inliers", 15, AtLeast(8), "matches",
                              "Reject image pairs with fewer inliers."};
  Option<double> min_inlier_ratio{
      "min_inlier_ratio", 0.25, Between(0.0, 1.0),
      "Reject image pairs with a smaller inlier ratio."};
  Option<double> max_error{
      "max_error", 4.0, GreaterThan(0.0), "px",
      "Count matches with at most this epipolar or homography transfer error "
      "as inliers. Increase it for images of very high resolution."};
  Option<double> confidence{"confidence", 0.999, Between(0.0, 0.999999),
                            "Stop RANSAC at this probability that at least one "
                            "sample is free of outliers."};
  Option<int> max_num_trials{"max_num_trials", 10000, AtLeast(1), "trials",
                             "Limit the RANSAC trials per image pair."};
  // COLMAP's spelling. NOLINTNEXTLINE(readability-identifier-naming)
  Option<double> max_H_inlier_ratio{
      "max_H_inlier_ratio", 0.8, Between(0.0, 1.0),
      "Treat an image pair as planar or panoramic if the ratio of homography "
      "inliers to inliers exceeds this value."};
  Option<bool> detect_watermark{
      "detect_watermark", true,
      "Detect pairs whose inliers are a watermark, that is, a translated "
      "pattern at the image border."};
  Option<double> watermark_border_size{
      "watermark_border_size", 0.1, Between(0.0, 0.5), "of the diagonal",
      "Set the width of the border in which watermarks are searched."};
  Option<double> watermark_min_inlier_ratio{
      "watermark_min_inlier_ratio", 0.7, Between(0.0, 1.0),
      "Treat a pair as a watermark if at least this ratio of its inliers is in "
      "the border and shares one translation."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_num_inliers, min_inlier_ratio, max_error, confidence,
          max_num_trials, max_H_inlier_ratio, detect_watermark,
          watermark_border_size, watermark_min_inlier_ratio);
  }
};

struct RigVerificationOptions {
  Option<bool> rig_verification{
      "rig_verification", true,
      "Verify all image pairs of two frames jointly with one rig motion. Has "
      "an effect only where the rig extrinsics are known."};
  Option<int> min_num_unit_inliers{
      "min_num_unit_inliers", 8, AtLeast(5), "matches",
      "Reject image pairs with fewer inliers to the rig motion of their two "
      "frames. Increase it if rigs see duplicate structures."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(rig_verification, min_num_unit_inliers);
  }
};

struct PairMatchingOptions {
  DescriptorMatchingOptions matching;
  TwoViewGeometryOptions two_view_geometry;
  RigVerificationOptions rig_verification;
  Option<int> cache_size_mib{
      "cache_size", 1024, AtLeast(1), "MiB",
      "Limit the memory of cached features. The features of the two images "
      "being matched are always in memory."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(cache_size_mib);
    visit.Group("SiftMatching", matching);
    visit.Group("TwoViewGeometry", two_view_geometry);
    visit.Group("FeatureMatching", rig_verification);
  }
};

// ------------------------------------------------------------ pair selection

struct ExhaustiveMatchingOptions {
  Option<int> block_size{
      "block_size", 50, AtLeast(1), "images",
      "Match blocks of this many images: all images of two blocks are matched "
      "with each other. Decrease it if memory is short."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(block_size);
  }
};

struct SequentialPairOptions {
  Option<int> overlap{"overlap", 10, AtLeast(1), "frames",
                      "Match each image with the following frames of its "
                      "sequence, up to this number."};
  Option<bool> quadratic_overlap{
      "quadratic_overlap", false,
      "Also match images with those 2^k frames later, for k < overlap. Set it "
      "if loop detection is off."};
  Option<bool> use_key_frames{
      "use_key_frames", true,
      "Apply overlap and loop detection to key frames only, which see "
      "something "
      "new. Match each other frame with the key frames before and after it."};
  Option<bool> expand_rig_images{
      "expand_rig_images", true,
      "Also match images of different cameras of a rig, in the same and in the "
      "following frames."};
  Option<int> num_probe_frames{
      "num_probe_frames", 10, AtLeast(1), "frames",
      "Try all camera pairs in this many frames to find which cameras overlap, "
      "and after how many frames."};
  Option<double> min_probe_ratio{
      "min_probe_ratio", 0.1, Between(0.0, 1.0),
      "Match two cameras in all frames only if at least this fraction of the "
      "probe frames verified."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(overlap, quadratic_overlap, use_key_frames, expand_rig_images,
          num_probe_frames, min_probe_ratio);
  }
};

struct SequentialMatchingOptions {
  SequentialPairOptions pairs;
  Option<bool> loop_detection{
      "loop_detection", true,
      "Detect loops with a vocabulary tree, which is trained on the images "
      "themselves."};
  Option<int> loop_detection_period{"loop_detection_period", 1, AtLeast(1),
                                    "frames",
                                    "Detect loops at every n-th frame."};
  Option<int> loop_detection_num_images{
      "loop_detection_num_images", 50, AtLeast(1), "frames",
      "Retrieve this many most similar frames in loop detection."};
  Option<int> loop_detection_num_images_after_verification{
      "loop_detection_num_images_after_verification", 10, AtLeast(0), "frames",
      "Keep this many retrieved frames after spatial verification of their "
      "visual words. 0 keeps all without verification."};
  Option<int> loop_detection_max_num_features{
      "loop_detection_max_num_features", 2000, AtLeast(-1), "features",
      "Use at most this many features per image in loop detection, the largest "
      "first. -1 uses all."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(pairs, loop_detection, loop_detection_period,
          loop_detection_num_images,
          loop_detection_num_images_after_verification,
          loop_detection_max_num_features);
  }
};

struct VocabularyTrainingOptions {
  Option<int> num_visual_words{
      "num_visual_words", 65536, AtLeast(1), "words",
      "Train about this many visual words, or fewer if there are fewer than 8 "
      "descriptors per word."};
  Option<int> branching{"branching", 16, Between(2, 1024), "children",
                        "Limit the children of a node of the vocabulary tree."};
  Option<int> num_iterations{"num_iterations", 8, AtLeast(1), "iterations",
                             "Limit the k-means iterations per level."};
  Option<int> max_num_descriptors{"max_num_descriptors", 400000, AtLeast(1),
                                  "descriptors",
                                  "Train the tree on this many descriptors, "
                                  "sampled evenly from all images."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(num_visual_words, branching, num_iterations, max_num_descriptors);
  }
};

struct VocabularyOptions : VocabularyTrainingOptions {
  Option<std::string> vocab_tree_path{
      "vocab_tree_path", "",
      "Use this vocabulary tree of vocab_tree_builder. By default, a tree is "
      "trained on the images themselves. Set it if several processes match the "
      "images."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(vocab_tree_path);
    VocabularyTrainingOptions::Describe(visit);
  }
};

struct VocabTreeMatchingOptions {
  Option<int> num_images{
      "num_images", 100, AtLeast(1), "frames",
      "Retrieve this many most similar frames for each frame."};
  Option<int> num_images_after_verification{
      "num_images_after_verification", 0, AtLeast(0), "frames",
      "Keep this many retrieved frames after spatial verification of their "
      "visual words. 0 keeps all without verification."};
  Option<int> max_num_features{"max_num_features", -1, AtLeast(-1), "features",
                               "Use at most this many features per image for "
                               "retrieval, the largest first. -1 uses all."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(num_images, num_images_after_verification, max_num_features);
  }
};

struct SpatialMatchingOptions {
  Option<PositionKind> is_gps{"is_gps", PositionKind::kAuto, kPositionKindHelp};
  Option<bool> ignore_z{"ignore_z", true,
                        "Ignore the altitude. Unset it if cameras move "
                        "vertically and their altitudes are accurate."};
  Option<int> max_num_neighbors{"max_num_neighbors", 50, AtLeast(1), "images",
                                "Match at most this many nearest neighbors."};
  Option<double> max_distance{"max_distance", 100.0, GreaterThan(0.0), "m",
                              "Match only neighbors within this distance."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(is_gps, ignore_z, max_num_neighbors, max_distance);
  }
};

enum class MatchListType {
  kPairs,    // image pairs to match and verify
  kRaw,      // matches to verify
  kInliers,  // verified matches, imported as they are
};

template <>
struct EnumTable<MatchListType> {
  static constexpr std::pair<std::string_view, MatchListType> kNames[] = {
      {"pairs", MatchListType::kPairs},
      {"raw", MatchListType::kRaw},
      {"inliers", MatchListType::kInliers}};
};

}  // namespace mgsfm
