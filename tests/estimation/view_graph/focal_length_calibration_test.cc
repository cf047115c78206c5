// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/focal_length_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "mgsfm/simulator/simulation.h"
#include "support/threads.h"
#include "view_graph/focal_pair.h"

namespace mgsfm {
namespace {

Simulation Drive(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 24;
  options.frame_spacing_m = 1.5;
  options.pixel_noise_px = 0.4;
  options.mismatch_ratio = 0.05;
  return Simulate(options);
}

// The scene without priors and with focal lengths wrong by a factor.
Scene Distrusted(const Simulation& simulation, double factor) {
  Scene scene = simulation.scene;
  for (Camera& camera : scene.cameras) {
    camera = internal::WithFocalFactor(camera, std::log(factor));
    camera.has_prior_focal_length = false;
  }
  return scene;
}

double FocalLength(const Camera& camera) {
  const CameraModelInfo& info = InfoOf(camera.model);
  return camera.params[info.focal_length_idxs.front()];
}

FocalLengthOptions FewPairs() {
  FocalLengthOptions options;
  options.max_num_pairs = 60;
  return options;
}

class WrongFocalLengthTest
    : public testing::TestWithParam<std::pair<RigPreset, double>> {};

TEST_P(WrongFocalLengthTest, IsCorrected) {
  const auto [rig, factor] = GetParam();
  const Simulation simulation = Drive(rig, PathPreset::kLoop);
  FocalLengthOptions options;
  options.max_num_pairs = 60;
  const FocalLengthResult result =
      CalibrateFocalLengths(Distrusted(simulation, factor),
                            simulation.view_graph, options, Threads(2));
  ASSERT_EQ(result.estimates.size(), simulation.scene.cameras.size());
  for (const FocalLengthEstimate& estimate : result.estimates) {
    const double truth =
        FocalLength(simulation.scene.cameras[estimate.camera_idx]);
    EXPECT_NEAR(estimate.prior_px, factor * truth, 1e-9 * truth);
    ASSERT_TRUE(estimate.estimated_px.has_value()) << estimate.message;
    EXPECT_NEAR(*estimate.estimated_px, truth, 0.03 * truth);
    EXPECT_NEAR(FocalLength(result.cameras[estimate.camera_idx]),
                *estimate.estimated_px, 1e-9 * truth);
    EXPECT_LT(std::abs(*estimate.estimated_px - truth),
              2.0 * estimate.sigma.value() * truth);
  }
}

INSTANTIATE_TEST_SUITE_P(RigsAndFactors, WrongFocalLengthTest,
                         testing::Values(std::pair(RigPreset::kStereo, 0.6),
                                         std::pair(RigPreset::kStereo, 1.2),
                                         std::pair(RigPreset::kStereo, 2.0)));

// Cameras that translate along their axis only, or whose axes stay in a plane.
class UnobservableFocalLengthTest : public testing::TestWithParam<PathPreset> {
};

TEST_P(UnobservableFocalLengthTest, IsReported) {
  const Simulation simulation = Drive(RigPreset::kMono, GetParam());
  const Scene scene = Distrusted(simulation, 1.2);
  const FocalLengthResult result = CalibrateFocalLengths(
      scene, simulation.view_graph, FewPairs(), Threads(2));
  ASSERT_EQ(result.estimates.size(), 1u);
  EXPECT_FALSE(result.estimates[0].estimated_px.has_value());
  EXPECT_NE(result.estimates[0].message.find("rotate too little"),
            std::string::npos);
  // The start is the guess, or closer to the truth.
  const auto error = [&](const Camera& camera) {
    return std::abs(
        std::log(camera.params[0] / simulation.scene.cameras[0].params[0]));
  };
  EXPECT_LE(error(result.cameras[0]), error(scene.cameras[0]));
}

INSTANTIATE_TEST_SUITE_P(Paths, UnobservableFocalLengthTest,
                         testing::Values(PathPreset::kStraight,
                                         PathPreset::kLoop));

TEST(FocalLengthTest, PriorsAreKept) {
  const Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kLoop);
  Scene scene = Distrusted(simulation, 1.1);
  scene.cameras[0].has_prior_focal_length = true;
  const FocalLengthResult result = CalibrateFocalLengths(
      scene, simulation.view_graph, FewPairs(), Threads(2));
  ASSERT_EQ(result.estimates.size(), 1u);
  EXPECT_EQ(result.estimates[0].camera_idx, 1);
  EXPECT_EQ(result.cameras[0].params, scene.cameras[0].params);
}

TEST(FocalLengthTest, ThreadsDoNotChangeTheResult) {
  const Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kLoop);
  const Scene scene = Distrusted(simulation, 1.2);
  FocalLengthOptions options;
  options.max_num_pairs = 40;
  const auto calibrate = [&](int num_threads) {
    return CalibrateFocalLengths(scene, simulation.view_graph, options,
                                 Threads(num_threads))
        .cameras;
  };
  const std::vector<Camera> one = calibrate(1), three = calibrate(3);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].params, three[i].params);
  }
}

TEST(FocalLengthTest, GeometryOfUncalibratedCamerasIsDropped) {
  Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kLoop);
  simulation.scene.cameras[0].has_prior_focal_length = false;
  const ViewGraph kept =
      DropUncalibratedGeometry(simulation.scene, simulation.view_graph);
  for (const ImagePair& pair : kept.pairs) {
    const auto& images = simulation.scene.images;
    const bool is_calibrated = images[pair.image_idx1].camera_idx != 0 &&
                               images[pair.image_idx2].camera_idx != 0;
    EXPECT_EQ(pair.relative_pose.has_value(), is_calibrated);
    EXPECT_EQ(pair.E.has_value(), is_calibrated);
  }
}

TEST(FocalLengthTest, WithoutPairsNothingChanges) {
  const Simulation simulation = Drive(RigPreset::kMono, PathPreset::kLoop);
  const FocalLengthResult result = CalibrateFocalLengths(
      Distrusted(simulation, 1.2), ViewGraph(), {}, Threads(1));
  ASSERT_EQ(result.estimates.size(), 1u);
  EXPECT_FALSE(result.estimates[0].estimated_px.has_value());
}

}  // namespace
}  // namespace mgsfm
