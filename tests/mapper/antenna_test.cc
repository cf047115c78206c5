// SPDX-License-Identifier: BSD-3-Clause
// The place of the antenna, estimated on request.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using testing::Contains;
using testing::HasSubstr;

constexpr double kPositionSigma_m = 0.1;

// An antenna of a body with other axes than the camera.
const Rigid3& CamFromAntenna() {
  static const Rigid3 pose{ExpSO3({1.4, 0.3, -0.2}), {0.2, -0.8, 0.1}};
  return pose;
}

Simulation AntennaDrive(PathPreset path) {
  SimulationOptions options;
  options.path = path;
  options.num_frames = 120;
  options.frame_spacing_m = 0.8;
  options.max_num_features_per_image = 80;
  options.num_points_per_frame = 40;
  return Simulate(options);
}

// Positions of an antenna that is `offset` away from where it is said to be.
PositionPriors MeasureAntenna(const Simulation& drive, const Vector3d& offset) {
  Random random(5);
  PositionPriors priors;
  priors.images.resize(drive.scene.images.size());
  for (size_t i = 0; i < priors.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    if (!drive.scene.IsReference(drive.scene.images[i].sensor_idx)) continue;
    const Vector3d noise(random.Normal(), random.Normal(), random.Normal());
    const Rigid3 pose =
        *drive.ground_truth.CamFromWorld(drive.scene, image_idx);
    priors.images[i] = PositionMeasurement{
        pose.Inverse() * (CamFromAntenna() * offset) + kPositionSigma_m * noise,
        kPositionSigma_m * kPositionSigma_m * Eigen::Matrix3d::Identity(),
        CamFromAntenna()};
  }
  return priors;
}

struct AntennaOutcome {
  MapperModel model;
  double median_error = 0.0;  // of camera centers, without alignment
  std::vector<std::string> warnings;
  std::vector<std::string> infos;
};

AntennaOutcome MapDrive(const Simulation& drive,
                        const PositionPriors& positions, bool estimates) {
  AntennaOutcome outcome;
  Context context;
  context.num_threads = 2;
  context.log = [&](LogLevel level, const std::string& message) {
    auto& messages =
        level >= LogLevel::kWarning ? outcome.warnings : outcome.infos;
    messages.push_back(message);
  };
  MapperOptions options;
  options.estimate_antenna = estimates;
  MapperResult result =
      RunMapper({drive.scene, drive.view_graph, positions}, options, context);
  outcome.model = std::move(result.models.at(0));
  std::vector<double> errors;
  for (size_t i = 0; i < drive.scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose =
        outcome.model.reconstruction.CamFromWorld(drive.scene, image_idx);
    if (!pose) continue;
    const auto truth = drive.ground_truth.CamFromWorld(drive.scene, image_idx);
    errors.push_back((pose->Center() - truth->Center()).norm());
  }
  outcome.median_error = Median(errors);
  return outcome;
}

// Sideways, as height shows in pitch only.
Vector3d SidewaysOffset(double meters) {
  return CamFromAntenna().rotation.conjugate() * (meters * Vector3d::UnitX());
}

TEST(AntennaTest, TurnsTellTheAntennaAndItIsUsed) {
  const Simulation drive = AntennaDrive(PathPreset::kCurve);
  const Vector3d offset = SidewaysOffset(1.2);
  const PositionPriors positions = MeasureAntenna(drive, offset);
  const AntennaOutcome given = MapDrive(drive, positions, false);
  EXPECT_FALSE(given.model.position_priors->antenna.has_value());
  EXPECT_THAT(given.warnings, Contains(HasSubstr("add [")));
  const AntennaOutcome estimated = MapDrive(drive, positions, true);
  ASSERT_TRUE(estimated.model.position_priors->antenna.has_value());
  const AntennaEstimate& antenna = *estimated.model.position_priors->antenna;
  EXPECT_LT((antenna.offset - offset).norm(), 6.0 * antenna.sigma);
  EXPECT_LT(antenna.sigma, 0.15);
  EXPECT_THAT(estimated.warnings, testing::Not(Contains(HasSubstr("add ["))));
  EXPECT_LT(estimated.median_error, 0.5 * given.median_error);
  // As with positions that belong to the place that is given.
  const AntennaOutcome perfect =
      MapDrive(drive, MeasureAntenna(drive, Vector3d::Zero()), false);
  EXPECT_LT(estimated.median_error, perfect.median_error + 3.0 * antenna.sigma);
  for (const auto& prior : estimated.model.PositionsOf(positions).images) {
    if (!prior) continue;
    EXPECT_LT((prior->cam_from_antenna.translation -
               CamFromAntenna() * antenna.offset)
                  .norm(),
              1e-12);
  }
}

TEST(AntennaTest, AnAntennaAtItsPlaceStaysThere) {
  const Simulation drive = AntennaDrive(PathPreset::kCurve);
  const AntennaOutcome outcome =
      MapDrive(drive, MeasureAntenna(drive, Vector3d::Zero()), true);
  ASSERT_TRUE(outcome.model.position_priors->antenna.has_value());
  EXPECT_TRUE(outcome.model.position_priors->antenna->offset.isZero(0.0));
  EXPECT_GT(outcome.model.position_priors->antenna->sigma, 0.0);
}

TEST(AntennaTest, StraightMotionDoesNotTell) {
  const Simulation drive = AntennaDrive(PathPreset::kStraight);
  const AntennaOutcome outcome =
      MapDrive(drive, MeasureAntenna(drive, SidewaysOffset(1.2)), true);
  EXPECT_FALSE(outcome.model.position_priors->antenna.has_value());
  EXPECT_THAT(outcome.warnings,
              Contains(HasSubstr("estimate_antenna is not possible")));
}

// Images have the positions of others, a quarter of the drive ahead. The
// antenna that fits them is as wrong as they are, so that it goes when they do.
TEST(AntennaTest, IgnoredPositionsTellNoAntenna) {
  const Simulation drive = AntennaDrive(PathPreset::kCurve);
  PositionPriors positions = MeasureAntenna(drive, Vector3d::Zero());
  std::vector<std::optional<PositionMeasurement>*> measured;
  for (auto& prior : positions.images) {
    if (prior) measured.push_back(&prior);
  }
  const size_t shift = measured.size() / 4;
  const PositionPriors right = positions;
  for (size_t k = 0; k < measured.size(); ++k) {
    const size_t from = (k + shift) % measured.size();
    *measured[k] = right.images[measured[from] - positions.images.data()];
  }
  const AntennaOutcome outcome = MapDrive(drive, positions, true);
  EXPECT_THAT(outcome.infos, Contains(testing::StartsWith("antenna: ")));
  ASSERT_TRUE(outcome.model.position_priors.has_value());
  EXPECT_FALSE(outcome.model.position_priors->is_registered);
  EXPECT_THAT(outcome.model.position_priors->message,
              HasSubstr("they are ignored"));
  EXPECT_FALSE(outcome.model.position_priors->antenna.has_value());
  const PositionPriors of_model = outcome.model.PositionsOf(positions);
  for (size_t i = 0; i < positions.images.size(); ++i) {
    if (!positions.images[i]) continue;
    EXPECT_EQ(of_model.images[i]->cam_from_antenna.translation,
              positions.images[i]->cam_from_antenna.translation);
  }
}

}  // namespace
}  // namespace mgsfm
