// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"
#include "mgsfm/matching/descriptor_matching.h"
#include "mgsfm/matching/two_view_verification.h"

namespace mgsfm {

// ------------------------------------------------- matching and verification

struct RigVerificationOptions {
  bool rig_verification = true;
  int min_num_unit_inliers = 8;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("rig_verification", self.rig_verification, AnyValue(), "",
          "Verify all image pairs of two frames jointly with one rig motion. "
          "Has an effect only where the rig extrinsics are known.");
    visit("min_num_unit_inliers", self.min_num_unit_inliers, AtLeast(5),
          "matches",
          "Minimum number of inliers of an image pair to the rig motion of its "
          "two frames. Increase it if rigs see duplicate structures.");
  }
};

struct PairMatchingOptions {
  DescriptorMatchingOptions matching;
  TwoViewGeometryOptions two_view_geometry;
  RigVerificationOptions rig_verification;
  int cache_size_mib = 1024;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("cache_size", self.cache_size_mib, AtLeast(1), "MiB",
          "Size of the feature cache. The features of the two images being "
          "matched are always in memory.");
    visit.Group("SiftMatching", self.matching);
    visit.Group("TwoViewGeometry", self.two_view_geometry);
    visit.Group("FeatureMatching", self.rig_verification);
  }
};

// ------------------------------------------------------------ pair selection

struct ExhaustiveMatchingOptions {
  int block_size = 50;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("block_size", self.block_size, AtLeast(1), "images",
          "Number of images per block; all images of two blocks are matched "
          "with each other. Decrease it if memory is short.");
  }
};

struct SequentialPairOptions {
  int overlap = 10;
  bool quadratic_overlap = false;
  bool expand_rig_images = true;
  int num_probe_frames = 10;
  double min_probe_ratio = 0.1;
};

struct SequentialMatchingOptions {
  SequentialPairOptions pairs;
  bool loop_detection = true;
  int loop_detection_period = 1;
  int loop_detection_num_images = 50;
  int loop_detection_num_images_after_verification = 10;
  int loop_detection_max_num_features = 2000;  // -1: all, COLMAP's convention

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("overlap", self.pairs.overlap, AtLeast(1), "frames",
          "Number of overlapping frames: each image is matched with the "
          "following frames of its sequence.");
    visit("quadratic_overlap", self.pairs.quadratic_overlap, AnyValue(), "",
          "Also match images with those 2^k frames later, for k < overlap. "
          "Set it if loop detection is off.");
    visit("expand_rig_images", self.pairs.expand_rig_images, AnyValue(), "",
          "Also match images of different cameras of a rig, in the same and "
          "in the following frames.");
    visit("num_probe_frames", self.pairs.num_probe_frames, AtLeast(1), "frames",
          "Number of frames in which all camera pairs are tried, to learn "
          "which cameras overlap and how many frames later.");
    visit("min_probe_ratio", self.pairs.min_probe_ratio, Between(0.0, 1.0), "",
          "Camera pairs verified in a smaller ratio of the probe frames are "
          "not matched in the others.");
    visit("loop_detection", self.loop_detection, AnyValue(), "",
          "Detect loops with a vocabulary tree, which is trained on the images "
          "themselves.");
    visit("loop_detection_period", self.loop_detection_period, AtLeast(1),
          "frames", "Loop detection is invoked every this many frames.");
    visit("loop_detection_num_images", self.loop_detection_num_images,
          AtLeast(1), "frames",
          "Number of most similar frames to retrieve in loop detection.");
    visit("loop_detection_num_images_after_verification",
          self.loop_detection_num_images_after_verification, AtLeast(0),
          "frames",
          "Number of retrieved frames to keep after spatial verification of "
          "their visual words; 0 keeps all without verification.");
    visit("loop_detection_max_num_features",
          self.loop_detection_max_num_features, AtLeast(-1), "features",
          "Maximum number of features per image used in loop detection, the "
          "largest first; -1 uses all.");
  }
};

struct VocabularyOptions {
  int num_visual_words = 65536;
  int branching = 16;
  int num_iterations = 8;
  int max_num_descriptors = 400000;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("num_visual_words", self.num_visual_words, AtLeast(1), "words",
          "Desired number of visual words. There are fewer if there are fewer "
          "than 8 descriptors per word.");
    visit("branching", self.branching, Between(2, 1024), "children",
          "Maximum number of children of a node of the vocabulary tree.");
    visit("num_iterations", self.num_iterations, AtLeast(1), "iterations",
          "Maximum number of k-means iterations per level.");
    visit("max_num_descriptors", self.max_num_descriptors, AtLeast(1),
          "descriptors",
          "Number of descriptors, sampled evenly from all images, on which the "
          "tree is trained.");
  }
};

struct VocabTreeMatchingOptions {
  int num_images = 100;
  int num_images_after_verification = 0;
  int max_num_features = -1;  // -1: all, COLMAP's convention

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("num_images", self.num_images, AtLeast(1), "frames",
          "Number of most similar frames to retrieve for each frame.");
    visit("num_images_after_verification", self.num_images_after_verification,
          AtLeast(0), "frames",
          "Number of retrieved frames to keep after spatial verification of "
          "their visual words; 0 keeps all without verification.");
    visit("max_num_features", self.max_num_features, AtLeast(-1), "features",
          "Maximum number of features per image used for retrieval, the "
          "largest first; -1 uses all.");
  }
};

struct SpatialMatchingOptions {
  bool is_gps = true;
  bool ignore_z = true;
  int max_num_neighbors = 50;
  double max_distance = 100.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("is_gps", self.is_gps, AnyValue(), "",
          "Whether position priors without a coordinate system, as in "
          "databases of COLMAP 3.8, are latitude, longitude and altitude.");
    visit("ignore_z", self.ignore_z, AnyValue(), "",
          "Whether to ignore the altitude. Unset it if cameras move "
          "vertically and their altitudes are accurate.");
    visit("max_num_neighbors", self.max_num_neighbors, AtLeast(1), "images",
          "Maximum number of nearest neighbors to match.");
    visit("max_distance", self.max_distance, GreaterThan(0.0), "m",
          "Maximum distance between the query and its nearest neighbors.");
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
