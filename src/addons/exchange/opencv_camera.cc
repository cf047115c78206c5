// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/opencv_camera.h"

#include <algorithm>
#include <optional>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

struct Distortion {
  CameraModelId model;
  OpenCvDistortion kind;
  size_t num_coefficients;  // what the model lacks is zero
};

constexpr Distortion kDistortions[] = {
    {CameraModelId::kSimplePinhole, OpenCvDistortion::kRadialTangential, 4},
    {CameraModelId::kPinhole, OpenCvDistortion::kRadialTangential, 4},
    {CameraModelId::kSimpleRadial, OpenCvDistortion::kRadialTangential, 4},
    {CameraModelId::kRadial, OpenCvDistortion::kRadialTangential, 4},
    {CameraModelId::kOpenCV, OpenCvDistortion::kRadialTangential, 4},
    {CameraModelId::kFullOpenCV, OpenCvDistortion::kRational, 8},
    {CameraModelId::kOpenCVFisheye, OpenCvDistortion::kEquidistant, 4},
    {CameraModelId::kSimpleRadialFisheye, OpenCvDistortion::kEquidistant, 4},
    {CameraModelId::kRadialFisheye, OpenCvDistortion::kEquidistant, 4},
    {CameraModelId::kSimpleFisheye, OpenCvDistortion::kEquidistant, 4},
    {CameraModelId::kFisheye, OpenCvDistortion::kEquidistant, 4},
    {CameraModelId::kFov, OpenCvDistortion::kFieldOfView, 1},
    {CameraModelId::kEucm, OpenCvDistortion::kUnified, 2},
};

}  // namespace

OpenCvCamera ToOpenCvCamera(const ExportInput& input, int camera_idx,
                            const std::string& format,
                            const std::vector<OpenCvDistortion>& permitted) {
  // OpenCV puts the origin into the center of the first pixel, COLMAP into its
  // corner.
  constexpr double kPixelCenter = 0.5;
  const Camera& camera = input.model.cameras[camera_idx];
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int32_t>(camera.model));
  const auto* distortion = std::find_if(
      std::begin(kDistortions), std::end(kDistortions),
      [&](const Distortion& entry) { return entry.model == camera.model; });
  if (distortion == std::end(kDistortions) ||
      std::find(permitted.begin(), permitted.end(), distortion->kind) ==
          permitted.end()) {
    throw Error(CameraLabel(input.scene, camera_idx) + " is of the model " +
                std::string(info.name) + ", which " + format +
                " cannot represent; undistort the images first, or map with "
                "another camera model");
  }
  OpenCvCamera result;
  result.fx = camera.params[info.focal_length_idxs.front()];
  result.fy = camera.params[info.focal_length_idxs.back()];
  result.cx = camera.params[info.principal_point_idxs[0]] - kPixelCenter;
  result.cy = camera.params[info.principal_point_idxs[1]] - kPixelCenter;
  result.distortion = distortion->kind;
  for (const int idx : info.extra_params_idxs) {
    result.coefficients.push_back(camera.params[idx]);
  }
  result.coefficients.resize(distortion->num_coefficients, 0.0);
  return result;
}

}  // namespace mgsfm
