// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "matching/word_index.h"
#include "mgsfm/base/context.h"
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

// Sorted, without duplicates.
using ImagePairList = std::vector<ImageIdxPair>;

// ------------------------------------------------------------ sequences

// Frames in the order of their names, which is assumed to be temporal: the
// frames of one rig, or all frames with a single sensor whose images are in one
// folder. A slot is a sensor of the rig.
struct FrameSequence {
  int num_slots = 1;
  std::vector<int> frame_idxs;
  // [frame][slot]; nullopt if the frame has no image of the sensor.
  std::vector<std::vector<std::optional<int>>> images;

  int num_frames() const { return static_cast<int>(images.size()); }
};

std::vector<FrameSequence> MakeFrameSequences(const Scene& scene);

// Images of one sensor in frames i and i + d, with d up to `overlap` or, with
// quadratic_overlap, also 2^k for k < overlap.
ImagePairList SameSensorPairs(const std::vector<FrameSequence>& sequences,
                              const SequentialPairOptions& options);

// Images of different sensors in frames i and i + d, including d = 0. Which
// sensors overlap, and after how many frames, is learned: ProbePairs are all
// sensor pairs of `num_probe_frames` frames i, spaced evenly over the sequence.
// OverlappingSensorPairs are the pairs (sensor, later sensor, d) for which at
// least min_probe_ratio of the probes are verified, for all frames. Both are
// empty without expand_rig_images.
ImagePairList ProbePairs(const std::vector<FrameSequence>& sequences,
                         const SequentialPairOptions& options);
ImagePairList OverlappingSensorPairs(
    const std::vector<FrameSequence>& sequences,
    const SequentialPairOptions& options,
    const std::function<bool(const ImageIdxPair&)>& is_verified);

// ------------------------------------------------------------ retrieval

struct FrameRetrievalOptions {
  int period = 1;
  int num_images = 50;
  int num_images_after_verification = 10;
  // Minimum distance of two frames of one sequence; 0 also allows images of the
  // same frame.
  int min_frame_distance = 0;
};

// Retrieves similar frames by visual words. Every period-th frame of a sequence
// is a query and is compared with all others as a rigid unit: the similarity of
// two frames is the sum over their image pairs, so that cameras vote jointly.
// The num_images most similar frames are ranked by spatially consistent words
// over all image pairs; the first num_images_after_verification (0: all) are
// kept. Their image pairs with enough consistent words are selected.
// `images` are those of `index`.
ImagePairList RetrievePairs(const std::vector<FrameSequence>& sequences,
                            const std::vector<WordImage>& images,
                            const WordIndex& index,
                            const FrameRetrievalOptions& options,
                            const Context& context);

// -------------------------------------------------------------- position

// Pairs of each image with its nearest neighbors; of equally near images those
// with smaller indices. An image without position takes that of the first image
// of its frame with one; frames without any position are ignored. Neighbors
// are exact, by FLANN's kd-tree: O(n log n + neighbors) for n images in
// general position.
ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context);

}  // namespace mgsfm
