// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "bundle_adjustment/residual_field.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;
using testing::Not;

// Focal lengths are `factor` times too long and are not priors.
Simulation WithoutPriors(RigPreset rig, PathPreset path, double factor,
                         int num_points_per_frame = 80) {
  SimulationOptions options = SmallScene(rig, path);
  options.num_frames = 20;
  options.num_points_per_frame = num_points_per_frame;
  options.max_num_features_per_image = 2 * num_points_per_frame;
  options.pixel_noise_px = 0.3;
  Simulation simulation = Simulate(options);
  for (auto* cameras :
       {&simulation.scene.cameras, &simulation.ground_truth.cameras}) {
    for (Camera& camera : *cameras) {
      camera.params[0] *= factor;
      camera.params[1] *= factor;
      camera.has_prior_focal_length = false;
    }
  }
  return simulation;
}

Reconstruction Adjusted(const Simulation& simulation,
                        const BundleAdjustmentOptions& options) {
  return AdjustBundle(simulation.scene, simulation.ground_truth, options,
                      Threads(2))
      .estimate;
}

TEST(FocalLengthCheckTest, RotationsDetermineAFocalLength) {
  const Simulation simulation =
      WithoutPriors(RigPreset::kStereo, PathPreset::kLoop, 1.02, 400);
  const BundleAdjustmentOptions options;
  const auto checks = CheckFocalLengths(
      simulation.scene, Adjusted(simulation, options), options, Threads(2));
  ASSERT_EQ(checks.size(), simulation.scene.cameras.size());
  for (const FocalLengthCheck& check : checks) {
    EXPECT_EQ(check.message, "");
    ASSERT_TRUE(check.relative_sigma.has_value());
    EXPECT_LT(*check.relative_sigma, 0.01);
    EXPECT_GT(*check.relative_sigma, 0.0);
    // Within five standard deviations of the truth.
    const double truth = check.prior_px / 1.02;
    EXPECT_LT(std::abs(check.estimated_px / truth - 1.0),
              5.0 * *check.relative_sigma);
  }
}

// Each lens has waves of 1 px that its model lacks.
TEST(FocalLengthCheckTest, SigmasContainErrorsOfTheLens) {
  const BundleAdjustmentOptions options;
  Simulation simulation =
      WithoutPriors(RigPreset::kStereo, PathPreset::kLoop, 1.0, 400);
  const auto check = [&](std::vector<Overdispersion>* factors) {
    const Reconstruction model = Adjusted(simulation, options);
    *factors =
        OverdispersionOfCameras(simulation.scene, model, options.loss_scale_px);
    return CheckFocalLengths(simulation.scene, model, options, Threads(2));
  };
  std::vector<Overdispersion> independent, dependent;
  const auto before = check(&independent);
  for (Image& image : simulation.scene.images) {
    const double side_px = simulation.scene.cameras[image.camera_idx].width_px;
    for (Eigen::Vector2f& pixel : image.keypoints_px) {
      pixel += Eigen::Vector2f(std::sin(6.0 * pixel.y() / side_px + 1.0),
                               std::cos(6.0 * pixel.x() / side_px));
    }
  }
  const auto after = check(&dependent);
  ASSERT_EQ(before.size(), after.size());
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_GE(independent[i].of_residuals, 1.0);
    EXPECT_LT(independent[i].of_residuals, 2.0);
    EXPECT_GT(dependent[i].of_residuals, 10.0);
    EXPECT_GT(*after[i].relative_sigma, 3.0 * *before[i].relative_sigma);
    // Within three standard deviations of the truth.
    EXPECT_LT(std::abs(after[i].estimated_px / after[i].prior_px - 1.0),
              3.0 * *after[i].relative_sigma);
  }
}

