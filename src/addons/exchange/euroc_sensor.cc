// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "exchange/opencv_camera.h"

namespace mgsfm {
namespace {

std::string PoseList(const Rigid3& pose) {
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix;
  matrix << pose.rotation.toRotationMatrix(), pose.translation, 0.0, 0.0, 0.0,
      1.0;
  return NumberList({matrix.data(), matrix.data() + matrix.size()});
}

std::string SensorYaml(const ExportInput& input, int sensor_idx) {
  const int camera_idx = input.scene.sensors[sensor_idx].camera_idx;
  const Camera& camera = input.model.cameras[camera_idx];
  const OpenCvCamera opencv = ToOpenCvCamera(
      input, camera_idx, "euroc_sensor",
      {OpenCvDistortion::kRadialTangential, OpenCvDistortion::kEquidistant});
  const Rigid3 rig_from_cam =
      input.model.sensor_from_rig[sensor_idx].value_or(Rigid3()).Inverse();
  return "sensor_type: camera\n"
         "T_BS:\n  cols: 4\n  rows: 4\n  data: " +
         PoseList(rig_from_cam) + "\nresolution: [" +
         std::to_string(camera.width_px) + ", " +
         std::to_string(camera.height_px) +
         "]\ncamera_model: pinhole\nintrinsics: " +
         NumberList({opencv.fx, opencv.fy, opencv.cx, opencv.cy}) +
         "\ndistortion_model: " +
         (opencv.distortion == OpenCvDistortion::kEquidistant
              ? "equidistant"
              : "radial-tangential") +
         "\ndistortion_coefficients: " + NumberList(opencv.coefficients) + "\n";
}

}  // namespace

std::vector<ExportedFile> WriteEurocSensors(const ExportInput& input) {
  const int rig_idx =
      OnlyRig(input, "euroc_sensor", "delete the images of the others first");
  const std::vector<std::string> names = PlainSensorNames(input.scene);
  std::vector<ExportedFile> files;
  for (const int sensor_idx : PosedSensors(input, rig_idx)) {
    files.push_back({"/" + names[sensor_idx] + "/sensor.yaml",
                     SensorYaml(input, sensor_idx)});
  }
  return files;
}

}  // namespace mgsfm
