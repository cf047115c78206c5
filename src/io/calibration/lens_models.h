// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "calibration/calibration.h"

namespace mgsfm {

// A pinhole camera with lens distortion in the conventions of OpenCV and
// Kalibr: the center of the first pixel is (0, 0).
struct PinholeLens {
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  std::string distortion_model;  // "radtan", "plumb_bob", "equidistant", ...
  std::vector<double> distortion;
};

// Sets model and params, or why_no_model:
//   radtan, plumb_bob, ...   PINHOLE, OPENCV or FULL_OPENCV, the one with the
//                            fewest parameters
//   equidistant, ...         OPENCV_FISHEYE
//   fov                      FOV
void SetLens(const PinholeLens& lens, CalibratedCamera* camera);

// The same for a camera matrix K in row-major order, whose rows have
// `num_columns` numbers, K first.
void SetMatrixAndLens(const std::vector<double>& K, int num_columns,
                      PinholeLens lens, CalibratedCamera* camera);

// A camera with a mirror or fisheye in the unified model (omni, MEI; C. Mei and
// P. Rives, Single view point omnidirectional camera calibration from planar
// grids, ICRA 2007) or, with alpha, the double sphere model (Usenko et al.
// 2018).
struct UnifiedLens {
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  double xi = 0.0;
  double alpha = 0.0;
  std::vector<double> distortion;  // k1 k2 p1 p2, or empty
};

// Sets model and params, or why_no_model:
//   without distortion   EUCM, which contains the unified model
//   with distortion      OPENCV_FISHEYE or, with p1 and p2,
//   or alpha             THIN_PRISM_FISHEYE, by least squares in the image
// camera->size_px must be set before if it is known.
void SetUnifiedLens(const UnifiedLens& lens, CalibratedCamera* camera);

// Sets why_no_model for any other projection.
void SetUnknownLens(const std::string& name, CalibratedCamera* camera);

}  // namespace mgsfm
