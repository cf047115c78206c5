// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "geometry/absolute_pose.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The product of two polynomials in ascending order of coefficients.
template <int kSize1, int kSize2>
Eigen::Matrix<double, kSize1 + kSize2 - 1, 1> Multiply(
    const Eigen::Matrix<double, kSize1, 1>& a,
    const Eigen::Matrix<double, kSize2, 1>& b) {
  Eigen::Matrix<double, kSize1 + kSize2 - 1, 1> product;
  product.setZero();
  for (int i = 0; i < kSize1; ++i) {
    product.template segment<kSize2>(i) += a[i] * b;
  }
  return product;
}

// The positive real roots as eigenvalues of the companion matrix. Returns the
// number of roots.
int PositiveRoots(const Eigen::Matrix<double, 5, 1>& polynomial,
                  std::array<double, 4>* roots) {
  int degree = 4;
  const double largest = polynomial.cwiseAbs().maxCoeff();
  while (degree > 0 && std::abs(polynomial[degree]) <= 1e-14 * largest) {
    --degree;
  }
  if (degree == 0) return 0;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 4, 4> companion;
  companion.setZero(degree, degree);
  for (int i = 0; i < degree; ++i) {
    companion(i, degree - 1) = -polynomial[i] / polynomial[degree];
    if (i > 0) companion(i, i - 1) = 1.0;
  }
  const auto eigenvalues = companion.eigenvalues().eval();
  int num_roots = 0;
  for (int i = 0; i < degree; ++i) {
    const double real = eigenvalues[i].real();
    const double imaginary = std::abs(eigenvalues[i].imag());
    // Rounding gives a root of multiplicity m an imaginary part of about
    // eps^(1/m), 1e-4 for m = 4. Newton steps polish the accepted roots.
    if (real > 0.0 && imaginary <= 1e-3 * (1.0 + real)) {
      (*roots)[num_roots++] = real;
    }
  }
  return num_roots;
}

// Three rays from one center to points with known distances between each other.
// The unknowns are the depths s along the rays:
//   s_i^2 + s_j^2 - 2 s_i s_j cos_ij = d_ij^2 .
class ThreeRays {
 public:
  ThreeRays(const std::array<Vector3d, 3>& rays,
            const std::array<Vector3d, 3>& points)
      : squared_(Squared(points)),
        cosine_(rays[1].dot(rays[2]), rays[0].dot(rays[2]),
                rays[0].dot(rays[1])) {}

  // Computes up to four solutions and returns their number.
  //
  // Let s_1 = u s_0, s_2 = v s_0 and B(v) = 1 + v^2 - 2 v cos_02, so that
  // s_0^2 B = d_02^2. Dividing the other two equations by this one gives
  //   u^2 + v^2 - 2 u v cos_12 = (d_12 / d_02)^2 B,
  //   1 + u^2 - 2 u cos_01     = (d_01 / d_02)^2 B .
  // Their difference is linear in u, so u = N(v) / D(v), and the last one
  // becomes
  //   N^2 - 2 cos_01 N D + (1 - (d_01 / d_02)^2 B) D^2 = 0 .
  int Solve(std::array<Vector3d, 4>* lengths) const {
    if (!(squared_.minCoeff() > 1e-18 * squared_.maxCoeff())) return 0;
    const double ratio0 = squared_[0] / squared_[1];
    const double ratio2 = squared_[2] / squared_[1];
    const Vector3d b(1.0, -2.0 * cosine_[1], 1.0);
    const Vector3d n = Vector3d(-1.0, 0.0, 1.0) - (ratio0 - ratio2) * b;
    const Eigen::Vector2d d(-2.0 * cosine_[2], 2.0 * cosine_[0]);
    const Vector3d rest = Vector3d(1.0, 0.0, 0.0) - ratio2 * b;
    Eigen::Matrix<double, 5, 1> quartic =
        Multiply<3, 3>(n, n) + Multiply<3, 3>(rest, Multiply<2, 2>(d, d));
    quartic.head<4>() -= 2.0 * cosine_[2] * Multiply<3, 2>(n, d);

    std::array<double, 4> roots;
    const int num_roots = PositiveRoots(quartic, &roots);
    int num_lengths = 0;
    for (int i = 0; i < num_roots; ++i) {
      const double v = roots[i];
      const double numerator = n[0] + v * (n[1] + v * n[2]);
      const double denominator = d[0] + v * d[1];
      if (std::abs(denominator) > 1e-4) {
        Append(numerator / denominator, v, lengths, &num_lengths);
        continue;
      }
      // Numerator and denominator are near zero: solve the last equation, which
      // is quadratic in u.
      const double by_v = b[0] + v * (b[1] + v * b[2]);
      const double discriminant = cosine_[2] * cosine_[2] - 1.0 + ratio2 * by_v;
      const double root = std::sqrt(std::max(0.0, discriminant));
      Append(cosine_[2] - root, v, lengths, &num_lengths);
      Append(cosine_[2] + root, v, lengths, &num_lengths);
    }
    return num_lengths;
  }

