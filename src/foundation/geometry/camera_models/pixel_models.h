// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>

#include "geometry/camera_models/distortions.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"

// Lenses map a point in the camera frame to the image plane in units of the
// focal length. A lens is a struct with
//   kNumParams
//   Project(k, point, jacobians)  nullopt outside its domain; jacobians may be
//                                 null
//   Unproject(k, m)               a ray of any length that projects to m
namespace mgsfm::internal {

template <int N>
struct LensJacobians {
  Eigen::Matrix<double, 2, 3> point;
  Eigen::Matrix<double, 2, N> params;
};

// m = (x, y) / z in front of the camera.
struct PerspectiveProjection {
  static constexpr double kMaxRadius = std::numeric_limits<double>::infinity();

  static std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point) {
    if (!(point.z() > 0.0)) return std::nullopt;
    return Eigen::Vector2d(point.head<2>() / point.z());
  }
  // d m / d point.
  static Eigen::Matrix<double, 2, 3> Jacobian(const Eigen::Vector3d& point,
                                              const Eigen::Vector2d& m) {
    const double inverse = 1.0 / point.z();
    Eigen::Matrix<double, 2, 3> jacobian;
    jacobian << inverse, 0.0, -m.x() * inverse, 0.0, inverse, -m.y() * inverse;
    return jacobian;
  }
  static Eigen::Vector3d Unproject(const Eigen::Vector2d& m) {
    return m.homogeneous();
  }
};

// m has the direction of (x, y) and the length of the angle to the optical
// axis. The direction is undefined on the negative axis.
struct EquidistantProjection {
  static constexpr double kMaxRadius = kPi;

  static std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point) {
    const double r = point.head<2>().norm();
    if (r == 0.0 && !(point.z() > 0.0)) return std::nullopt;
    return Eigen::Vector2d(AnglePerRadius(r, point.z()) * point.head<2>());
  }
  // d m / d point.
  static Eigen::Matrix<double, 2, 3> Jacobian(const Eigen::Vector3d& point,
                                              const Eigen::Vector2d& m) {
    const double r = point.head<2>().norm();
    const double z = point.z();
    const double squared_norm = r * r + z * z;
    // |m| is the angle, which saves a second arc tangent.
    const double angle_per_r = r > 0.0 ? m.norm() / r : 1.0 / z;
    // On the axis the stretch is isotropic, so any direction is valid.
    Eigen::Vector2d e = Eigen::Vector2d::UnitX();
    if (r > 0.0) e = point.head<2>() / r;
    Eigen::Matrix<double, 2, 3> jacobian;
    jacobian.leftCols<2>() =
        angle_per_r * Eigen::Matrix2d::Identity() +
        (z / squared_norm - angle_per_r) * e * e.transpose();
    jacobian.col(2) = -point.head<2>() / squared_norm;
    return jacobian;
  }
  static Eigen::Vector3d Unproject(const Eigen::Vector2d& m) {
    const double angle = m.norm();
    const double sine_per_angle = angle > 0.0 ? std::sin(angle) / angle : 1.0;
    return {sine_per_angle * m.x(), sine_per_angle * m.y(), std::cos(angle)};
  }

 private:
  static double AnglePerRadius(double r, double z) {
    return r > 0.0 ? std::atan2(r, z) / r : 1.0 / z;
  }
};

template <class Projection, class Distortion>
struct DistortedLens {
  static constexpr int kNumParams = Distortion::kNumParams;

  static std::optional<Eigen::Vector2d> Project(
      const double* k, const Eigen::Vector3d& point,
      LensJacobians<kNumParams>* jacobians) {
    std::optional<Eigen::Vector2d> m = Projection::Project(point);
    if constexpr (kNumParams == 0) {  // no distortion
      if (m && jacobians != nullptr) {
        jacobians->point = Projection::Jacobian(point, *m);
      }
      return m;
    }
    if (!m || !Distortion::IsInjectiveTo(k, m->norm())) return std::nullopt;
    if (jacobians == nullptr) return Distortion::Distort(k, *m, nullptr);
    DistortionJacobians<kNumParams> of_m;
    const Eigen::Vector2d distorted = Distortion::Distort(k, *m, &of_m);
    jacobians->point = of_m.point * Projection::Jacobian(point, *m);
    jacobians->params = of_m.params;
    return distorted;
  }

  static std::optional<Eigen::Vector3d> Unproject(const double* k,
                                                  const Eigen::Vector2d& m) {
    const std::optional<Eigen::Vector2d> undistorted =
        Distortion::Undistort(k, m, Projection::kMaxRadius);
    if (!undistorted) return std::nullopt;
    return Projection::Unproject(*undistorted);
  }
};

