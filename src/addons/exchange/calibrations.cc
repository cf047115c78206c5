// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "exchange/exchange_formats.h"
#include "exchange/formats.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

enum class OpenCvDistortion {
  kRadialTangential,  // k1 k2 p1 p2
  kRational,          // k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,       // k1 k2 k3 k4
  kFieldOfView,       // w
  kUnified,           // EUCM: alpha beta
};

// A format, and its names of the distortions in the order above; nullptr for
// those that it lacks. Each has the equidistant one.
struct CalibrationFormat {
  const char* name;
  const char* distortions[5];

  const char* NameOf(OpenCvDistortion distortion) const {
    return distortions[static_cast<int>(distortion)];
  }
};

constexpr CalibrationFormat kEuroc = {
    "euroc_sensor",
    {"radial-tangential", nullptr, "equidistant", nullptr, nullptr}};
constexpr CalibrationFormat kKalibr = {
    "kalibr", {"radtan", nullptr, "equidistant", "fov", "none"}};
constexpr CalibrationFormat kCameraInfo = {
    "camera_info",
    {"plumb_bob", "rational_polynomial", "equidistant", nullptr, nullptr}};

// A camera in the convention of OpenCV, ROS and Kalibr: pixel (0, 0) is the
// center of the first one.
struct OpenCvCamera {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;
  OpenCvDistortion distortion = OpenCvDistortion::kRadialTangential;
  std::vector<double> coefficients;
  std::string fit;  // model and error of a fit, in words; empty if exact

  // A line of YAML.
  std::string Comment() const { return fit.empty() ? "" : "# " + fit + "\n"; }
};

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

// OpenCV puts the origin into the center of the first pixel, COLMAP into its
// corner.
constexpr double kPixelCenter = 0.5;

struct EquidistantFit {
  OpenCvCamera camera;
  double max_error_px = 0.0;
};

// The equidistant camera with the same rays, by linear least squares over a
// grid of pixels: the center of the image, and the odd polynomial of the angle
// to the axis that is the radius. nullopt if most pixels have no ray.
std::optional<EquidistantFit> FitEquidistant(const Camera& camera,
                                             const CameraModelInfo& info) {
  // 3,200 equations for 7 unknowns.
  constexpr int kGridSize = 40;
  // At larger angles, lenses show their own mount.
  constexpr double kMaxAngleDeg = 110.0;
  constexpr int kNumPowers = 5, kNumUnknowns = 2 + kNumPowers;
  if (info.focal_length_idxs.empty()) return std::nullopt;
  const double aspect = camera.params[info.focal_length_idxs.back()] /
                        camera.params[info.focal_length_idxs.front()];
  Eigen::MatrixXd A =
      Eigen::MatrixXd::Zero(2 * kGridSize * kGridSize, kNumUnknowns);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(A.rows());
  int num_pixels = 0;
  for (int i = 0; i < kGridSize * kGridSize; ++i) {
    const int row = i / kGridSize, column = i % kGridSize;
    const Eigen::Vector2d pixel((column + 0.5) / kGridSize * camera.width_px,
                                (row + 0.5) / kGridSize * camera.height_px);
    const auto ray = RayFromPixel(camera.model, camera.params.data(), pixel);
    if (!ray) continue;
    const double radius = ray->head<2>().norm();
    const double angle_rad = std::atan2(radius, ray->z());
    if (angle_rad > DegToRad(kMaxAngleDeg) || !(radius > 0.0)) continue;
    auto rows = A.middleRows<2>(2 * num_pixels);
    rows.leftCols<2>().setIdentity();
    double power = angle_rad;
    for (int k = 0; k < kNumPowers; ++k, power *= angle_rad * angle_rad) {
      rows.col(2 + k) = power / radius * ray->head<2>();
    }
    b.segment<2>(2 * num_pixels) =
        Eigen::Vector2d(pixel.x(), pixel.y() / aspect);
    ++num_pixels;
  }
  if (2 * num_pixels < kGridSize * kGridSize) return std::nullopt;
  const Eigen::VectorXd x = A.colPivHouseholderQr().solve(b);
  EquidistantFit fit;
  OpenCvCamera& result = fit.camera;
  result.fx = x[2];
  result.fy = aspect * x[2];
  result.cx = x[0] - kPixelCenter;
  result.cy = aspect * x[1] - kPixelCenter;
  result.distortion = OpenCvDistortion::kEquidistant;
  for (int k = 1; k < kNumPowers; ++k) {
    result.coefficients.push_back(x[2 + k] / x[2]);
  }
  const Eigen::VectorXd errors = A * x - b;
  for (int i = 0; i < num_pixels; ++i) {
    const Eigen::Vector2d error(errors[2 * i], aspect * errors[2 * i + 1]);
    fit.max_error_px = std::max(fit.max_error_px, error.norm());
  }
  return fit;
}

