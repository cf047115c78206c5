// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/clock_offset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/random.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// A drive at 8 m/s with images at 10 Hz, and positions on a clock that is
// ahead.
class ClockOffsetTest : public testing::Test {
 protected:
  void Drive(PathPreset path) {
    SimulationOptions options;
    options.path = path;
    options.num_frames = 240;
    options.frame_spacing_m = 0.8;
    options.max_num_features_per_image = 20;
    options.num_points_per_frame = 20;
    simulation_ = Simulate(options);
    Scene& scene = simulation_.scene;
    for (Image& image : scene.images) {
      image.timestamp_s = 0.1 * image.frame_idx;
    }
  }
  Vector3d CenterAt(int sensor_idx, double time_s) const {
    std::vector<std::pair<double, Vector3d>> centers;
    for (size_t i = 0; i < simulation_.scene.images.size(); ++i) {
      const Image& image = simulation_.scene.images[i];
      if (image.sensor_idx != sensor_idx) continue;
      centers.emplace_back(
          0.1 * image.frame_idx,
          simulation_.ground_truth
              .CamFromWorld(simulation_.scene, static_cast<int>(i))
              ->Center());
    }
    std::sort(centers.begin(), centers.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    const double place = (time_s - centers[0].first) / 0.1;
    const double limit = static_cast<double>(centers.size()) - 1.001;
    const double inside = std::clamp(place, 0.0, limit);
    const auto k = static_cast<size_t>(inside);
    const double share = inside - static_cast<double>(k);
    return (1.0 - share) * centers[k].second + share * centers[k + 1].second;
  }
  // The estimate from the reference sensor, after a small similarity.
  std::optional<ClockOffset> Estimate(double ahead_s, double sigma_m) const {
    Random random(3);
    PositionPriors priors;
    priors.images.resize(simulation_.scene.images.size());
    for (size_t i = 0; i < priors.images.size(); ++i) {
      const Image& image = simulation_.scene.images[i];
      if (!simulation_.scene.IsReference(image.sensor_idx)) continue;
      Vector3d noise(random.Normal(), random.Normal(), random.Normal());
      if (random.Index(20) == 0) noise *= 60.0;  // 5 % outliers
      priors.images[i] = PositionMeasurement{
          CenterAt(image.sensor_idx, 0.1 * image.frame_idx - ahead_s) +
              sigma_m * noise,
          sigma_m * sigma_m * Eigen::Matrix3d::Identity()};
    }
    Reconstruction model = simulation_.ground_truth;
    Sim3 moved;
    moved.scale = 1.005;
    moved.translation = {0.5, -0.3, 0.1};
    TransformWorld(moved, &model);
    return EstimateClockOffset(simulation_.scene, priors, model, false);
  }

  Simulation simulation_;
};

TEST_F(ClockOffsetTest, AnOffsetIsFoundWithinItsDeviation) {
  Drive(PathPreset::kCurve);
  for (const double ahead_s : {0.12, -0.25, 0.0}) {
    const auto offset = Estimate(ahead_s, 0.3);
    ASSERT_TRUE(offset.has_value());
    EXPECT_LT(std::abs(offset->offset_s - ahead_s), 4.0 * offset->sigma_s);
    EXPECT_LT(offset->sigma_s, 0.02);
    EXPECT_EQ(offset->is_significant, ahead_s != 0.0);
    EXPECT_NEAR(offset->speed, 8.0, 0.2);
  }
}

// A similarity explains the offset on a line and on a circle.
TEST_F(ClockOffsetTest, ConstantMotionDoesNotTell) {
  for (const PathPreset path : {PathPreset::kStraight, PathPreset::kLoop}) {
    Drive(path);
    const auto offset = Estimate(0.12, 0.3);
    EXPECT_FALSE(offset && offset->is_significant);
  }
}

TEST_F(ClockOffsetTest, ImagesWithoutTimesDoNotTell) {
  Drive(PathPreset::kCurve);
  for (Image& image : simulation_.scene.images) image.timestamp_s.reset();
  EXPECT_FALSE(Estimate(0.12, 0.3).has_value());
}

}  // namespace
}  // namespace mgsfm
