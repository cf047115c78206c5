// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/matching/word_index.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Which images to match. Images are positions in a Scene, whose images need no
// keypoints for this.

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

// Sorted, each pair once.
using ImagePairList = std::vector<ImageIdxPair>;

// ------------------------------------------------------------ sequences

// Frames in the order of their names, which is that of time: those of one rig
// or, of rigs with one sensor, all whose images are in one folder. A slot is a
// sensor of the rig.
struct FrameSequence {
  int num_slots = 1;
  std::vector<int> frame_idxs;
  std::vector<std::vector<int>>
      images;  // [frame][slot], -1 where there is none

  int num_frames() const { return static_cast<int>(images.size()); }
};

std::vector<FrameSequence> MakeFrameSequences(const Scene& scene);

struct SequentialPairOptions {
  int overlap = 10;
  bool quadratic_overlap = false;
  bool expand_rig_images = true;
  int num_probe_frames = 10;
  double min_probe_ratio = 0.1;
};

// Images of the same sensor in frames i and i + d, where d is up to `overlap`
// or, with quadratic_overlap, 2^k for k < overlap.
ImagePairList SameSensorPairs(const std::vector<FrameSequence>& sequences,
                              const SequentialPairOptions& options);

// Images of different sensors in frames i and i + d, d = 0 included. Which
// sensors see the same things, and after how many frames, is learnt: all pairs
// of sensors are tried from `num_probe_frames` frames i, spread evenly over the
// sequence; then those pairs (sensor, later sensor, d) go on for which at least
// min_probe_ratio of the probes were verified. None without
// expand_rig_images.
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
  // Frames of a sequence nearer to each other are not proposed; 0: all are,
  // also images of the same frame.
  int min_frame_distance = 0;
};

// Every period-th frame of a sequence is compared with all others as a rigid
// unit: their similarity is the sum over the pairs of their images, so that
// cameras vote together. Of the num_images most similar frames those
// num_images_after_verification are kept (all if that is 0) that have the most
// words at consistent places, in all their pairs of images. Of the kept frames
// those pairs of images are proposed that have enough words at consistent
// places themselves. `images` are those that `index` was made of.
ImagePairList RetrievePairs(const std::vector<FrameSequence>& sequences,
                            const std::vector<WordImage>& images,
                            const WordIndex& index,
                            const FrameRetrievalOptions& options,
                            const Context& context);

// -------------------------------------------------------------- position

struct SpatialMatchingOptions {
  bool is_gps = true;
  bool ignore_z = true;
  int max_num_neighbors = 50;
  double max_distance = 100.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("is_gps", self.is_gps, AnyValue(), "",
          "Positions of which the database does not say what they are, as "
          "those of COLMAP 3.8, are latitude, longitude and altitude.");
    visit("ignore_z", self.ignore_z, AnyValue(), "",
          "Leave out the altitude, which is the least exact.");
    visit("max_num_neighbors", self.max_num_neighbors, AtLeast(1), "images",
          "Each image is matched with at most so many nearest ones.");
    visit("max_distance", self.max_distance, GreaterThan(0.0), "m",
          "Images farther apart are not matched.");
  }
};

// Pairs each image with the nearest ones. An image without position has that
// of the first image of its frame with one; if there is none, it is left out.
// O(images^2).
ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context);

}  // namespace mgsfm
