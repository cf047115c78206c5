// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimation/input_check/sound_drive.h"
#include "input_check/camera_checks.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

void Scale(int sensor_idx, float factor, Simulation* drive) {
  for (Image& image : drive->scene.images) {
    if (image.sensor_idx != sensor_idx) continue;
    for (Eigen::Vector2f& keypoint : image.keypoints_px) keypoint *= factor;
  }
}

TEST(ImageSizesTest, SoundImagesFit) {
  for (const RigPreset rig :
       {RigPreset::kStereo, RigPreset::kKitti360, RigPreset::kCube6}) {
    EXPECT_THAT(CheckImageSizes(SoundDrive(rig).scene), IsEmpty());
  }
}

TEST(ImageSizesTest, OtherSizesAreNamed) {
  for (const float factor : {0.5F, 2.0F}) {
    Simulation drive = SoundDrive();
    Scale(1, factor, &drive);
    const auto findings = CheckImageSizes(drive.scene);
    ASSERT_THAT(CausesOf(findings), ElementsAre(Cause::kWrongImageSize));
    EXPECT_THAT(findings[0].cameras, ElementsAre("cam1"));
  }
}

// A mask or the sky leaves a part of all images without features.
TEST(ImageSizesTest, FeaturesOnOneSideFit) {
  Simulation drive = SoundDrive();
  for (Image& image : drive.scene.images) {
    for (Eigen::Vector2f& keypoint : image.keypoints_px) keypoint.y() *= 0.5F;
  }
  EXPECT_THAT(CheckImageSizes(drive.scene), IsEmpty());
}

}  // namespace
}  // namespace mgsfm
