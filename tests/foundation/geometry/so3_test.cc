// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/so3.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Vector3d RandomDirection(Random* random) {
  return Vector3d(random->Normal(), random->Normal(), random->Normal())
      .normalized();
}

// Angles over the whole range, near its ends and near the limits of the series.
std::vector<double> Angles() {
  return {0.0, 1e-300, 1e-12, 1e-8,       0.99e-4,    1.01e-4,
          0.1, 1.0,    3.0,   kPi - 1e-4, kPi - 1e-9, kPi - 1e-13};
}

TEST(SO3, CrossMatrixIsTheCrossProduct) {
  const Vector3d a(1, -2, 3), b(0.5, 4, -1);
  EXPECT_LT((CrossMatrix(a) * b - a.cross(b)).norm(), 1e-15);
}

TEST(SO3, ExpIsRodrigues) {
  Random random(1);
  for (const double angle : Angles()) {
    const Vector3d axis = RandomDirection(&random);
    const Matrix3d expected = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    const Quaterniond q = ExpSO3(angle * axis);
    EXPECT_NEAR(q.norm(), 1.0, 1e-15);
    EXPECT_LT((q.toRotationMatrix() - expected).norm(), 1e-14) << angle;
  }
}

TEST(SO3, LogInvertsExp) {
  Random random(2);
  for (const double angle : Angles()) {
    for (int i = 0; i < 20; ++i) {
      const Vector3d omega = angle * RandomDirection(&random);
      const Quaterniond q = ExpSO3(omega);
      EXPECT_LE((LogSO3(q) - omega).norm(), 1e-14 * (1.0 + angle)) << angle;
      // q and -q are the same rotation.
      const Quaterniond minus_q(-q.coeffs());
      EXPECT_LE((LogSO3(minus_q) - omega).norm(), 1e-14 * (1.0 + angle));
    }
  }
}

TEST(SO3, LogIsAtMostAHalfTurn) {
  const Vector3d axis = Vector3d(1, 2, -2) / 3.0;
  EXPECT_LT((LogSO3(ExpSO3((kPi + 0.3) * axis)) + (kPi - 0.3) * axis).norm(),
            1e-14);
  const Vector3d half_turn =
      LogSO3(Quaterniond(0, axis.x(), axis.y(), axis.z()));
  EXPECT_NEAR(half_turn.norm(), kPi, 1e-14);
  EXPECT_LT(half_turn.cross(axis).norm(), 1e-14);
}

TEST(SO3, InverseRightJacobianIsThatOfFiniteDifferences) {
  Random random(3);
  constexpr double kStep = 1e-6;
  for (const double angle : Angles()) {
    const Vector3d omega = angle * RandomDirection(&random);
    const Quaterniond inverse = ExpSO3(omega).conjugate();
    Matrix3d jacobian;
    for (int k = 0; k < 3; ++k) {
      const Vector3d step = kStep * Vector3d::Unit(k);
      jacobian.col(k) = (LogSO3(inverse * ExpSO3(omega + step)) -
                         LogSO3(inverse * ExpSO3(omega - step))) /
                        (2 * kStep);
    }
    const Matrix3d product = InverseRightJacobianSO3(omega) * jacobian;
    EXPECT_LT((product - Matrix3d::Identity()).norm(), 1e-8) << angle;
  }
}

TEST(SO3, UnitQuaternionsKeepTheirBits) {
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Quaterniond unit =
        ExpSO3(random.Uniform(0.0, 3.0) * RandomDirection(&random));
    EXPECT_EQ(ToUnitQuaternion(unit).coeffs(), unit.coeffs());
    const double length = std::exp(random.Uniform(-20.0, 20.0));
    const Eigen::Quaterniond scaled(length * unit.coeffs());
    const Eigen::Quaterniond result = ToUnitQuaternion(scaled);
    EXPECT_LT((result.coeffs() - unit.coeffs()).norm(), 1e-15);
    EXPECT_EQ(ToUnitQuaternion(result).coeffs(), result.coeffs());
  }
}

TEST(SO3, AngleBetweenRotations) {
  Random random(5);
  for (const double angle : Angles()) {
    const Quaterniond a = ExpSO3(2.0 * RandomDirection(&random));
    const Quaterniond b = a * ExpSO3(angle * RandomDirection(&random));
    EXPECT_NEAR(AngleBetween(a, b), angle, 1e-14 * (1.0 + angle));
    EXPECT_NEAR(AngleBetween(b, a), angle, 1e-14 * (1.0 + angle));
    EXPECT_NEAR(AngleBetween(a, Quaterniond(-b.coeffs())), angle,
                1e-14 * (1.0 + angle));
  }
}

TEST(SO3, AngleBetweenVectors) {
  for (const double angle : Angles()) {
    const Vector3d a(3, 0, 0);
    const Vector3d b(0.1 * std::cos(angle), 0.1 * std::sin(angle), 0);
    EXPECT_NEAR(AngleBetween(a, b), angle, 1e-15 * (1.0 + angle));
  }
}

TEST(SO3, RotationBetweenIsTheSmallestThatTurnsOneToTheOther) {
  Random random(6);
  for (const double angle : Angles()) {
    const Vector3d a = RandomDirection(&random);
    const Vector3d b =
        Quaterniond(Eigen::AngleAxisd(angle, a.unitOrthogonal())) * a;
    const Quaterniond q = RotationBetween(2.0 * a, 0.1 * b);
    EXPECT_NEAR(q.norm(), 1.0, 1e-7);
    EXPECT_LT((q * a - b).norm(), 1e-7);
    EXPECT_NEAR(AngleBetween(q, Quaterniond::Identity()), angle, 1e-7);
  }
}

TEST(SO3, DegreesAndRadians) {
  EXPECT_DOUBLE_EQ(DegToRad(180.0), kPi);
  EXPECT_DOUBLE_EQ(RadToDeg(DegToRad(37.0)), 37.0);
}

}  // namespace
}  // namespace mgsfm
