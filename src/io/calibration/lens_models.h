// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "io/calibration/calibration.h"
#include "io/calibration/yaml_value.h"

namespace mgsfm {

// A pinhole camera with lens distortion in the conventions of OpenCV and
// Kalibr: pixels are counted from the centre of the first one.
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

// The same for a camera matrix K, row by row, with its left columns in rows of
// `num_columns` numbers.
void SetMatrixAndLens(const std::vector<double>& K, int num_columns,
                      PinholeLens lens, CalibratedCamera* camera);

// Sets why_no_model for a model of a mirror or of two spheres.
void SetUnknownLens(const std::string& name, CalibratedCamera* camera);

}  // namespace mgsfm
