// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "mgsfm/imaging/views.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Resamples images of one camera to its views: bicubic, from an image that is
// first reduced by area averaging where views have a lower resolution. Pixels
// that the camera does not see are black. Thread-safe.
//
// Memory: 13 bytes per pixel of all views.
class ViewRenderer {
 public:
  ViewRenderer(const Camera& camera, const std::vector<View>& views);

  // The images of all views. `image` has the size of the camera.
  std::vector<cv::Mat> Render(const cv::Mat& image) const;
  // A mask of the original, black where pixels must not be used, in the views.
  // An empty one masks nothing. White where the view shows the original.
  std::vector<cv::Mat> RenderMasks(const cv::Mat& mask) const;

 private:
  struct Map {
    cv::Mat pixels;  // CV_32FC2: positions in the reduced, padded original
    cv::Mat unseen;  // CV_8U
  };
  cv::Mat Prepare(const cv::Mat& image) const;
  Map MakeMap(const Camera& camera, const View& view) const;

  bool wraps_around_ = false;  // left and right border are adjacent
  cv::Size reduced_size_;
  std::vector<Map> maps_;
};

}  // namespace mgsfm
