// SPDX-License-Identifier: BSD-3-Clause
// Inconsistent input is named, sound input causes no warning.
#include "mapper/input_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "base/random.h"
#include "estimation/input_check/sound_drive.h"
#include "mapper/run_summary.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

struct Outcome {
  MapperResult result;
  std::vector<std::string> warnings;  // as logged
};

Outcome Map(const MapperInput& input) {
  Outcome outcome;
  Context context;
  context.num_threads = 2;
  context.log = [&](LogLevel level, const std::string& message) {
    if (level >= LogLevel::kWarning) outcome.warnings.push_back(message);
  };
  outcome.result = RunMapper(input, MapperOptions(), context);
  return outcome;
}

MapperInput InputOf(const Simulation& drive) {
  return {drive.scene, drive.view_graph};
}

TEST(InputCheckTest, SoundDrivesCauseNoWarning) {
  for (const RigPreset rig :
       {RigPreset::kMono, RigPreset::kStereo, RigPreset::kKitti360}) {
    const Simulation drive = SoundDrive(rig);
    const Outcome outcome = Map(InputOf(drive));
    EXPECT_THAT(outcome.warnings, IsEmpty());
    EXPECT_THAT(CausesOf(outcome.result.findings), IsEmpty());
    ASSERT_EQ(outcome.result.models.size(), 1u);
    EXPECT_GT(outcome.result.models[0].kept_matches.total.Share(), 0.9);
  }
}

// A lag also turns the camera in its rig, and frames may be lost, or all.
TEST(InputCheckTest, LagIsNamedAndNotItsEffects) {
  Simulation drive = SoundDrive();
  Delay(1, 1, &drive);
  const Outcome outcome = Map(InputOf(drive));
  EXPECT_THAT(CausesOf(outcome.result.findings),
              testing::AnyOf(
                  ElementsAre(Cause::kCameraLag),
                  ElementsAre(Cause::kCameraLag, Cause::kNoModel),
                  ElementsAre(Cause::kCameraLag, Cause::kFewImagesRegistered)));
  EXPECT_THAT(outcome.warnings,
              Contains(HasSubstr("'cam1' is 1 frame behind")));
}

void TrustFocalLengths(double factor, Simulation* drive) {
  for (Camera& camera : drive->scene.cameras) {
    camera.has_prior_focal_length = true;
    for (const int i : InfoOf(camera.model).focal_length_idxs) {
      camera.params[i] *= factor;
    }
  }
  for (ImagePair& pair : drive->view_graph.pairs) {
    pair.relative_pose.reset();
    pair.E.reset();
    pair.F.reset();
  }
}

// A model can explain nearly all matches with a focal length that is 30 %
// wrong, if it bends: the matches that it keeps do not refute the doubt.
TEST(InputCheckTest, WrongFocalLengthsAreNamedThoughTheModelKeepsItsMatches) {
  for (const double factor : {0.7, 1.3}) {
    Simulation drive = SoundDrive();
    TrustFocalLengths(factor, &drive);
    EXPECT_THAT(CausesOf(Map(InputOf(drive)).result.findings),
                Contains(Cause::kWrongFocalLength));
  }
  Simulation drive = SoundDrive();
  TrustFocalLengths(1.0, &drive);
  EXPECT_THAT(Map(InputOf(drive)).warnings, IsEmpty());
}

TEST(InputCheckTest, FewRegisteredImagesAreAWarningWithACause) {
  Simulation drive = SoundDrive();
  for (ImagePair& pair : drive.view_graph.pairs) {
    const int frame = std::max(drive.scene.images[pair.image_idx1].frame_idx,
                               drive.scene.images[pair.image_idx2].frame_idx);
    if (frame >= 15) pair.matches.clear();
  }
  const Outcome outcome = Map(InputOf(drive));
  ASSERT_THAT(CausesOf(outcome.result.findings),
              ElementsAre(Cause::kFewImagesRegistered));
  EXPECT_THAT(outcome.warnings,
              ElementsAre(HasSubstr("only 30 of 80 images are registered")));
  const auto lines = DescribeRun(SummarizeRun(drive.scene, outcome.result));
  EXPECT_THAT(lines, Contains(HasSubstr("30 of 80 registered")));
  EXPECT_THAT(lines, Contains(HasSubstr("missing: 25 frames")));
}

TEST(InputCheckTest, TheSummaryStatesOnHowMuchItsClaimsRest) {
  const Simulation drive = SoundDrive();
  MapperResult result;
  result.models.emplace_back();
  Reconstruction& model = result.models[0].reconstruction;
  model = drive.ground_truth;
  // All observations of the second camera, but for three in one image.
  size_t num_left = 0;
  int seen_image_idx = -1;
  for (Point3D& point : model.points) {
    const auto goes = [&](const Observation& o) {
      if (drive.scene.images[o.image_idx].sensor_idx == 0) return false;
      if (seen_image_idx < 0) seen_image_idx = o.image_idx;
      return o.image_idx != seen_image_idx || ++num_left > 3;
    };
    point.track.erase(
        std::remove_if(point.track.begin(), point.track.end(), goes),
        point.track.end());
  }
  const size_t num_empty = drive.scene.images.size() / 2 - 1;
  const auto lines = DescribeRun(SummarizeRun(drive.scene, result));
  EXPECT_THAT(lines, Contains(HasSubstr("'cam1' by 3 observations")));
  EXPECT_THAT(lines, Contains(HasSubstr(std::to_string(num_empty) +
                                        " of the images have no points")));
}

TEST(InputCheckTest, CamerasThatShareNoFrameAreAWarning) {
  const Simulation drive = SoundDrive();
  MapperInput input = InputOf(drive);
  input.scene = SeparateImages(input.scene);
  // One rig per camera.
  EXPECT_THAT(CausesOf(Map(input).result.findings),
              Contains(Cause::kNoSharedFrames));
  input.expects_rigs = false;
  EXPECT_THAT(CausesOf(Map(input).result.findings),
              testing::Not(Contains(Cause::kNoSharedFrames)));
}

// One direction in all camera frames, although the rig turns about gravity: no
// such direction is vertical.
TEST(InputCheckTest, WrongGravityDoesNotSplitADrive) {
  const Simulation drive = SoundDrive(RigPreset::kStereo, PathPreset::kLoop);
  MapperInput input = InputOf(drive);
  input.gravity_priors.images.assign(drive.scene.images.size(),
                                     Vector3d::UnitZ());
  const Outcome outcome = Map(input);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  EXPECT_THAT(CausesOf(outcome.result.findings),
              testing::AnyOf(ElementsAre(Cause::kRejectedGravityPriors),
                             ElementsAre(Cause::kOutlierGravityPriors)));
}

// Positions of another drive, thousands of times larger.
TEST(InputCheckTest, PositionsThatBendTheModelAreRejected) {
  const Simulation drive = SoundDrive();
  MapperInput input = InputOf(drive);
  input.position_priors.images.resize(drive.scene.images.size());
  Random random(3);
  for (size_t i = 0; i < drive.scene.images.size(); i += 2) {
    input.position_priors.images[i] = PositionMeasurement{
        1e4 * Vector3d(random.Uniform(), random.Uniform(), random.Uniform()),
        Eigen::Matrix3d::Identity()};
  }
  const Outcome outcome = Map(input);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_THAT(CausesOf(outcome.result.findings),
              testing::AnyOf(ElementsAre(Cause::kRejectedPositionPriors),
                             ElementsAre(Cause::kOutlierPositionPriors)));
}

}  // namespace
}  // namespace mgsfm
