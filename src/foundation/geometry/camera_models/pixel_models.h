// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "geometry/camera_models/lenses.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"

// Camera models: lens, focal lengths and principal point.
namespace mgsfm::internal {

// pixel = diag(f) m + c with the parameters f or fx fy, cx cy, lens parameters.
template <class Lens, int kNumFocals_>
struct FocalModel {
  static constexpr int kNumFocals = kNumFocals_;
  static constexpr int kNumCenters = 2;
  static constexpr int kNumExtra = Lens::kNumParams;
  static constexpr int kNumParams = kNumFocals + kNumCenters + kNumExtra;

  static std::optional<Eigen::Vector2d> Project(
      const double* params, const Eigen::Vector3d& point,
      Eigen::Matrix<double, 2, 3>* jacobian_point,
      PixelJacobianParams* jacobian_params) {
    const bool has_jacobian =
        jacobian_point != nullptr || jacobian_params != nullptr;
    LensJacobians<kNumExtra> of_lens;
    const std::optional<Eigen::Vector2d> m =
        Lens::Project(Extra(params), point, has_jacobian ? &of_lens : nullptr);
    if (!m) return std::nullopt;
    const Eigen::Vector2d f = Focal(params);
    if (jacobian_point != nullptr) {
      *jacobian_point = f.asDiagonal() * of_lens.point;
    }
    if (jacobian_params != nullptr) {
      jacobian_params->setZero(2, kNumParams);
      (*jacobian_params)(0, 0) = m->x();
      (*jacobian_params)(1, kNumFocals - 1) = m->y();
      jacobian_params->template middleCols<2>(kNumFocals).setIdentity();
      jacobian_params->template rightCols<kNumExtra>() =
          f.asDiagonal() * of_lens.params;
    }
    return Eigen::Vector2d(f.cwiseProduct(*m) + Center(params));
  }

  static std::optional<Eigen::Vector3d> Unproject(
      const double* params, const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d m =
        (pixel - Center(params)).cwiseQuotient(Focal(params));
    if (!m.allFinite()) return std::nullopt;
    return Lens::Unproject(Extra(params), m);
  }

  static double PixelsPerRadian(const double* params) {
    return 0.5 * Focal(params).sum();
  }

 private:
  static Eigen::Vector2d Focal(const double* params) {
    return {params[0], params[kNumFocals - 1]};
  }
  static Eigen::Vector2d Center(const double* params) {
    return {params[kNumFocals], params[kNumFocals + 1]};
  }
  static const double* Extra(const double* params) {
    return params + kNumFocals + kNumCenters;
  }
};

// Equirectangular projection to w x h pixels: u = w (1/2 + lon / 2pi) with
// lon = atan2(x, z), v = h (1/2 + lat / pi) with lat the angle below the x-z
// plane. The poles, where u is undefined, are outside the domain.
struct EquirectangularModel {
  static constexpr int kNumFocals = 0;
  static constexpr int kNumCenters = 0;
  static constexpr int kNumExtra = 0;
  static constexpr int kNumParams = 2;

  static std::optional<Eigen::Vector2d> Project(
      const double* params, const Eigen::Vector3d& point,
      Eigen::Matrix<double, 2, 3>* jacobian_point,
      PixelJacobianParams* jacobian_params) {
    const double x = point.x(), y = point.y(), z = point.z();
    const double horizontal = std::hypot(x, z);
    if (!(horizontal > 0.0)) return std::nullopt;
    const double du = params[0] / (2.0 * kPi);
    const double dv = params[1] / kPi;
    const Eigen::Vector2d relative(0.5 + std::atan2(x, z) / (2.0 * kPi),
                                   0.5 + std::atan2(y, horizontal) / kPi);
    if (jacobian_point != nullptr) {
      const double h2 = horizontal * horizontal;
      const double n2 = h2 + y * y;
      *jacobian_point << du * z / h2, 0.0, -du * x / h2,
          -dv * x * y / (horizontal * n2), dv * horizontal / n2,
          -dv * z * y / (horizontal * n2);
    }
    if (jacobian_params != nullptr) {
      jacobian_params->resize(2, kNumParams);
      *jacobian_params << relative.x(), 0.0, 0.0, relative.y();
    }
    return Eigen::Vector2d(params[0] * relative.x(), params[1] * relative.y());
  }

  static std::optional<Eigen::Vector3d> Unproject(
      const double* params, const Eigen::Vector2d& pixel) {
    const double u = pixel.x() / params[0];
    const double v = pixel.y() / params[1];
    if (!(u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0)) return std::nullopt;
    const double lon = (u - 0.5) * 2.0 * kPi;
    const double lat = (v - 0.5) * kPi;
    return Eigen::Vector3d(std::cos(lat) * std::sin(lon), std::sin(lat),
                           std::cos(lat) * std::cos(lon));
  }

  static double PixelsPerRadian(const double* params) {
    return params[0] / (2.0 * kPi);
  }
};

template <class Distortion>
using PerspectiveLens = DistortedLens<PerspectiveProjection, Distortion>;
template <class Distortion>
using FisheyeLens = DistortedLens<EquidistantProjection, Distortion>;
template <int N>
using Polynomial = RadialDistortion<RationalProfile<N>>;

using SimplePinhole = FocalModel<PerspectiveLens<Polynomial<0>>, 1>;
using Pinhole = FocalModel<PerspectiveLens<Polynomial<0>>, 2>;
using SimpleRadial = FocalModel<PerspectiveLens<Polynomial<1>>, 1>;
using Radial = FocalModel<PerspectiveLens<Polynomial<2>>, 1>;
using OpenCV =
    FocalModel<PerspectiveLens<BrownDistortion<RationalProfile<2>, false>>, 2>;
using OpenCVFisheye = FocalModel<FisheyeLens<Polynomial<4>>, 2>;
using FullOpenCV =
    FocalModel<PerspectiveLens<BrownDistortion<RationalProfile<3, 3>, false>>,
               2>;
using Fov = FocalModel<PerspectiveLens<RadialDistortion<FovProfile>>, 2>;
using SimpleRadialFisheye = FocalModel<FisheyeLens<Polynomial<1>>, 1>;
using RadialFisheye = FocalModel<FisheyeLens<Polynomial<2>>, 1>;
using ThinPrismFisheye =
    FocalModel<FisheyeLens<BrownDistortion<RationalProfile<4>, true>>, 2>;
using RadTanThinPrismFisheye =
    FocalModel<FisheyeLens<RadTanThinPrismDistortion>, 2>;
using SimpleDivision = FocalModel<RatioLens<DivisionSurface>, 1>;
using Division = FocalModel<RatioLens<DivisionSurface>, 2>;
using SimpleFisheye = FocalModel<FisheyeLens<Polynomial<0>>, 1>;
using Fisheye = FocalModel<FisheyeLens<Polynomial<0>>, 2>;
using Eucm = FocalModel<RatioLens<EucmSurface>, 2>;
using Equirectangular = EquirectangularModel;

}  // namespace mgsfm::internal
