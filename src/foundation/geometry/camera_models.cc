// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/geometry/camera_models.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

#include "base/ranges.h"
#include "geometry/camera_models/pixel_models.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

template <class... Model>
struct ModelList {};

// The types and names of the models in the order of their ids.
using Models =
    ModelList<internal::SimplePinhole, internal::Pinhole,
              internal::SimpleRadial, internal::Radial, internal::OpenCV,
              internal::OpenCVFisheye, internal::FullOpenCV, internal::Fov,
              internal::SimpleRadialFisheye, internal::RadialFisheye,
              internal::ThinPrismFisheye, internal::RadTanThinPrismFisheye,
              internal::SimpleDivision, internal::Division,
              internal::SimpleFisheye, internal::Fisheye, internal::Eucm,
              internal::Equirectangular>;
constexpr std::string_view kNames[] = {"SIMPLE_PINHOLE",
                                       "PINHOLE",
                                       "SIMPLE_RADIAL",
                                       "RADIAL",
                                       "OPENCV",
                                       "OPENCV_FISHEYE",
                                       "FULL_OPENCV",
                                       "FOV",
                                       "SIMPLE_RADIAL_FISHEYE",
                                       "RADIAL_FISHEYE",
                                       "THIN_PRISM_FISHEYE",
                                       "RAD_TAN_THIN_PRISM_FISHEYE",
                                       "SIMPLE_DIVISION",
                                       "DIVISION",
                                       "SIMPLE_FISHEYE",
                                       "FISHEYE",
                                       "EUCM",
                                       "EQUIRECTANGULAR"};

template <class Function, class First, class... Others>
auto Dispatch(CameraModelId model, const Function& function,
              ModelList<First, Others...>) {
  using Call = decltype(function(First())) (*)(const Function&);
  static constexpr Call kCalls[] = {
      [](const Function& f) { return f(First()); },
      [](const Function& f) { return f(Others()); }...};
  static_assert(std::size(kCalls) == std::size(kNames));
  const auto id = static_cast<int32_t>(model);
  if (id >= 0 && static_cast<size_t>(id) < std::size(kCalls)) {
    return kCalls[id](function);
  }
  throw ContractError("unknown camera model " + std::to_string(id));
}

// Calls `function` with an object of the type of the model.
template <class Function>
auto Dispatch(CameraModelId model, const Function& function) {
  return Dispatch(model, function, Models());
}

CameraModelInfo MakeInfo(int number) {
  const auto id = static_cast<CameraModelId>(number);
  return Dispatch(id, [&](auto model) {
    const auto range = [](int begin, int size) {
      std::vector<int> idxs(size);
      std::iota(idxs.begin(), idxs.end(), begin);
      return idxs;
    };
    return CameraModelInfo{
        id,
        kNames[number],
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
  const std::optional<Eigen::Vector2d> projected = Model::Project(
      params, Eigen::Vector3d::Map(point_in_cam), nullptr, nullptr);
  if (!projected) return false;
  pixel[0] = projected->x();
  pixel[1] = projected->y();
  return std::isfinite(pixel[0] + pixel[1]);
}

template <class Model>
[[gnu::flatten]] bool Linearize(const double* params,
                                const double* point_in_cam, double* pixel,
                                double* by_point, double* by_params) {
  Eigen::Matrix<double, 2, 3> jacobian_point;
  PixelJacobianParams jacobian_params;
  const std::optional<Eigen::Vector2d> projected = Model::Project(
      params, Eigen::Vector3d::Map(point_in_cam), &jacobian_point,
      by_params != nullptr ? &jacobian_params : nullptr);
  if (!projected) return false;
  pixel[0] = projected->x();
  pixel[1] = projected->y();
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor>::Map(by_point) = jacobian_point;
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
  static const std::vector<CameraModelInfo> kModels =
      Transformed(Indices(std::size(kNames)), MakeInfo);
  return kModels;
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
