// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "estimation/input_check/sound_drive.h"
#include "input_check/camera_checks.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

Simulation DriveWithFactor(double factor, PathPreset path) {
  Simulation drive = SoundDrive(RigPreset::kStereo, path);
  for (Camera& camera : drive.scene.cameras) {
    camera.has_prior_focal_length = true;
    for (const int i : InfoOf(camera.model).focal_length_idxs) {
      camera.params[i] *= factor;
    }
  }
  return drive;
}

std::vector<Finding> Check(const Simulation& drive) {
  return CheckTrustedFocalLengths(drive.scene, drive.view_graph, Context());
}

TEST(TrustedFocalLengthsTest, CorrectOnesPass) {
  for (const PathPreset path : {PathPreset::kCurve, PathPreset::kLoop,
                                PathPreset::kStraight, PathPreset::kStanding}) {
    EXPECT_THAT(Check(DriveWithFactor(1.0, path)), IsEmpty());
  }
}

TEST(TrustedFocalLengthsTest, WrongOnesAreNamedWithTheirCamera) {
  for (const double factor : {0.7, 1.3}) {
    const auto findings = Check(DriveWithFactor(factor, PathPreset::kLoop));
    ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kWrongFocalLength,
                                                Cause::kWrongFocalLength));
    EXPECT_THAT(findings[0].cameras, ElementsAre("cam0"));
    EXPECT_NEAR(findings[0].evidence[1].second * factor /
                    findings[0].evidence[0].second,
                1.0, 0.01);
  }
}

}  // namespace
}  // namespace mgsfm