// The fit if it is within half a pixel, less than the error of keypoints, or
// else Error.
OpenCvCamera ToEquidistantCamera(const ExportInput& input, int camera_idx,
                                 const CalibrationFormat& format) {
  constexpr double kMaxFitErrorPx = 0.5;
  const Camera& camera = input.model.cameras[camera_idx];
  const CameraModelInfo& info = InfoOf(camera.model);
  auto fit = FitEquidistant(camera, info);
  if (fit && fit->max_error_px <= kMaxFitErrorPx) {
    fit->camera.fit =
        Formatted("equidistant fit of %s, errors up to %.3f px",
                  std::string(info.name).c_str(), fit->max_error_px);
    return std::move(fit->camera);
  }
  const std::string error =
      fit ? Formatted(" but with errors up to %.1f px", fit->max_error_px) : "";
  throw Error(CameraLabel(input.scene, camera_idx) + " is of the model " +
              std::string(info.name) + ", which " + format.name +
              " cannot represent" + error +
              "; undistort the images first, or map with another camera model");
}

// Fits the equidistant model if the format lacks the distortion. Throws Error,
// naming the camera and the format, if that fails.
OpenCvCamera ToOpenCvCamera(const ExportInput& input, int camera_idx,
                            const CalibrationFormat& format) {
  const Camera& camera = input.model.cameras[camera_idx];
  const CameraModelInfo& info = InfoOf(camera.model);
  const auto* distortion = std::find_if(
      std::begin(kDistortions), std::end(kDistortions),
      [&](const Distortion& entry) { return entry.model == camera.model; });
  if (distortion == std::end(kDistortions) ||
      format.NameOf(distortion->kind) == nullptr) {
    return ToEquidistantCamera(input, camera_idx, format);
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

// The cameras of the sensors that the format has as a fit.
std::vector<std::string> FittedCameras(const ExportInput& input,
                                       const std::vector<int>& sensor_idxs,
                                       const CalibrationFormat& format) {
  std::set<int> camera_idxs;
  for (const int sensor_idx : sensor_idxs) {
    camera_idxs.insert(input.scene.sensors[sensor_idx].camera_idx);
  }
  std::vector<std::string> fits;
  for (const int camera_idx : camera_idxs) {
    const std::string fit = ToOpenCvCamera(input, camera_idx, format).fit;
    if (fit.empty()) continue;
    fits.push_back(CameraLabel(input.scene, camera_idx) + " is written as " +
                   fit);
  }
  return fits;
}

// These, and the sensors that a format of one rig lacks.
std::vector<std::string> LossesOfRig(const ExportInput& input,
                                     const CalibrationFormat& format) {
  const int rig_idx = OnlyRig(input, format.name);
  std::vector<std::string> losses = SensorsWithoutPose(input);
  const std::vector<std::string> fits =
      FittedCameras(input, PosedSensors(input, rig_idx), format);
  losses.insert(losses.end(), fits.begin(), fits.end());
  return losses;
}

std::string PoseList(const Rigid3& pose) {
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix;
  matrix << pose.rotation.toRotationMatrix(), pose.translation, 0.0, 0.0, 0.0,
      1.0;
  return NumberList({matrix.data(), matrix.data() + matrix.size()});
}

std::string SensorYaml(const ExportInput& input, int sensor_idx) {
  const int camera_idx = input.scene.sensors[sensor_idx].camera_idx;
  const Camera& camera = input.model.cameras[camera_idx];
  const OpenCvCamera opencv = ToOpenCvCamera(input, camera_idx, kEuroc);
  const Rigid3 rig_from_cam =
      input.model.sensor_from_rig[sensor_idx].value_or(Rigid3()).Inverse();
  return "sensor_type: camera\n"
         "T_BS:\n  cols: 4\n  rows: 4\n  data: " +
         PoseList(rig_from_cam) + "\nresolution: [" +
         std::to_string(camera.width_px) + ", " +
         std::to_string(camera.height_px) +
         "]\ncamera_model: pinhole\nintrinsics: " +
         NumberList({opencv.fx, opencv.fy, opencv.cx, opencv.cy}) +
         "\ndistortion_model: " + kEuroc.NameOf(opencv.distortion) +
         "\ndistortion_coefficients: " + NumberList(opencv.coefficients) +
         "\n" + opencv.Comment();
}

std::vector<ExportedFile> WriteEurocSensors(const ExportInput& input) {
  const int rig_idx = OnlyRig(input, kEuroc.name);
  const std::vector<std::string> names = PlainSensorNames(input.scene);
  return Transformed(PosedSensors(input, rig_idx), [&](int sensor_idx) {
    return ExportedFile{"/" + names[sensor_idx] + "/sensor.yaml",
                        SensorYaml(input, sensor_idx)};
  });
}

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
  const OpenCvCamera opencv = ToOpenCvCamera(input, camera_idx, kKalibr);
  const std::vector<double>& c = opencv.coefficients;
  std::vector<double> intrinsics = {opencv.fx, opencv.fy, opencv.cx, opencv.cy};
  std::string model = "pinhole", coefficients = NumberList(c);
  if (opencv.distortion == OpenCvDistortion::kUnified) {
    model = "eucm";
    coefficients = "[]";
    intrinsics.insert(intrinsics.begin(), c.begin(), c.end());
  }
  return "  camera_model: " + model + "\n  distortion_coeffs: " + coefficients +
         "\n  distortion_model: " + kKalibr.NameOf(opencv.distortion) +
         "\n  intrinsics: " + NumberList(intrinsics) + "\n  resolution: [" +
         std::to_string(camera.width_px) + ", " +
         std::to_string(camera.height_px) + "]\n  rostopic: /" + name +
         "/image_raw\n" + opencv.Comment();
}

std::vector<ExportedFile> WriteKalibr(const ExportInput& input) {
  const int rig_idx = OnlyRig(input, kKalibr.name);
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
  OpenCvCamera opencv = ToOpenCvCamera(input, camera_idx, kCameraInfo);
  if (opencv.distortion == OpenCvDistortion::kRadialTangential) {
    opencv.coefficients.push_back(0.0);  // k3
  }
  return "image_width: " + std::to_string(camera.width_px) +
         "\nimage_height: " + std::to_string(camera.height_px) +
         "\ncamera_name: " + name + "\n" +
         MatrixYaml(
             "camera_matrix", 3, 3,
             {opencv.fx, 0, opencv.cx, 0, opencv.fy, opencv.cy, 0, 0, 1}) +
         "distortion_model: " + kCameraInfo.NameOf(opencv.distortion) + "\n" +
         MatrixYaml("distortion_coefficients", 1,
                    static_cast<int>(opencv.coefficients.size()),
                    opencv.coefficients) +
         MatrixYaml("rectification_matrix", 3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         MatrixYaml("projection_matrix", 3, 4,
                    {opencv.fx, 0, opencv.cx, 0, 0, opencv.fy, opencv.cy, 0, 0,
                     0, 1, 0}) +
         opencv.Comment();
}

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

std::vector<std::string> LossesInCameraInfo(const ExportInput& input) {
  return FittedCameras(input, Indices(input.scene.sensors.size()), kCameraInfo);
}

}  // namespace

std::vector<ExchangeFormat> CalibrationFormats() {
  return {
      {"kalibr", WriteKalibr,
       [](const ExportInput& input) { return LossesOfRig(input, kKalibr); }},
      {"euroc_sensor", WriteEurocSensors,
       [](const ExportInput& input) { return LossesOfRig(input, kEuroc); }},
      {"ros_tf", WriteRosTransforms, SensorsWithoutPose},
      {"ros_launch", WriteRosLaunch, SensorsWithoutPose},
      {"camera_info", WriteCameraInfo, LossesInCameraInfo}};
}

}  // namespace mgsfm
