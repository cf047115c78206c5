// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "exchange/exchange_formats.h"

namespace mgsfm {

// A camera with one focal length and radial distortion.
struct RadialCamera {
  double focal_length_px = 0.0;
  Eigen::Vector2d principal_point_px = Eigen::Vector2d::Zero();
  double k1 = 0.0;
  double k2 = 0.0;
};

// The principal point of formats that store none.
Eigen::Vector2d CenterOfImage(const Camera& camera);

// A message for each camera whose principal point lies elsewhere.
std::vector<std::string> MovedPrincipalPoints(const ExportInput& input);

// Per image. Throws Error, naming the camera and `format`, for other models,
// two focal lengths, or more than `max_num_coefficients`, and for image names
// with blanks.
std::vector<RadialCamera> ToRadialCameras(const ExportInput& input,
                                          const std::string& format,
                                          int max_num_coefficients);

// Registered images in the order of their ids, and the place of each there.
struct ImageOrder {
  std::vector<int> image_idxs;
  std::vector<int> place_of_image;  // -1: not registered
};
ImageOrder OrderImagesById(const ExportInput& input);

}  // namespace mgsfm
