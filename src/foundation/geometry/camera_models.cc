// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/geometry/camera_models.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "geometry/camera_models/pixel_models.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Calls `function` with an object of the type of the model.
template <class Function>
auto Dispatch(CameraModelId model, const Function& function) {
  switch (model) {
    case CameraModelId::kSimplePinhole:
      return function(internal::SimplePinhole());
    case CameraModelId::kPinhole:
      return function(internal::Pinhole());
    case CameraModelId::kSimpleRadial:
      return function(internal::SimpleRadial());
    case CameraModelId::kRadial:
      return function(internal::Radial());
    case CameraModelId::kOpenCV:
      return function(internal::OpenCV());
    case CameraModelId::kOpenCVFisheye:
      return function(internal::OpenCVFisheye());
    case CameraModelId::kFullOpenCV:
      return function(internal::FullOpenCV());
    case CameraModelId::kFov:
      return function(internal::Fov());
    case CameraModelId::kSimpleRadialFisheye:
      return function(internal::SimpleRadialFisheye());
    case CameraModelId::kRadialFisheye:
      return function(internal::RadialFisheye());
    case CameraModelId::kThinPrismFisheye:
      return function(internal::ThinPrismFisheye());
    case CameraModelId::kRadTanThinPrismFisheye:
      return function(internal::RadTanThinPrismFisheye());
    case CameraModelId::kSimpleDivision:
      return function(internal::SimpleDivision());
    case CameraModelId::kDivision:
      return function(internal::Division());
    case CameraModelId::kSimpleFisheye:
      return function(internal::SimpleFisheye());
    case CameraModelId::kFisheye:
      return function(internal::Fisheye());
    case CameraModelId::kEucm:
      return function(internal::Eucm());
    case CameraModelId::kEquirectangular:
      return function(internal::Equirectangular());
  }
  throw ContractError("unknown camera model " +
                      std::to_string(static_cast<int32_t>(model)));
}

CameraModelInfo MakeInfo(CameraModelId id, std::string_view name) {
  return Dispatch(id, [id, name](auto model) {
    const auto range = [](int begin, int size) {
      std::vector<int> idxs(size);
      std::iota(idxs.begin(), idxs.end(), begin);
      return idxs;
    };
    return CameraModelInfo{
        id,
        name,
        model.kNumParams,
        range(0, model.kNumFocals),
        range(model.kNumFocals, model.kNumCenters),
        range(model.kNumFocals + model.kNumCenters, model.kNumExtra)};
  });
}

// All calls of the model are inlined, for hot loops.
template <class Model>
[[gnu::flatten]] bool Project(const double* params, const double* point_in_cam,
                              double* pixel) {
  const Eigen::Vector3d point(point_in_cam[0], point_in_cam[1],
                              point_in_cam[2]);
  const std::optional<Eigen::Vector2d> projected =
      Model::Project(params, point, nullptr, nullptr);
  if (!projected) return false;
  pixel[0] = projected->x();
  pixel[1] = projected->y();
  return std::isfinite(pixel[0] + pixel[1]);
}

template <class Model>
[[gnu::flatten]] bool Linearize(const double* params,
                                const double* point_in_cam, double* pixel,
                                double* by_point, double* by_params) {
  const Eigen::Vector3d point(point_in_cam[0], point_in_cam[1],
                              point_in_cam[2]);
  Eigen::Matrix<double, 2, 3> jacobian_point;
  PixelJacobianParams jacobian_params;
  const std::optional<Eigen::Vector2d> projected =
      Model::Project(params, point, &jacobian_point,
                     by_params != nullptr ? &jacobian_params : nullptr);
  if (!projected) return false;
  pixel[0] = projected->x();
  pixel[1] = projected->y();
  for (int i = 0; i < 3; ++i) {
    by_point[i] = jacobian_point(0, i);
    by_point[3 + i] = jacobian_point(1, i);
  }
  if (by_params != nullptr) {
    std::copy_n(jacobian_params.data(), 2 * Model::kNumParams, by_params);
  }
  return std::isfinite(pixel[0] + pixel[1]);
}

}  // namespace

