// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace mgsfm {

// The camera models of COLMAP 4.2 with the same ids, names and parameter
// orders. Pixels: (0, 0) is the upper left corner of the image, (0.5, 0.5) the
// center of the first pixel. Camera frame: x right, y down, z forward.
enum class CameraModelId : int32_t {
  kSimplePinhole = 0,
  kPinhole = 1,
  kSimpleRadial = 2,
  kRadial = 3,
  kOpenCV = 4,
  kOpenCVFisheye = 5,
  kFullOpenCV = 6,
  kFov = 7,
  kSimpleRadialFisheye = 8,
  kRadialFisheye = 9,
  kThinPrismFisheye = 10,
  kRadTanThinPrismFisheye = 11,
  kSimpleDivision = 12,
  kDivision = 13,
  kSimpleFisheye = 14,
  kFisheye = 15,
  kEucm = 16,
  kEquirectangular = 17,
};

// The parameters of a model by kind, as indices into `params`.
struct CameraModelInfo {
  CameraModelId id;
  std::string_view name;
  int num_params;
  std::vector<int> focal_length_idxs;
  std::vector<int> principal_point_idxs;
  std::vector<int> extra_params_idxs;  // distortion; never width or height
};

// All models, sorted by id. FindCameraModel returns nullptr for an unknown id
// or name.
const std::vector<CameraModelInfo>& AllCameraModels();
const CameraModelInfo* FindCameraModel(int32_t id);
const CameraModelInfo* FindCameraModel(std::string_view name);
inline const CameraModelInfo& InfoOf(CameraModelId id) {
  return *FindCameraModel(static_cast<int32_t>(id));
}

// The number of parameters of RAD_TAN_THIN_PRISM_FISHEYE, which has the most.
constexpr int kMaxNumCameraParams = 16;

// Rows are (u, v); columns are the parameters of the model.
using PixelJacobianParams =
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2,
                  kMaxNumCameraParams>;

// Projects a point or ray in the camera frame to pixels; positive multiples
// have the same projection. nullopt outside the domain of the model: at the
// center of projection, behind a perspective camera (z <= 0), or where the
// distortion is not monotonic. Non-null pointers receive the Jacobians
// d(pixel)/d(point), 2 x 3, and d(pixel)/d(params), 2 x num_params.
std::optional<Eigen::Vector2d> ProjectToPixel(
    CameraModelId model, const double* params,
    const Eigen::Vector3d& point_in_cam,
    Eigen::Matrix<double, 2, 3>* jacobian_point = nullptr,
    PixelJacobianParams* jacobian_params = nullptr);

// ProjectToPixel as plain functions for loops over many observations. They
// return false where ProjectToPixel returns nullopt. The Jacobians are
// row-major, 2 x 3 and 2 x num_params; by_params may be null.
struct PixelProjection {
  bool (*project)(const double* params, const double* point_in_cam,
                  double* pixel) = nullptr;
  bool (*linearize)(const double* params, const double* point_in_cam,
                    double* pixel, double* by_point,
                    double* by_params) = nullptr;
};

PixelProjection FindPixelProjection(CameraModelId model);

// The unit ray in the camera frame that projects to the pixel, accurate to
// 1e-10 focal lengths. nullopt if there is none or the iteration does not
// converge.
std::optional<Eigen::Vector3d> RayFromPixel(CameraModelId model,
                                            const double* params,
                                            const Eigen::Vector2d& pixel);

// Pixels per radian near the image center: the mean focal length, or w / 2 pi
// for an equirectangular image. Converts pixel thresholds to angles.
double PixelsPerRadian(CameraModelId model, const double* params);

// The same for a camera with the members `model` and `params`.
template <class Camera>
auto ProjectToPixel(const Camera& camera, const Eigen::Vector3d& point_in_cam) {
  return ProjectToPixel(camera.model, camera.params.data(), point_in_cam);
}
template <class Camera>
auto RayFromPixel(const Camera& camera, const Eigen::Vector2d& pixel) {
  return RayFromPixel(camera.model, camera.params.data(), pixel);
}
template <class Camera>
double PixelsPerRadian(const Camera& camera) {
  return PixelsPerRadian(camera.model, camera.params.data());
}

}  // namespace mgsfm
