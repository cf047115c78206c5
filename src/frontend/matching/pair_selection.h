// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Selection of the image pairs to match. Images are indices into
// Scene::images, which need no keypoints here.

// image_idx1 < image_idx2.
struct ImageIdxPair {
  int image_idx1 = 0;
  int image_idx2 = 0;

  friend bool operator==(const ImageIdxPair& a, const ImageIdxPair& b) {
    return a.image_idx1 == b.image_idx1 && a.image_idx2 == b.image_idx2;
  }
  friend bool operator<(const ImageIdxPair& a, const ImageIdxPair& b) {
    return a.image_idx1 != b.image_idx1 ? a.image_idx1 < b.image_idx1
                                        : a.image_idx2 < b.image_idx2;
  }
};

inline ImageIdxPair MakePair(int image_idx1, int image_idx2) {
  return {std::min(image_idx1, image_idx2), std::max(image_idx1, image_idx2)};
}

// Sorted, without duplicates.
using ImagePairList = std::vector<ImageIdxPair>;

// ------------------------------------------------------------ sequences

// Frames in the order of their names, assumed to be the temporal order: the
// frames of one rig, or all single-sensor frames whose images are in one
// folder. A slot is a sensor of the rig.
struct FrameSequence {
  int num_slots = 1;
  std::vector<int> frame_idxs;
  // [frame][slot]; nullopt if the frame has no image of the sensor.
  std::vector<std::vector<std::optional<int>>> images;

  int num_frames() const { return static_cast<int>(images.size()); }
  // nullopt unless both frames have an image.
  std::optional<ImageIdxPair> Pair(int frame1, int slot1, int frame2,
                                   int slot2) const {
    const auto& image1 = images[frame1][slot1];
    const auto& image2 = images[frame2][slot2];
    if (!image1 || !image2) return std::nullopt;
    return MakePair(*image1, *image2);
  }
};

std::vector<FrameSequence> MakeFrameSequences(const Scene& scene);

// Images of one sensor in frames i and i + d, with d up to `overlap` or, with
// quadratic_overlap, also 2^k for k < overlap.
ImagePairList SameSensorPairs(const std::vector<FrameSequence>& sequences,
                              const SequentialPairOptions& options);

// Images of different sensors in frames i and i + d, including d = 0.
// ProbePairs show which sensors overlap, and after how many frames: they are
// all sensor pairs of `num_probe_frames` frames i, spaced evenly over the
// sequence. OverlappingSensorPairs are the pairs (sensor, later sensor, d) for
// which at least min_probe_ratio of the probes are verified, for all frames,
// and for d = 0 those of `all_sequences`, which `sequences` are a part of. Both
// are empty without expand_rig_images.
ImagePairList ProbePairs(const std::vector<FrameSequence>& sequences,
                         const SequentialPairOptions& options);
ImagePairList OverlappingSensorPairs(
    const std::vector<FrameSequence>& sequences,
    const std::vector<FrameSequence>& all_sequences,
    const SequentialPairOptions& options,
    const std::function<bool(const ImageIdxPair&)>& is_verified);

// -------------------------------------------------------------- position

// Pairs of each image with its nearest neighbors; ties go to smaller indices.
// An image without a position uses the position of the first image of its frame
// that has one; frames without any position are ignored. Neighbors are exact,
// by FLANN's kd-tree: O(n log n + neighbors) for n images in general position.
ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context);

// All pairs of images of two blocks, which may be the same.
ImagePairList BlockPairs(int begin1, int end1, int begin2, int end2);

// The pairs that the functions of matching.h match, without matching them. They
// depend on features, positions, names and options only, so that processes that
// match one share each agree on them.

ImagePairList SelectExhaustively(const Scene& scene);

// Matches the pairs of key frame selection and of probes (key_frames.h) in a
// temporary file.
ImagePairList SelectSequentially(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const SequentialMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const PairMatchingOptions& matching,
                                 const Context& context);

// Loops of sequential matching between the frames of these sequences; excludes
// nearer frames.
ImagePairList SelectLoops(const FeatureDatabase& database, const Scene& scene,
                          const std::vector<FrameSequence>& sequences,
                          const SequentialMatchingOptions& options,
                          const VocabularyOptions& vocabulary,
                          const Context& context);

ImagePairList SelectByVocabulary(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const VocabTreeMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const Context& context);

// Throws Error if the database has no position priors.
ImagePairList SelectSpatially(const FeatureDatabase& database,
                              const Scene& scene,
                              const SpatialMatchingOptions& options,
                              const Context& context);

// The pairs of a file (match_list.h).
ImagePairList SelectListed(const Scene& scene, const std::string& list_path);
// Writes this file.
void WritePairList(const ImagePairList& pairs, const Scene& scene,
                   const std::string& list_path);

// All pairs with matches.
ImagePairList SelectMatched(const FeatureDatabase& database,
                            const Scene& scene);

}  // namespace mgsfm
