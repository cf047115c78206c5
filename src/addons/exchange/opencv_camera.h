// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "exchange/exchange_formats.h"

namespace mgsfm {

enum class OpenCvDistortion {
  kRadialTangential,  // k1 k2 p1 p2
  kRational,          // k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,       // k1 k2 k3 k4
  kFieldOfView,       // w
  kUnified,           // EUCM: alpha beta
};

// A camera in the convention of OpenCV, ROS and Kalibr: pixel (0, 0) is the
// center of the first one.
struct OpenCvCamera {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;
  OpenCvDistortion distortion = OpenCvDistortion::kRadialTangential;
  std::vector<double> coefficients;
};

// Throws Error, naming the camera and `format`, unless the distortion is one of
// `permitted`.
OpenCvCamera ToOpenCvCamera(const ExportInput& input, int camera_idx,
                            const std::string& format,
                            const std::vector<OpenCvDistortion>& permitted);

}  // namespace mgsfm
