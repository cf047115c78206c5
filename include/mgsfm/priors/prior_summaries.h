// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// How far a model was bent, see src/pipeline/position_bending.h: the most that
// any of its frames moved and turned.
struct ModelDeformation {
  double max_shift = 0.0;
  double max_rotation_deg = 0.0;
};

// What became of measured positions in one model.
struct PositionPriorSummary {
  struct Outlier {
    int image_idx = 0;
    double distance = 0.0;  // from the position to the image's centre
  };
  bool is_registered = false;  // the model is in the world of the positions
  std::string message;         // what is not so, or what was assumed
  int num_priors = 0;          // to images that had a pose when it was moved
  int num_used = 0;
  std::optional<ModelDeformation> deformation;  // if it had to be
  std::optional<double> rms;                    // distance of those used
  // Not used, or more than four standard deviations off in the end.
  std::vector<Outlier> outliers;
};

// What became of measured directions of gravity.
struct GravitySummary {
  struct Outlier {
    int image_idx = 0;
    double error_deg = 0.0;
  };
  int num_priors = 0;      // to images with a rotation
  double sigma_deg = 0.0;  // as given, or what the median tells if that is more
  std::optional<double> median_error_deg;
  std::vector<Outlier> outliers;
};

}  // namespace mgsfm
