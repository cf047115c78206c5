// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "mgsfm/features/sift.h"

namespace mgsfm {

// The image at ever coarser scales. Coordinates in an octave have the centre of
// the first pixel at 0; pixel x of octave o is at 2^o x in the image, where the
// first octave, -1, is the image at twice its size.
struct Octave {
  int index = -1;
  // Blurred by LevelSigma(k); only 1 to octave_resolution, which features are
  // described at, are kept.
  std::vector<cv::Mat> levels;
};

// In pixels of the octave; `level` may be between two.
double LevelSigma(double level, int octave_resolution);

// An extremum over position and scale of the difference of Gaussians
// D(k) = level k + 1 minus level k.
struct ScaleSpacePoint {
  float x = 0.0f;  // in pixels of the octave
  float y = 0.0f;
  float sigma = 0.0f;
  float contrast = 0.0f;  // |D| there
  int octave_idx = 0;     // position in ScaleSpace::octaves
  int level = 1;
};

struct ScaleSpace {
  std::vector<Octave> octaves;
  std::vector<ScaleSpacePoint> points;
};

// `image` has floats in [0, 1]. A point is a pixel whose D is larger, or
// smaller, than that of its 26 neighbours, and then refined by Newton's method
// on the quadratic through these. It must have |D| > peak_threshold and
//   trace(H)^2 / det(H) < (edge_threshold + 1)^2 / edge_threshold
// for the Hessian H of D in the image plane. As D is needed at three scales
// only at a time, memory peaks at (octave_resolution + 3 + 3) * 16 bytes per
// pixel of the image.
ScaleSpace BuildScaleSpace(const cv::Mat& image, const SiftOptions& options);

}  // namespace mgsfm
