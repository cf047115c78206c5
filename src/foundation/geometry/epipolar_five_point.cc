// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>

#include "geometry/epipolar.h"

namespace mgsfm {
namespace {

// Coefficients of polynomials in x, y, z for the monomials
//   linear:    x y z 1
//   quadratic: x2 xy y2 xz yz z2 x y z 1
//   cubic:     x3 x2y xy2 y3 x2z xyz y2z xz2 yz2 z3, then the quadratic ones.
using Linear = Eigen::Matrix<double, 4, 1>;
using Quadratic = Eigen::Matrix<double, 10, 1>;
using Cubic = Eigen::Matrix<double, 20, 1>;

// The index of the product of two monomials.
constexpr int kQuadraticOf[4][4] = {
    {0, 1, 3, 6}, {1, 2, 4, 7}, {3, 4, 5, 8}, {6, 7, 8, 9}};
constexpr int kCubicOf[10][4] = {
    {0, 1, 4, 10},    {1, 2, 5, 11},   {2, 3, 6, 12},    {4, 5, 7, 13},
    {5, 6, 8, 14},    {7, 8, 9, 15},   {10, 11, 13, 16}, {11, 12, 14, 17},
    {13, 14, 15, 18}, {16, 17, 18, 19}};

void AddProduct(const Linear& p, const Linear& q, Quadratic* sum) {
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) (*sum)(kQuadraticOf[i][j]) += p(i) * q(j);
  }
}

void AddProduct(const Quadratic& p, const Linear& q, Cubic* sum) {
  for (int i = 0; i < 10; ++i) {
    for (int j = 0; j < 4; ++j) (*sum)(kCubicOf[i][j]) += p(i) * q(j);
  }
}

// A 3x3 matrix of linear polynomials.
struct LinearMatrix {
  std::array<Linear, 9> entries;
  const Linear& operator()(int row, int col) const {
    return entries[3 * row + col];
  }
};

// E = x E1 + y E2 + z E3 + E4, the null space of the five linear constraints.
LinearMatrix EssentialsThroughMatches(
    const std::array<Eigen::Vector3d, 5>& rays1,
    const std::array<Eigen::Vector3d, 5>& rays2) {
  Eigen::Matrix<double, 9, 5> constraints;
  for (int i = 0; i < 5; ++i) {
    for (int row = 0; row < 3; ++row) {
      constraints.block<3, 1>(3 * row, i) = rays2[i](row) * rays1[i];
    }
  }
  // The last columns of Q span the orthogonal complement of the constraints.
  const Eigen::ColPivHouseholderQR<Eigen::Matrix<double, 9, 5>> qr(constraints);
  Eigen::Matrix<double, 9, 4> null_space;
  null_space << Eigen::Matrix<double, 5, 4>::Zero(),
      Eigen::Matrix4d::Identity();
  Eigen::Vector4d workspace;
  for (int k = 4; k >= 0; --k) {
    null_space.bottomRows(9 - k).applyHouseholderOnTheLeft(
        qr.matrixQR().col(k).tail(8 - k), qr.hCoeffs()(k), workspace.data());
  }
  LinearMatrix essential;
  for (int i = 0; i < 9; ++i) {
    essential.entries[i] = null_space.row(i).transpose();
  }
  return essential;
}

Quadratic Minor(const LinearMatrix& E, int col1, int col2) {
  Quadratic minor = Quadratic::Zero();
  AddProduct(E(1, col1), E(2, col2), &minor);
  AddProduct(-E(1, col2), E(2, col1), &minor);
  return minor;
}

// The rows det E = 0 and E E^T E - trace(E E^T) / 2 E = 0.
Eigen::Matrix<double, 10, 20> EssentialConstraints(const LinearMatrix& E) {
  Quadratic products[3][3];  // E E^T - trace(E E^T) / 2 I
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      products[i][j].setZero();
      for (int k = 0; k < 3; ++k) {
        AddProduct(E(i, k), E(j, k), &products[i][j]);
      }
      products[j][i] = products[i][j];
    }
  }
  const Quadratic half_trace =
      0.5 * (products[0][0] + products[1][1] + products[2][2]);
  for (int i = 0; i < 3; ++i) products[i][i] -= half_trace;

  Eigen::Matrix<double, 10, 20> constraints;
  Cubic determinant = Cubic::Zero();
  for (int col = 0; col < 3; ++col) {
    AddProduct(Minor(E, (col + 1) % 3, (col + 2) % 3), E(0, col), &determinant);
  }
  constraints.row(0) = determinant.transpose();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic trace_constraint = Cubic::Zero();
      for (int k = 0; k < 3; ++k) {
        AddProduct(products[i][k], E(k, j), &trace_constraint);
      }
      constraints.row(1 + 3 * i + j) = trace_constraint.transpose();
    }
  }
  return constraints;
}

// Multiplication of the quadratic monomials by x modulo the constraints. The
// eigenvectors contain the values of the monomials at the solutions.
Eigen::Matrix<double, 10, 10> ActionMatrix(
    const Eigen::Matrix<double, 10, 20>& constraints) {
  const Eigen::Matrix<double, 10, 10> cubic_of_quadratic =
      -constraints.leftCols<10>().partialPivLu().solve(
          constraints.rightCols<10>());
  Eigen::Matrix<double, 10, 10> action = Eigen::Matrix<double, 10, 10>::Zero();
  for (int i = 0; i < 10; ++i) {
    const int product = kCubicOf[i][0];
    if (product < 10) {
      action.row(i) = cubic_of_quadratic.row(product);
    } else {
      action(i, product - 10) = 1.0;
    }
  }
  return action;
}

}  // namespace

int SolveFivePoint(const std::array<Eigen::Vector3d, 5>& rays1,
                   const std::array<Eigen::Vector3d, 5>& rays2,
                   std::array<Eigen::Matrix3d, 10>* essentials) {
  const LinearMatrix E = EssentialsThroughMatches(rays1, rays2);
  const Eigen::Matrix<double, 10, 10> action =
      ActionMatrix(EssentialConstraints(E));
  if (!action.allFinite()) return 0;
  const Eigen::EigenSolver<Eigen::Matrix<double, 10, 10>> solver(action);
  if (solver.info() != Eigen::Success) return 0;
  int num_solutions = 0;
  for (int i = 0; i < 10; ++i) {
    const std::complex<double> eigenvalue = solver.eigenvalues()(i);
    if (std::abs(eigenvalue.imag()) > 1e-9 * (1.0 + std::abs(eigenvalue))) {
      continue;
    }
    // The coefficients of E1 to E4, up to scale.
    const Linear coefficients = solver.eigenvectors().col(i).real().tail<4>();
    Eigen::Matrix3d& essential = (*essentials)[num_solutions];
    for (int k = 0; k < 9; ++k) {
      essential(k / 3, k % 3) = E.entries[k].dot(coefficients);
    }
    const double norm = essential.norm();
    if (!(norm > 1e-12)) continue;
    essential *= std::sqrt(2.0) / norm;
    ++num_solutions;
  }
  return num_solutions;
}

}  // namespace mgsfm
