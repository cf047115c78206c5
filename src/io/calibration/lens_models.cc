// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/lens_models.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

bool IsOneOf(const std::string& name, const std::vector<std::string>& names) {
  return Contains(names, name);
}

// The number of coefficients without trailing zeros.
size_t NumUsed(const std::vector<double>& coefficients) {
  size_t size = coefficients.size();
  while (size > 0 && coefficients[size - 1] == 0.0) --size;
  return size;
}

// Sets why_no_model; `expected` is appended to "give ".
void SetWrongCount(size_t num_coefficients, const std::string& expected,
                   CalibratedCamera* camera) {
  camera->why_no_model = "has " + std::to_string(num_coefficients) +
                         " coefficients of distortion; give " + expected;
}

// k1 k2 p1 p2 k3 k4 k5 k6, then those of thin prisms and tilted sensors.
void SetRadialTangential(std::vector<double> coefficients,
                         CalibratedCamera* camera) {
  // OpenCV appends k3, then k4 k5 k6, then thin prisms, then tilt.
  const std::vector<size_t> counts = {0, 4, 5, 8, 12, 14};
  if (!Contains(counts, coefficients.size())) {
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

using Eigen::Vector2d;

// Half a pixel is less than the error of keypoints.
constexpr double kMaxFitError_px = 0.5;
// At larger angles, lenses show their own mount.
constexpr double kMaxViewAngle_deg = 110.0;
// Number of directions of the fit, less than two degrees apart in angle to the
// axis. The lens is smooth, and the fit has at most six unknowns.
constexpr int kNumAngles = 60;
constexpr int kNumAzimuths = 24;
constexpr int kNumRadial = 4;

// The radius of a direction at an angle to the optical axis, without
// distortion, in units of the focal length.
double RadiusOf(const UnifiedLens& lens, double angle_rad) {
  const double sine = std::sin(angle_rad);
  const double z = lens.xi + std::cos(angle_rad);
  return sine / (lens.alpha * std::hypot(sine, z) + (1.0 - lens.alpha) * z);
}

Vector2d Distort(const UnifiedLens& lens, const Vector2d& m) {
  if (lens.distortion.empty()) return m;
  const double k1 = lens.distortion[0], k2 = lens.distortion[1];
  const double p1 = lens.distortion[2], p2 = lens.distortion[3];
  const double r2 = m.squaredNorm(), xy = m.x() * m.y();
  return m * (1.0 + r2 * (k1 + r2 * k2)) +
         Vector2d(2.0 * p1 * xy + p2 * (r2 + 2.0 * m.x() * m.x()),
                  p1 * (r2 + 2.0 * m.y() * m.y()) + 2.0 * p2 * xy);
}

// The largest angle that is visible in the image and that the lens maps
// uniquely.
double MaxAngle(const UnifiedLens& lens, const Vector2d& corner_px) {
  const double step_rad = DegToRad(0.5);
  double angle_rad = step_rad, radius = 0.0;
  while (angle_rad + step_rad <= DegToRad(kMaxViewAngle_deg)) {
    const double next =
        Distort(lens, {RadiusOf(lens, angle_rad + step_rad), 0.0}).x();
    if (!(next > radius)) break;
    angle_rad += step_rad;
    radius = next;
    if (radius * std::min(lens.fx, lens.fy) >= corner_px.norm()) break;
  }
  return angle_rad;
}

struct FisheyeFit {
  Eigen::VectorXd coefficients;  // k1 k2 k3 k4 [p1 p2]
  double max_error_px = 0.0;
};

// Linear least squares over directions that the image shows: the coefficients
// of a fisheye with the same scale at the image center.
FisheyeFit Fit(const UnifiedLens& lens, const Vector2d& focals_px,
               double max_angle_rad, bool has_tangential) {
  const int num_coefficients = kNumRadial + (has_tangential ? 2 : 0);
  const int num_rows = 2 * kNumAngles * kNumAzimuths;
  Eigen::MatrixXd A(num_rows, num_coefficients);
  Eigen::VectorXd b(num_rows);
  int row = 0;
  for (int i = 1; i <= kNumAngles; ++i) {
    const double angle_rad = max_angle_rad * i / kNumAngles;
    for (int j = 0; j < kNumAzimuths; ++j, row += 2) {
      const double azimuth_rad = 2.0 * kPi * j / kNumAzimuths;
      const Vector2d axis(std::cos(azimuth_rad), std::sin(azimuth_rad));
      const Vector2d m = angle_rad * axis;
      const double squared = angle_rad * angle_rad;
      double power = 1.0;
      for (int k = 0; k < kNumRadial; ++k) {
        A.block<2, 1>(row, k) = focals_px.cwiseProduct((power *= squared) * m);
      }
      if (has_tangential) {
        const double xy = 2.0 * m.x() * m.y();
        A.block<2, 1>(row, kNumRadial) =
            focals_px.cwiseProduct(Vector2d(xy, squared + 2.0 * m.y() * m.y()));
        A.block<2, 1>(row, kNumRadial + 1) =
            focals_px.cwiseProduct(Vector2d(squared + 2.0 * m.x() * m.x(), xy));
      }
      const Vector2d image = Distort(lens, RadiusOf(lens, angle_rad) * axis);
      b.segment<2>(row) = image.cwiseProduct(Vector2d(lens.fx, lens.fy)) -
                          focals_px.cwiseProduct(m);
    }
  }
  FisheyeFit fit;
  fit.coefficients = A.colPivHouseholderQr().solve(b);
  const Eigen::VectorXd errors = A * fit.coefficients - b;
  for (row = 0; row < num_rows; row += 2) {
    fit.max_error_px =
        std::max(fit.max_error_px, errors.segment<2>(row).norm());
  }
  return fit;
}

void SetFit(const FisheyeFit& fit, bool has_tangential,
            CalibratedCamera* camera) {
  std::vector<double>& params = camera->params;
  const Eigen::VectorXd& c = fit.coefficients;
  if (has_tangential) {
    camera->model = CameraModelId::kThinPrismFisheye;
    params.insert(params.end(), {c[0], c[1], c[4], c[5], c[2], c[3], 0.0, 0.0});
  } else {
    camera->model = CameraModelId::kOpenCVFisheye;
    params.insert(params.end(), c.begin(), c.end());
  }
  camera->fit_error_px = fit.max_error_px;
}

}  // namespace

void SetLens(const PinholeLens& lens, CalibratedCamera* camera) {
  const std::string& name = lens.distortion_model;
  // COLMAP's pixel coordinates start at the corner of the first pixel.
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

void SetUnknownLens(const std::string& name, CalibratedCamera* camera) {
  camera->why_no_model =
      "has the projection '" + name +
      "', which no camera model of COLMAP describes; calibrate it again as a "
      "pinhole camera with equidistant distortion";
}

void SetUnifiedLens(const UnifiedLens& lens, CalibratedCamera* camera) {
  const bool is_valid = lens.fx > 0.0 && lens.fy > 0.0 && lens.xi > -1.0 &&
                        lens.alpha >= 0.0 && lens.alpha < 1.0;
  if (!is_valid) {
    camera->why_no_model =
        "has a focal length, xi or alpha out of range; correct it";
    return;
  }
  if (!lens.distortion.empty() && lens.distortion.size() != 4) {
    SetWrongCount(lens.distortion.size(), "k1 k2 p1 p2", camera);
    return;
  }
  // Near the optical axis, the radius is angle / (1 + xi).
  const double scale = 1.0 / (1.0 + lens.xi);
  const Vector2d focals_px = scale * Vector2d(lens.fx, lens.fy);
  camera->params = {focals_px.x(), focals_px.y(), lens.cx + 0.5, lens.cy + 0.5};
  const bool has_distortion =
      AnyOf(lens.distortion, [](double value) { return value != 0.0; });
  if (!has_distortion && lens.alpha == 0.0 && lens.xi >= 0.0) {
    camera->model = CameraModelId::kEucm;
    camera->params.insert(camera->params.end(), {lens.xi * scale, 1.0});
    return;
  }
  Vector2d size_px = 2.0 * Vector2d(lens.cx, lens.cy);
  if (camera->size_px) {
    size_px = Vector2d(camera->size_px->first, camera->size_px->second);
  }
  const Vector2d corner_px(std::max(lens.cx, size_px.x() - lens.cx),
                           std::max(lens.cy, size_px.y() - lens.cy));
  const bool has_tangential = has_distortion && (lens.distortion[2] != 0.0 ||
                                                 lens.distortion[3] != 0.0);
  const FisheyeFit fit =
      Fit(lens, focals_px, MaxAngle(lens, corner_px), has_tangential);
  if (fit.max_error_px <= kMaxFitError_px) {
    SetFit(fit, has_tangential, camera);
    return;
  }
  camera->params.clear();
  const std::string error = Formatted("%.1f px", fit.max_error_px);
  camera->why_no_model =
      std::string(
          "has a unified or double sphere projection that the fisheye "
          "models of COLMAP approximate only within ") +
      error +
      "; calibrate it again as a pinhole camera with equidistant distortion";
}

}  // namespace mgsfm
