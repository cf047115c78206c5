// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/position_offsets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using testing::AllOf;
using testing::HasSubstr;

// A drive at 8 m/s with images at 10 Hz, or at varying speed, and positions of
// an antenna in a rotated body, on a clock that is ahead.
class PositionOffsetsTest : public testing::Test {
 protected:
  void Drive(PathPreset path, double speed_change_s = 0.0) {
    SimulationOptions options;
    options.path = path;
    options.num_frames = 240;
    options.frame_spacing_m = 0.8;
    options.max_num_features_per_image = 20;
    options.num_points_per_frame = 20;
    simulation_ = Simulate(options);
    speed_change_s_ = speed_change_s;
    for (Image& image : simulation_.scene.images) {
      image.timestamp_s = TimeOf(image.frame_idx);
    }
  }
  double TimeOf(int frame_idx) const {
    return 0.1 * frame_idx + speed_change_s_ * std::sin(0.1 * frame_idx);
  }
  // The path of a point of the reference camera, between the frames.
  Vector3d PointAt(const Vector3d& point_in_cam, double time_s) const {
    const Scene& scene = simulation_.scene;
    size_t after = 1;
    while (after + 1 < scene.frames.size() &&
           TimeOf(static_cast<int>(after)) < time_s) {
      ++after;
    }
    const auto point = [&](size_t f) {
      return simulation_.ground_truth.rig_from_world[f]->Inverse() *
             point_in_cam;
    };
    const double begin_s = TimeOf(static_cast<int>(after) - 1);
    const double share =
        (time_s - begin_s) / (TimeOf(static_cast<int>(after)) - begin_s);
    return (1.0 - share) * point(after - 1) + share * point(after);
  }
  // The estimate after a small similarity, from an antenna that is `lever` away
  // from where it is taken to be.
  PositionOffsets Estimate(double ahead_s, const Vector3d& lever) const {
    constexpr double kSigma_m = 0.3;
    Random random(3);
    PositionPriors priors;
    priors.images.resize(simulation_.scene.images.size());
    const Rigid3 cam_from_antenna{ExpSO3({1.4, 0.3, -0.2}), {0.2, -0.8, 0.1}};
    for (size_t i = 0; i < priors.images.size(); ++i) {
      const Image& image = simulation_.scene.images[i];
      if (!simulation_.scene.IsReference(image.sensor_idx)) continue;
      Vector3d noise(random.Normal(), random.Normal(), random.Normal());
      if (random.Index(20) == 0) noise *= 60.0;  // 5 % outliers
      priors.images[i] = PositionMeasurement{
          PointAt(cam_from_antenna * lever, TimeOf(image.frame_idx) - ahead_s) +
              kSigma_m * noise,
          kSigma_m * kSigma_m * Eigen::Matrix3d::Identity(), cam_from_antenna};
    }
    Reconstruction model = simulation_.ground_truth;
    Sim3 moved;
    moved.scale = 1.005;
    moved.translation = {0.5, -0.3, 0.1};
    TransformWorld(moved, &model);
    return EstimatePositionOffsets(simulation_.scene, priors, model, false);
  }

  Simulation simulation_;
  double speed_change_s_ = 0.0;
};

TEST_F(PositionOffsetsTest, AClockIsFoundWithinItsDeviation) {
  Drive(PathPreset::kCurve);
  for (const double ahead_s : {0.12, -0.25, 0.0}) {
    const PositionOffsets offsets = Estimate(ahead_s, Vector3d::Zero());
    ASSERT_TRUE(offsets.clock.has_value());
    const ClockOffset& clock = *offsets.clock;
    EXPECT_LT(std::abs(clock.offset_s - ahead_s), 4.0 * clock.sigma_s);
    EXPECT_LT(clock.sigma_s, 0.02);
    EXPECT_EQ(clock.is_significant, ahead_s != 0.0);
    EXPECT_EQ(DescribeOffsets(offsets).empty(), ahead_s == 0.0);
  }
}

TEST_F(PositionOffsetsTest, AnAntennaIsFoundWithinItsDeviation) {
  Drive(PathPreset::kCurve);
  // Sideways, as the body is the camera rotated by cam_from_antenna.
  const Vector3d right =
      ExpSO3({1.4, 0.3, -0.2}).conjugate() * Vector3d::UnitX();
  for (const double meters : {1.0, -1.0, 0.0}) {
    const PositionOffsets offsets = Estimate(0.0, meters * right);
    ASSERT_TRUE(offsets.lever.has_value());
    const LeverOffset& lever = *offsets.lever;
    EXPECT_EQ(lever.IsSignificant(), meters != 0.0);
    if (meters == 0.0) continue;
    const double length = lever.offset.norm();
    EXPECT_LT(std::abs(length - 1.0), 4.0 * lever.sigma);
    EXPECT_LT((lever.offset - meters * right).norm(), 8.0 * lever.sigma);
    EXPECT_LT(lever.sigma, 0.15);
    EXPECT_FALSE(offsets.are_alternatives);
  }
}

// At constant speed, an antenna ahead of the camera is a clock behind.
TEST_F(PositionOffsetsTest, AtConstantSpeedTheClockMayBeTheAntenna) {
  Drive(PathPreset::kCurve);
  const PositionOffsets offsets = Estimate(0.12, Vector3d::Zero());
  EXPECT_TRUE(offsets.are_alternatives);
  EXPECT_NEAR(offsets.lever->offset.norm(), 0.12 * 8.0, 0.2);
  EXPECT_THAT(DescribeOffsets(offsets),
              AllOf(HasSubstr("prior_clock_offset_s; or"),
                    HasSubstr("does not tell which")));
}

TEST_F(PositionOffsetsTest, VaryingSpeedTellsBoth) {
  Drive(PathPreset::kCurve, 0.6);
  const Vector3d forward =
      ExpSO3({1.4, 0.3, -0.2}).conjugate() * Vector3d::UnitZ();
  for (const double ahead_s : {0.12, 0.0}) {
    for (const double meters : {1.2, 0.0}) {
      const PositionOffsets offsets = Estimate(ahead_s, meters * forward);
      ASSERT_TRUE(offsets.clock && offsets.lever);
      EXPECT_FALSE(offsets.are_alternatives);
      EXPECT_EQ(offsets.clock->is_significant, ahead_s != 0.0);
      EXPECT_LT(std::abs(offsets.clock->offset_s - ahead_s),
                4.0 * offsets.clock->sigma_s);
      EXPECT_EQ(offsets.lever->IsSignificant(), meters != 0.0);
      EXPECT_LE(std::abs(offsets.lever->offset.norm() - meters),
                4.0 * offsets.lever->sigma);
    }
  }
}

// A similarity explains the offsets on a line and on a circle.
TEST_F(PositionOffsetsTest, ConstantMotionDoesNotTell) {
  for (const PathPreset path : {PathPreset::kStraight, PathPreset::kLoop}) {
    Drive(path);
    EXPECT_EQ(DescribeOffsets(Estimate(0.12, Vector3d(0.6, 0.6, 0.6))), "");
  }
}

TEST_F(PositionOffsetsTest, TheAntennaNeedsNoTimes) {
  Drive(PathPreset::kCurve);
  for (Image& image : simulation_.scene.images) image.timestamp_s.reset();
  const PositionOffsets offsets = Estimate(0.0, Vector3d(0.6, 0.6, 0.6));
  EXPECT_FALSE(offsets.clock.has_value());
  EXPECT_TRUE(offsets.lever && offsets.lever->IsSignificant());
}

}  // namespace
}  // namespace mgsfm
