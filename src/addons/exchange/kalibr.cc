// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "exchange/opencv_camera.h"

namespace mgsfm {
namespace {

std::string Matrix(const Rigid3& b_from_a) {
  const Eigen::Matrix3d rotation = b_from_a.rotation.toRotationMatrix();
  std::string text;
  for (int row = 0; row < 3; ++row) {
    text += "    - " +
            NumberList({rotation(row, 0), rotation(row, 1), rotation(row, 2),
                        b_from_a.translation[row]}) +
            "\n";
  }
  return text + "    - [0.0, 0.0, 0.0, 1.0]\n";
}

std::string CameraText(const ExportInput& input, int sensor_idx,
                       const std::string& name) {
  const int camera_idx = input.scene.sensors[sensor_idx].camera_idx;
  const Camera& camera = input.model.cameras[camera_idx];
  const OpenCvCamera opencv = ToOpenCvCamera(
      input, camera_idx, "kalibr",
      {OpenCvDistortion::kRadialTangential, OpenCvDistortion::kEquidistant,
       OpenCvDistortion::kFieldOfView, OpenCvDistortion::kUnified});
  const std::vector<double>& c = opencv.coefficients;
  std::vector<double> intrinsics = {opencv.fx, opencv.fy, opencv.cx, opencv.cy};
  std::string model = "pinhole", distortion = "radtan",
              coefficients = NumberList(c);
  if (opencv.distortion == OpenCvDistortion::kEquidistant) {
    distortion = "equidistant";
  } else if (opencv.distortion == OpenCvDistortion::kFieldOfView) {
    distortion = "fov";
  } else if (opencv.distortion == OpenCvDistortion::kUnified) {
    model = "eucm";
    distortion = "none";
    coefficients = "[]";
    intrinsics.insert(intrinsics.begin(), c.begin(), c.end());
  }
  return "  camera_model: " + model + "\n  distortion_coeffs: " + coefficients +
         "\n  distortion_model: " + distortion +
         "\n  intrinsics: " + NumberList(intrinsics) + "\n  resolution: [" +
         std::to_string(camera.width_px) + ", " +
         std::to_string(camera.height_px) + "]\n  rostopic: /" + name +
         "/image_raw\n";
}

}  // namespace

std::vector<ExportedFile> WriteKalibr(const ExportInput& input) {
  const int rig_idx =
      OnlyRig(input, "kalibr", "delete the images of the others first");
  const std::vector<std::string> names = PlainSensorNames(input.scene);
  const std::vector<int> sensor_idxs = PosedSensors(input, rig_idx);
  std::string text;
  for (size_t i = 0; i < sensor_idxs.size(); ++i) {
    text += "cam" + std::to_string(i) + ":\n";
    if (i > 0) {
      const Rigid3 cam_from_previous =
          *input.model.sensor_from_rig[sensor_idxs[i]] *
          input.model.sensor_from_rig[sensor_idxs[i - 1]]->Inverse();
      text += "  T_cn_cnm1:\n" + Matrix(cam_from_previous);
    }
    text += CameraText(input, sensor_idxs[i], names[sensor_idxs[i]]);
  }
  return {{"", std::move(text)}};
}

}  // namespace mgsfm
