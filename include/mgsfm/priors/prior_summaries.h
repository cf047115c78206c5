// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// The extent of a pose-graph deformation: the largest displacement and rotation
// of a frame. See src/priors/pose_graph_deformation.h.
struct ModelDeformation {
  double max_shift = 0.0;
  double max_rotation_deg = 0.0;
};

// The use of measured positions in one model.
struct PositionPriorSummary {
  struct Outlier {
    int image_idx = 0;
    double distance = 0.0;  // from the position to the image's centre
  };
  bool is_registered = false;  // the model is in the world of the positions
  std::string message;         // why it is not, or what was assumed
  int num_priors = 0;          // of images registered at that time
  int num_used = 0;
  std::optional<ModelDeformation> deformation;  // nullopt: none was needed
  std::optional<double> rms;                    // distance of those used
  // Not used, or more than 4 standard deviations from the final model.
  std::vector<Outlier> outliers;
};

// The agreement of measured directions of gravity with estimated rotations.
struct GravitySummary {
  struct Outlier {
    int image_idx = 0;
    double error_deg = 0.0;
  };
  int num_priors = 0;  // of images with a rotation
  // The assumed standard deviation, or the robust estimate if that is larger.
  double sigma_deg = 0.0;
  std::optional<double> median_error_deg;
  std::vector<Outlier> outliers;
};

}  // namespace mgsfm
