// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace mgsfm {

// Selects images of a moving camera such that neighbors have parallax but
// still overlap, and are sharp:
//
// - The motion of an image is the median displacement of image patches since
//   the last selected image, as a fraction of the larger side. A standing
//   camera has none, whatever moves in front of it, as long as this covers less
//   than half of the patches.
// - Once the motion reaches `min_motion`, the sharpest image with a motion up
//   to 1.5 times as large is selected. If there is none, the first image beyond
//   it is selected.
//
// Turns without parallax count as motion, too, because the images before and
// after a turn must stay connected.
class MotionSampler {
 public:
  explicit MotionSampler(double min_motion);

  // Adds gray images in temporal order; `idx` is the number of the image.
  void Add(int idx, const cv::Mat& gray);
  // The selected images. The first one is always selected.
  std::vector<int> Finish();

 private:
  struct Frame {
    int idx = 0;
    cv::Mat small;
    double sharpness = 0.0;
  };
  void Process(const Frame& frame);
  void Select(const Frame& frame);
  void SelectSharpestCandidate();
  std::optional<double> MotionOf(const Frame& frame) const;

  const double min_motion_;
  std::vector<int> selected_;
  cv::Mat reference_;               // the last selected image
  std::vector<cv::Point> patches_;  // their centers in the reference
  std::vector<Frame> candidates_;
};

}  // namespace mgsfm
