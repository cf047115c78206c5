// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

// The camera models of COLMAP 4.2, with its ids, names and parameter orders.
// Pixels: (0, 0) is the upper left corner of the image, the first pixel's
// centre is (0.5, 0.5). Camera frame: x right, y down, z forward.
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

// Which parameters of a model are of which kind, as positions in `params`.
struct CameraModelInfo {
  CameraModelId id;
  std::string_view name;
  int num_params;
  std::vector<int> focal_length_idxs;
  std::vector<int> principal_point_idxs;
  std::vector<int> extra_params_idxs;  // distortion; never width or height
};

// All models, by id. nullptr for an id or name that is none.
const std::vector<CameraModelInfo>& AllCameraModels();
const CameraModelInfo* FindCameraModel(int32_t id);
const CameraModelInfo* FindCameraModel(std::string_view name);

constexpr int kMaxNumCameraParams = 16;

// The largest number of parameters, rows are (u, v).
using PixelJacobianParams =
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2,
                  kMaxNumCameraParams>;

// Projects a point or ray of the camera frame (any positive multiple gives the
// same pixel) to pixels. nullopt where the model cannot see it: at the centre,
// behind a perspective model (z <= 0), or outside the range in which the
// distortion is monotonic. Jacobians are written where the pointers are not
// null: d(pixel)/d(point) 2x3 and d(pixel)/d(params) 2 x num_params.
std::optional<Eigen::Vector2d> ProjectToPixel(
    CameraModelId model, const double* params,
    const Eigen::Vector3d& point_in_cam,
    Eigen::Matrix<double, 2, 3>* jacobian_point = nullptr,
    PixelJacobianParams* jacobian_params = nullptr);

// A model as plain functions, for loops over many observations. They do what
// ProjectToPixel does, and return false where it gives nullopt. The derivatives
// are row-major, 2 x 3 and 2 x num_params; by_params may be null.
struct PixelProjection {
  bool (*project)(const double* params, const double* point_in_cam,
                  double* pixel) = nullptr;
  bool (*linearize)(const double* params, const double* point_in_cam,
                    double* pixel, double* by_point,
                    double* by_params) = nullptr;
};

PixelProjection FindPixelProjection(CameraModelId model);

// The unit ray in the camera frame that projects to the pixel, to 1e-10 of
// pixel / focal length; nullopt where none does or the iteration fails.
std::optional<Eigen::Vector3d> RayFromPixel(CameraModelId model,
                                            const double* params,
                                            const Eigen::Vector2d& pixel);

// Pixels a radian spans near the image centre: the mean focal length, or
// w / 2 pi of an equirectangular image. Turns pixel thresholds to angles.
double PixelsPerRadian(CameraModelId model, const double* params);

}  // namespace mgsfm
