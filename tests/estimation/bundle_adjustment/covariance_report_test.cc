// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/covariance_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mgsfm {
namespace {

struct RigWithCovariances {
  Scene scene;
  Reconstruction model;
  CovarianceResult covariances;
};

// Two cameras whose centers are two units apart, and three frames.
RigWithCovariances MakeRig(double sigma_of_sensor, double sigma_of_frames,
                           double unit) {
  RigWithCovariances rig;
  rig.scene.sensors.resize(2);
  rig.scene.sensors[1].name = "left";
  rig.model.sensor_from_rig.assign(2, Rigid3());
  rig.model.sensor_from_rig[1]->translation =
      unit * Eigen::Vector3d(1.2, 0.0, -1.6);
  const auto covariance = [unit](double sigma) {
    PoseMatrix C = PoseMatrix::Zero();
    C.topLeftCorner<3, 3>().diagonal().setConstant(1e-6);
    C.bottomRightCorner<3, 3>().diagonal().setConstant(sigma * sigma * unit *
                                                       unit);
    return C;
  };
  rig.covariances.sensors = {covariance(0.0), covariance(sigma_of_sensor)};
  rig.covariances.frames = {covariance(0.0), covariance(sigma_of_frames),
                            covariance(sigma_of_frames)};
  return rig;
}

bool IsNamed(const RigWithCovariances& rig) {
  const std::string text =
      DescribeUnobservable(rig.scene, rig.model, rig.covariances);
  EXPECT_THAT(text, testing::AnyOf("", testing::HasSubstr("left")));
  return !text.empty();
}

TEST(CovarianceReportTest, PlacesThatCouldBeThatOfTheReferenceAreNamed) {
  for (const double unit : {1e-3, 1.0, 1e3}) {
    EXPECT_TRUE(IsNamed(MakeRig(1.0, 0.1, unit)));
    EXPECT_FALSE(IsNamed(MakeRig(0.1, 0.01, unit)));
    // Frames that are as uncertain do not suffer from the rig.
    EXPECT_FALSE(IsNamed(MakeRig(1.0, 2.0, unit)));
    EXPECT_FALSE(IsNamed(MakeRig(0.0, 0.1, unit)));  // known
  }
}

// Only the uncertainty along the baseline tells the centers apart.
TEST(CovarianceReportTest, UncertaintyAcrossTheBaselineDoesNotCount) {
  RigWithCovariances rig = MakeRig(0.1, 0.01, 1.0);
  PoseMatrix& C = *rig.covariances.sensors[1];
  C(4, 4) = 9.0;
  EXPECT_FALSE(IsNamed(rig));
  C(4, 4) = 0.01;
  const Eigen::Vector3d along(0.6, 0.0, -0.8);
  C.bottomRightCorner<3, 3>() += 9.0 * along * along.transpose();
  EXPECT_TRUE(IsNamed(rig));
}

}  // namespace
}  // namespace mgsfm