// More observations average out noise, but not what the lens model lacks.
TEST(FocalLengthCheckTest, ErrorsOfTheLensDoNotAverageOut) {
  const BundleAdjustmentOptions options;
  const auto sigmas = [&](int num_points) {
    const Simulation simulation =
        WithoutPriors(RigPreset::kStereo, PathPreset::kLoop, 1.0, num_points);
    const Reconstruction model = Adjusted(simulation, options);
    auto checks =
        CheckFocalLengths(simulation.scene, model, options, Threads(2));
    const double of_noise = checks.at(0).relative_sigma.value();
    AddLensErrors(simulation.scene, model, options, Threads(2), {}, &checks);
    return std::pair(of_noise, checks[0].relative_sigma.value());
  };
  const auto [noise_of_few, total_of_few] = sigmas(100);
  const auto [noise_of_many, total_of_many] = sigmas(800);
  EXPECT_GT(total_of_few, noise_of_few);
  EXPECT_LT(noise_of_many, 0.5 * noise_of_few);
  EXPECT_GT(total_of_many, 0.5 * total_of_few);
}

// For one camera that drives straight, depth and focal length are ambiguous.
TEST(FocalLengthCheckTest, StraightDrivesDoNotDetermineIt) {
  const Simulation simulation =
      WithoutPriors(RigPreset::kMono, PathPreset::kStraight, 1.0);
  const BundleAdjustmentOptions options;
  const auto checks = CheckFocalLengths(
      simulation.scene, Adjusted(simulation, options), options, Threads(2));
  ASSERT_EQ(checks.size(), 1u);
  ASSERT_TRUE(checks[0].relative_sigma.has_value());
  EXPECT_GT(*checks[0].relative_sigma, 0.01);
  // The term of the initial value bounds it.
  EXPECT_LT(*checks[0].relative_sigma, 1.01 * options.focal_length_start_sigma);
  EXPECT_THAT(checks[0].message, HasSubstr("does not determine it"));
}

TEST(FocalLengthCheckTest, ConstantOnesAreNotChecked) {
  Simulation simulation =
      WithoutPriors(RigPreset::kStereo, PathPreset::kLoop, 1.0);
  BundleAdjustmentOptions options;
  options.refine_focal_length = RefineMode::kNo;
  EXPECT_TRUE(CheckFocalLengths(simulation.scene, simulation.ground_truth,
                                options, Threads(1))
                  .empty());
}

TEST(FocalLengthCheckTest, ImplausibleOnesAreReported) {
  Simulation simulation =
      WithoutPriors(RigPreset::kStereo, PathPreset::kLoop, 1.0);
  const BundleAdjustmentOptions options;
  Reconstruction model = simulation.ground_truth;
  const auto message = [&] {
    return CheckFocalLengths(simulation.scene, model, options, Threads(1))[0]
        .message;
  };
  std::vector<double>& params = model.cameras[0].params;
  const std::vector<double> initial = params;
  params[0] = params[1] = 20.0 * model.cameras[0].width_px;
  EXPECT_THAT(message(), HasSubstr("larger image side"));
  params[0] = params[1] = 2.5 * initial[0];
  EXPECT_THAT(message(), HasSubstr("by a factor of 2.5"));
  // A guess says nothing about the estimate.
  Camera& guess = simulation.scene.cameras[0];
  guess.params[0] = guess.params[1] =
      1.2 * std::max(guess.width_px, guess.height_px);
  params[0] = params[1] = 0.45 * guess.params[0];
  EXPECT_THAT(message(), Not(HasSubstr("factor")));
}

// An unobservable focal length stays at its initial value, and the term has no
// effect on constant focal lengths.
TEST(FocalLengthCheckTest, UnobservableOneStaysAtItsInitialValue) {
  const Simulation simulation =
      WithoutPriors(RigPreset::kMono, PathPreset::kStraight, 1.0);
  BundleAdjustmentOptions options;
  options.focal_length_start_sigma = 1e-6;
  const double truth = simulation.ground_truth.cameras[0].params[0];
  EXPECT_NEAR(Adjusted(simulation, options).cameras[0].params[0], truth,
              1e-3 * truth);
  options.refine_focal_length = RefineMode::kNo;
  options.refine_extra_params = RefineMode::kNo;
  const Reconstruction a = Adjusted(simulation, options);
  options.focal_length_start_sigma = 0.2;
  const Reconstruction b = Adjusted(simulation, options);
  for (size_t f = 0; f < a.rig_from_world.size(); ++f) {
    EXPECT_EQ(a.rig_from_world[f]->translation,
              b.rig_from_world[f]->translation);
  }
}

}  // namespace
}  // namespace mgsfm
