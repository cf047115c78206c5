// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/LU>

#include "calibration/formats.h"
#include "calibration/lens_models.h"
#include "geometry/rigid_matrix.h"

namespace mgsfm {
namespace {

// The names in files of ROS, of OpenCV's samples, and in messages of ROS.
const std::vector<std::string> kMatrix = {"camera_matrix", "Camera_Matrix",
                                          "cameraMatrix", "K", "k"};
const std::vector<std::string> kDistortion = {"distortion_coefficients",
                                              "Distortion_Coefficients",
                                              "distCoeffs", "D", "d"};
const std::vector<std::string> kWidth = {"image_width", "image_Width", "width"};
const std::vector<std::string> kHeight = {"image_height", "image_Height",
                                          "height"};
const std::vector<std::string> kRectification = {"rectification_matrix", "R",
                                                 "r"};
const std::vector<std::string> kProjection = {"projection_matrix", "P", "p"};

std::string DistortionModel(const YamlValue& file) {
  if (const auto model = file.Find("distortion_model")) return model->Text();
  const auto is_fisheye = file.Find("fisheye_model");
  return is_fisheye && is_fisheye->Number() != 0.0 ? "fisheye" : "plumb_bob";
}

// The rectified camera is turned by R, and its projection matrix K [I | t] is
// relative to the rectified left camera.
std::optional<Rigid3> CamFromLeft(const YamlValue& file) {
  const auto rectification = file.FindAny(kRectification);
  const auto projection = file.FindAny(kProjection);
  if (!rectification || !projection) return std::nullopt;
  const std::vector<double> r = rectification->Numbers(9);
  const std::vector<double> p = projection->Numbers(12);
  const Eigen::Map<const RigidMatrix> P(p.data());
  const Eigen::Matrix3d K = P.leftCols<3>();
  if (K.isZero(0.0)) return std::nullopt;  // not rectified
  RigidMatrix matrix = RigidMatrix::Zero();
  matrix.leftCols<3>() =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data());
  const auto rectified_from_cam = RigidFromMatrix(matrix);
  if (!rectified_from_cam) {
    rectification->Throw("is not a rotation; correct it");
  }
  const Eigen::Vector3d t = K.fullPivLu().solve(P.col(3));
  if (!K.fullPivLu().isInvertible()) {
    projection->Throw("is not K [I | t]; correct it");
  }
  return rectified_from_cam->Inverse() *
         Rigid3{Eigen::Quaterniond::Identity(), t};
}

}  // namespace

bool IsOpenCv(const YamlValue& file) {
  return file.FindAny(kMatrix).has_value() &&
         file.FindAny(kDistortion).has_value();
}

std::vector<CalibratedCamera> ReadOpenCv(const YamlValue& file,
                                         const std::filesystem::path& path) {
  CalibratedCamera camera;
  const auto name = file.Find("camera_name");
  if (name) camera.names.push_back(name->Text());
  camera.names.push_back(path.stem().string());
  const YamlValue matrix = *file.FindAny(kMatrix);
  camera.place = matrix.Place();
  PinholeLens lens;
  lens.distortion_model = DistortionModel(file);
  lens.distortion = file.FindAny(kDistortion)->Numbers();
  SetMatrixAndLens(matrix.Numbers(9), 3, lens, &camera);
  const auto width = file.FindAny(kWidth);
  const auto height = file.FindAny(kHeight);
  if (width && height) camera.size_px.emplace(width->Size(), height->Size());
  camera.cam_from_base = CamFromLeft(file);
  return {camera};
}

}  // namespace mgsfm