PixelProjection FindPixelProjection(CameraModelId model) {
  return Dispatch(model, [](auto m) {
    return PixelProjection{&Project<decltype(m)>, &Linearize<decltype(m)>};
  });
}

const std::vector<CameraModelInfo>& AllCameraModels() {
  static const std::vector<CameraModelInfo> models = {
      MakeInfo(CameraModelId::kSimplePinhole, "SIMPLE_PINHOLE"),
      MakeInfo(CameraModelId::kPinhole, "PINHOLE"),
      MakeInfo(CameraModelId::kSimpleRadial, "SIMPLE_RADIAL"),
      MakeInfo(CameraModelId::kRadial, "RADIAL"),
      MakeInfo(CameraModelId::kOpenCV, "OPENCV"),
      MakeInfo(CameraModelId::kOpenCVFisheye, "OPENCV_FISHEYE"),
      MakeInfo(CameraModelId::kFullOpenCV, "FULL_OPENCV"),
      MakeInfo(CameraModelId::kFov, "FOV"),
      MakeInfo(CameraModelId::kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE"),
      MakeInfo(CameraModelId::kRadialFisheye, "RADIAL_FISHEYE"),
      MakeInfo(CameraModelId::kThinPrismFisheye, "THIN_PRISM_FISHEYE"),
      MakeInfo(CameraModelId::kRadTanThinPrismFisheye,
               "RAD_TAN_THIN_PRISM_FISHEYE"),
      MakeInfo(CameraModelId::kSimpleDivision, "SIMPLE_DIVISION"),
      MakeInfo(CameraModelId::kDivision, "DIVISION"),
      MakeInfo(CameraModelId::kSimpleFisheye, "SIMPLE_FISHEYE"),
      MakeInfo(CameraModelId::kFisheye, "FISHEYE"),
      MakeInfo(CameraModelId::kEucm, "EUCM"),
      MakeInfo(CameraModelId::kEquirectangular, "EQUIRECTANGULAR"),
  };
  return models;
}

const CameraModelInfo* FindCameraModel(int32_t id) {
  for (const CameraModelInfo& info : AllCameraModels()) {
    if (static_cast<int32_t>(info.id) == id) return &info;
  }
  return nullptr;
}

const CameraModelInfo* FindCameraModel(std::string_view name) {
  for (const CameraModelInfo& info : AllCameraModels()) {
    if (info.name == name) return &info;
  }
  return nullptr;
}

std::optional<Eigen::Vector2d> ProjectToPixel(
    CameraModelId model, const double* params,
    const Eigen::Vector3d& point_in_cam,
    Eigen::Matrix<double, 2, 3>* jacobian_point,
    PixelJacobianParams* jacobian_params) {
  return Dispatch(model, [&](auto m) -> std::optional<Eigen::Vector2d> {
    std::optional<Eigen::Vector2d> pixel = decltype(m)::Project(
        params, point_in_cam, jacobian_point, jacobian_params);
    if (!pixel || !pixel->allFinite()) return std::nullopt;
    return pixel;
  });
}

std::optional<Eigen::Vector3d> RayFromPixel(CameraModelId model,
                                            const double* params,
                                            const Eigen::Vector2d& pixel) {
  return Dispatch(model, [&](auto m) -> std::optional<Eigen::Vector3d> {
    const std::optional<Eigen::Vector3d> ray =
        decltype(m)::Unproject(params, pixel);
    if (!ray) return std::nullopt;
    return ray->normalized();
  });
}

double PixelsPerRadian(CameraModelId model, const double* params) {
  return Dispatch(model,
                  [&](auto m) { return decltype(m)::PixelsPerRadian(params); });
}

}  // namespace mgsfm