// A denominator h(x^2 + y^2, z) and its derivatives.
template <int N>
struct Denominator {
  double value;
  double rho2;
  double z;
  Eigen::Matrix<double, 1, N> params;
};

// m = (x, y) / h for a Surface that provides h and the ray of m.
template <class Surface>
struct RatioLens {
  static constexpr int kNumParams = Surface::kNumParams;

  static std::optional<Eigen::Vector2d> Project(
      const double* k, const Eigen::Vector3d& point,
      LensJacobians<kNumParams>* jacobians) {
    const auto h =
        Surface::Evaluate(k, point.head<2>().squaredNorm(), point.z());
    if (!h) return std::nullopt;
    const double inverse = 1.0 / h->value;
    const Eigen::Vector2d m = inverse * point.head<2>();
    if (jacobians != nullptr) {
      jacobians->point.template leftCols<2>() =
          inverse * (Eigen::Matrix2d::Identity() -
                     2.0 * h->rho2 * m * point.head<2>().transpose());
      jacobians->point.col(2) = -inverse * h->z * m;
      jacobians->params = -inverse * m * h->params;
    }
    return m;
  }

  static std::optional<Eigen::Vector3d> Unproject(const double* k,
                                                  const Eigen::Vector2d& m) {
    return Surface::Unproject(k, m);
  }
};

// The division model (Fitzgibbon 2001): the ray of m is (m, 1 + k |m|^2). The
// angle to the axis increases with |m| while k |m|^2 < 1; for k < 0 it exceeds
// 90 degrees and approaches 180.
struct DivisionSurface {
  static constexpr int kNumParams = 1;

  static std::optional<Denominator<1>> Evaluate(const double* k, double rho2,
                                                double z) {
    const double discriminant = z * z - 4.0 * k[0] * rho2;
    if (!(discriminant > 0.0)) return std::nullopt;
    const double root = std::sqrt(discriminant);
    // (z + root) / 2 without cancellation behind the camera.
    const double value =
        z > 0.0 ? 0.5 * (z + root) : -2.0 * k[0] * rho2 / (root - z);
    if (!(value > 0.0)) return std::nullopt;
    return Denominator<1>{value, -k[0] / root, value / root,
                          Eigen::Matrix<double, 1, 1>(-rho2 / root)};
  }

  static std::optional<Eigen::Vector3d> Unproject(const double* k,
                                                  const Eigen::Vector2d& m) {
    const double k_r2 = k[0] * m.squaredNorm();
    if (!(k_r2 < 1.0)) return std::nullopt;
    return Eigen::Vector3d(m.x(), m.y(), 1.0 + k_r2);
  }
};

// The enhanced unified camera model (Khomutenko, Garcia and Martinet 2016):
// h = alpha d + (1 - alpha) z with d^2 = beta (x^2 + y^2) + z^2. |m| increases
// with the angle to the axis while (1 - alpha) d + alpha z > 0.
struct EucmSurface {
  static constexpr int kNumParams = 2;

  static std::optional<Denominator<2>> Evaluate(const double* k, double rho2,
                                                double z) {
    const double alpha = k[0], beta = k[1];
    const double d2 = beta * rho2 + z * z;
    if (!(d2 > 0.0)) return std::nullopt;
    const double d = std::sqrt(d2);
    const double value = alpha * d + (1.0 - alpha) * z;
    if (!(value > 0.0 && (1.0 - alpha) * d + alpha * z > 0.0)) {
      return std::nullopt;
    }
    return Denominator<2>{value, 0.5 * alpha * beta / d,
                          alpha * z / d + 1.0 - alpha,
                          Eigen::RowVector2d(d - z, 0.5 * alpha * rho2 / d)};
  }

  // The point with h = 1, where the root equals (1 - alpha) d + alpha z.
  static std::optional<Eigen::Vector3d> Unproject(const double* k,
                                                  const Eigen::Vector2d& m) {
    const double alpha = k[0], beta = k[1];
    const double r2 = m.squaredNorm();
    const double discriminant = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
    if (!(discriminant > 0.0)) return std::nullopt;
    const double z = (1.0 - alpha * alpha * beta * r2) /
                     (alpha * std::sqrt(discriminant) + 1.0 - alpha);
    return Eigen::Vector3d(m.x(), m.y(), z);
  }
};

// Camera models: lens, focal lengths and principal point.

// pixel = diag(f) m + c with the parameters f or fx fy, cx cy, lens parameters.
template <class Lens, int N>
struct FocalModel {
  static constexpr int kNumFocals = N;
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