 private:
  // The squared length of the side opposite to each point.
  static Vector3d Squared(const std::array<Vector3d, 3>& points) {
    return {(points[1] - points[2]).squaredNorm(),
            (points[0] - points[2]).squaredNorm(),
            (points[0] - points[1]).squaredNorm()};
  }

  bool Polish(Vector3d* s) const {
    for (int step = 0;; ++step) {
      Vector3d residual;
      Matrix3d jacobian = Matrix3d::Zero();
      for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const double si = (*s)[i], sj = (*s)[j];
        residual[k] =
            si * si + sj * sj - 2.0 * si * sj * cosine_[k] - squared_[k];
        jacobian(k, i) = 2.0 * (si - sj * cosine_[k]);
        jacobian(k, j) = 2.0 * (sj - si * cosine_[k]);
      }
      const double error = residual.cwiseAbs().maxCoeff();
      // Relative to the largest squared distance between the points.
      if (!(error <= 1e-9 * squared_.maxCoeff())) {
        // Roots have at least four correct digits, and each step doubles them:
        // two steps suffice, except for nearly double roots.
        if (step == 5) return false;
      } else if (step >= 2) {
        return s->minCoeff() > 0.0;
      }
      const Vector3d change = jacobian.partialPivLu().solve(residual);
      if (!change.allFinite()) return false;
      *s -= change;
    }
  }

  // Appends a solution unless it is invalid or already present.
  void Append(double u, double v, std::array<Vector3d, 4>* lengths,
              int* num_lengths) const {
    const double by_v = 1.0 + v * v - 2.0 * v * cosine_[1];
    if (!(u > 0.0) || !(by_v > 0.0) || *num_lengths == 4) return;
    Vector3d s = std::sqrt(squared_[1] / by_v) * Vector3d(1.0, u, v);
    if (!Polish(&s)) return;
    for (int i = 0; i < *num_lengths; ++i) {
      if (((*lengths)[i] - s).norm() < 1e-9 * s.norm()) return;
    }
    (*lengths)[(*num_lengths)++] = s;
  }

  const Vector3d squared_;
  const Vector3d cosine_;
};

// The axes of a triangle. Returns false for collinear corners.
bool TriangleAxes(const std::array<Vector3d, 3>& points, Matrix3d* axes) {
  const Vector3d x = (points[1] - points[0]).normalized();
  const Vector3d side = points[2] - points[0];
  const Vector3d normal = x.cross(side);
  if (!(normal.norm() > 1e-9 * side.norm())) return false;
  const Vector3d z = normal.normalized();
  *axes << x, z.cross(x), z;
  return true;
}

}  // namespace

int SolveP3P(const std::array<Vector3d, 3>& rays,
             const std::array<Vector3d, 3>& points,
             std::array<Rigid3, 4>* cam_from_world) {
  Matrix3d world_axes, cam_axes;
  if (!TriangleAxes(points, &world_axes)) return 0;
  std::array<Vector3d, 4> lengths;
  const int num_lengths = ThreeRays(rays, points).Solve(&lengths);
  int num_poses = 0;
  for (int i = 0; i < num_lengths; ++i) {
    std::array<Vector3d, 3> in_cam;
    for (int k = 0; k < 3; ++k) in_cam[k] = lengths[i][k] * rays[k];
    if (!TriangleAxes(in_cam, &cam_axes)) continue;
    Rigid3& pose = (*cam_from_world)[num_poses++];
    pose.rotation =
        Eigen::Quaterniond(Matrix3d(cam_axes * world_axes.transpose()))
            .normalized();
    pose.translation = in_cam[0] - pose.rotation * points[0];
  }
  return num_poses;
}

}  // namespace mgsfm
