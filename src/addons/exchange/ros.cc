// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "exchange/opencv_camera.h"

namespace mgsfm {
namespace {

// The frame of a rig has the axes of its reference camera.
struct StaticTransform {
  std::string parent;
  std::string child;
  Rigid3 parent_from_child;
};

// ROS calls frames with z forward optical.
std::vector<StaticTransform> StaticTransforms(const ExportInput& input) {
  const Scene& scene = input.scene;
  const std::vector<std::string> names = PlainSensorNames(scene);
  std::vector<StaticTransform> transforms;
  for (size_t i = 0; i < scene.rigs.size(); ++i) {
    const std::string rig =
        scene.rigs.size() == 1
            ? "rig"
            : "rig" + std::to_string(scene.rigs[i].id.value());
    for (const int sensor_idx : PosedSensors(input, static_cast<int>(i))) {
      transforms.push_back({rig, names[sensor_idx] + "_optical_frame",
                            input.model.sensor_from_rig[sensor_idx]
                                .value_or(Rigid3())
                                .Inverse()});
    }
  }
  return transforms;
}

std::string TransformYaml(const StaticTransform& transform) {
  const Eigen::Vector3d& t = transform.parent_from_child.translation;
  const Eigen::Quaterniond& q = transform.parent_from_child.rotation;
  return "  - header: {frame_id: " + transform.parent +
         "}\n    child_frame_id: " + transform.child +
         "\n    transform:\n      translation: {x: " + Digits(t.x()) +
         ", y: " + Digits(t.y()) + ", z: " + Digits(t.z()) +
         "}\n      rotation: {x: " + Digits(q.x()) + ", y: " + Digits(q.y()) +
         ", z: " + Digits(q.z()) + ", w: " + Digits(q.w()) + "}\n";
}

std::string TransformLaunch(const StaticTransform& transform) {
  const Eigen::Vector3d& t = transform.parent_from_child.translation;
  const Eigen::Quaterniond& q = transform.parent_from_child.rotation;
  return "  <node pkg=\"tf2_ros\" exec=\"static_transform_publisher\" name=\"" +
         transform.child + "_publisher\" args=\"--x " + Digits(t.x()) +
         " --y " + Digits(t.y()) + " --z " + Digits(t.z()) + " --qx " +
         Digits(q.x()) + " --qy " + Digits(q.y()) + " --qz " + Digits(q.z()) +
         " --qw " + Digits(q.w()) + " --frame-id " + transform.parent +
         " --child-frame-id " + transform.child + "\"/>\n";
}

std::string MatrixYaml(const std::string& name, int rows, int cols,
                       const std::vector<double>& values) {
  return name + ":\n  rows: " + std::to_string(rows) +
         "\n  cols: " + std::to_string(cols) +
         "\n  data: " + NumberList(values) + "\n";
}

std::string CameraInfoYaml(const ExportInput& input, int sensor_idx,
                           const std::string& name) {
  const int camera_idx = input.scene.sensors[sensor_idx].camera_idx;
  const Camera& camera = input.model.cameras[camera_idx];
  OpenCvCamera opencv = ToOpenCvCamera(
      input, camera_idx, "camera_info",
      {OpenCvDistortion::kRadialTangential, OpenCvDistortion::kRational,
       OpenCvDistortion::kEquidistant});
  std::string model = "rational_polynomial";
  if (opencv.distortion == OpenCvDistortion::kRadialTangential) {
    model = "plumb_bob";
    opencv.coefficients.push_back(0.0);  // k3
  } else if (opencv.distortion == OpenCvDistortion::kEquidistant) {
    model = "equidistant";
  }
  return "image_width: " + std::to_string(camera.width_px) +
         "\nimage_height: " + std::to_string(camera.height_px) +
         "\ncamera_name: " + name + "\n" +
         MatrixYaml(
             "camera_matrix", 3, 3,
             {opencv.fx, 0, opencv.cx, 0, opencv.fy, opencv.cy, 0, 0, 1}) +
         "distortion_model: " + model + "\n" +
         MatrixYaml("distortion_coefficients", 1,
                    static_cast<int>(opencv.coefficients.size()),
                    opencv.coefficients) +
         MatrixYaml("rectification_matrix", 3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         MatrixYaml("projection_matrix", 3, 4,
                    {opencv.fx, 0, opencv.cx, 0, 0, opencv.fy, opencv.cy, 0, 0,
                     0, 1, 0});
}

}  // namespace

std::vector<ExportedFile> WriteRosTransforms(const ExportInput& input) {
  std::string text = "transforms:\n";
  for (const StaticTransform& transform : StaticTransforms(input)) {
    text += TransformYaml(transform);
  }
  return {{"", std::move(text)}};
}

std::vector<ExportedFile> WriteRosLaunch(const ExportInput& input) {
  std::string text = "<launch>\n";
  for (const StaticTransform& transform : StaticTransforms(input)) {
    text += TransformLaunch(transform);
  }
  return {{"", text + "</launch>\n"}};
}

std::vector<ExportedFile> WriteCameraInfo(const ExportInput& input) {
  const std::vector<std::string> names = PlainSensorNames(input.scene);
  std::vector<ExportedFile> files;
  for (size_t i = 0; i < input.scene.sensors.size(); ++i) {
    files.push_back({"/" + names[i] + ".yaml",
                     CameraInfoYaml(input, static_cast<int>(i), names[i])});
  }
  return files;
}

}  // namespace mgsfm
