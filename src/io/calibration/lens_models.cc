// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/lens_models.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

bool IsOneOf(const std::string& name, const std::vector<std::string>& names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// The number of coefficients without zeros at the end.
size_t NumUsed(const std::vector<double>& coefficients) {
  size_t size = coefficients.size();
  while (size > 0 && coefficients[size - 1] == 0.0) --size;
  return size;
}

// k1 k2 p1 p2 k3 k4 k5 k6, then those of thin prisms and tilted sensors.
void SetRadialTangential(std::vector<double> coefficients,
                         CalibratedCamera* camera) {
  // OpenCV appends k3, then k4 k5 k6, then thin prisms, then tilt.
  const std::vector<size_t> counts = {0, 4, 5, 8, 12, 14};
  if (std::find(counts.begin(), counts.end(), coefficients.size()) ==
      counts.end()) {
    SetWrongCount(coefficients.size(), "k1 k2 p1 p2, with k3 or k3 to k6",
                  camera);
    return;
  }
  const size_t num_used = NumUsed(coefficients);
  size_t size = 0;
  if (num_used == 0) {
    camera->model = CameraModelId::kPinhole;
  } else if (num_used <= 4) {
    camera->model = CameraModelId::kOpenCV;
    size = 4;
  } else if (num_used <= 8) {
    camera->model = CameraModelId::kFullOpenCV;
    size = 8;
  } else {
    camera->why_no_model =
        "has " + std::to_string(num_used) +
        " coefficients of distortion, but no camera model of COLMAP has more "
        "than 8; calibrate it again without thin prism and tilt";
    return;
  }
  coefficients.resize(size, 0.0);
  camera->params.insert(camera->params.end(), coefficients.begin(),
                        coefficients.end());
}

// Sets a model whose number of coefficients is fixed.
void SetModel(CameraModelId model, size_t num_coefficients,
              const PinholeLens& lens, CalibratedCamera* camera) {
  if (lens.distortion.size() != num_coefficients) {
    SetWrongCount(lens.distortion.size(), std::to_string(num_coefficients),
                  camera);
    return;
  }
  camera->model = model;
  camera->params.insert(camera->params.end(), lens.distortion.begin(),
                        lens.distortion.end());
}

}  // namespace

void SetLens(const PinholeLens& lens, CalibratedCamera* camera) {
  const std::string& name = lens.distortion_model;
  // COLMAP's pixels have their origin at the corner of the first one.
  camera->params = {lens.fx, lens.fy, lens.cx + 0.5, lens.cy + 0.5};
  if (!(lens.fx > 0.0 && lens.fy > 0.0)) {
    camera->why_no_model =
        "has a focal length that is not positive; correct it";
  } else if (IsOneOf(name, {"radtan", "radial-tangential", "plumb_bob",
                            "rational_polynomial", "none", ""})) {
    SetRadialTangential(lens.distortion, camera);
  } else if (IsOneOf(name, {"equidistant", "equi", "fisheye", "kannala_brandt",
                            "kannala_brandt4"})) {
    SetModel(CameraModelId::kOpenCVFisheye, 4, lens, camera);
  } else if (name == "fov") {
    SetModel(CameraModelId::kFov, 1, lens, camera);
  } else {
    camera->why_no_model = "has the distortion '" + name +
                           "', which no camera model of COLMAP describes; "
                           "calibrate it again with radtan or equidistant";
  }
  if (!camera->model) camera->params.clear();
}

void SetMatrixAndLens(const std::vector<double>& K, int num_columns,
                      PinholeLens lens, CalibratedCamera* camera) {
  constexpr double kMaxSkew = 1e-6;  // rounding; no model of COLMAP has a skew
  const double scale = K[2 * num_columns + 2];
  lens.fx = K[0] / scale;
  lens.fy = K[num_columns + 1] / scale;
  lens.cx = K[2] / scale;
  lens.cy = K[num_columns + 2] / scale;
  SetLens(lens, camera);
  const bool is_camera_matrix = scale != 0.0 && K[num_columns] == 0.0 &&
                                K[2 * num_columns] == 0.0 &&
                                K[2 * num_columns + 1] == 0.0;
  if (!is_camera_matrix || std::abs(K[1]) > kMaxSkew * std::abs(K[0])) {
    camera->model.reset();
    camera->params.clear();
    camera->why_no_model =
        "has a camera matrix with skew or other unexpected entries; correct it";
  }
}

void SetWrongCount(size_t num_coefficients, const std::string& expected,
                   CalibratedCamera* camera) {
  camera->why_no_model = "has " + std::to_string(num_coefficients) +
                         " coefficients of distortion; give " + expected;
}

void SetUnknownLens(const std::string& name, CalibratedCamera* camera) {
  camera->why_no_model =
      "has the projection '" + name +
      "', which no camera model of COLMAP describes; calibrate it again as a "
      "pinhole camera with equidistant distortion";
}

}  // namespace mgsfm
