// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "features/sift.h"

namespace mgsfm {

// The image at one range of scales. The center of the first pixel of an octave
// is at 0; pixel x of octave o is at 2^o x in the image. The first octave, -1,
// is the image at twice its size.
struct Octave {
  int index = -1;
  // Level k is blurred by LevelSigma(k). Only levels 1 to octave_resolution,
  // which have descriptors, are kept.
  std::vector<cv::Mat> levels;
};

// Blur of a level, which may be fractional, in pixels of the octave.
double LevelSigma(double level, int octave_resolution);

// An extremum over position and scale of the difference of Gaussians
// D(k) = level k + 1 minus level k.
struct ScaleSpacePoint {
  float x = 0.0f;  // in pixels of the octave
  float y = 0.0f;
  float sigma = 0.0f;
  float contrast = 0.0f;  // |D| there
  int octave_idx = 0;     // index in ScaleSpace::octaves
  int level = 1;
};

struct ScaleSpace {
  std::vector<Octave> octaves;
  std::vector<ScaleSpacePoint> points;
};

// `image` holds floats in [0, 1]. Candidates are pixels whose D is larger, or
// smaller, than that of all 26 neighbors. They are refined by at most 5 Newton
// steps on the quadratic through the neighbors and kept if |D| >
// peak_threshold and
//   trace(H)^2 / det(H) < (edge_threshold + 1)^2 / edge_threshold
// for the Hessian H of D in the image plane. Only three scales of D are in
// memory at a time, which peaks at (octave_resolution + 3 + 3) * 16 bytes per
// pixel of the image.
ScaleSpace BuildScaleSpace(const cv::Mat& image, const SiftOptions& options);

}  // namespace mgsfm
