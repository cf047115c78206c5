// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "scene/observations.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

SimulationOptions NoisyScene(RigPreset rig, PathPreset path) {
  SimulationOptions options = SmallScene(rig, path);
  options.pixel_noise_px = 0.5;
  return options;
}

double SensorDistance(const Reconstruction& a, const Reconstruction& b,
                      int sensor_idx) {
  return (a.sensor_from_rig[sensor_idx]->translation -
          b.sensor_from_rig[sensor_idx]->translation)
      .norm();
}

void ExpectSame(const Reconstruction& a, const Reconstruction& b) {
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t i = 0; i < a.points.size(); ++i) {
    ASSERT_EQ(a.points[i].point_in_world, b.points[i].point_in_world);
    ASSERT_EQ(a.points[i].track, b.points[i].track);
    ASSERT_EQ(a.points[i].error_px, b.points[i].error_px);
  }
  for (size_t i = 0; i < a.rig_from_world.size(); ++i) {
    ASSERT_EQ(a.rig_from_world[i].has_value(), b.rig_from_world[i].has_value());
    if (!a.rig_from_world[i]) continue;
    ASSERT_EQ(a.rig_from_world[i]->translation,
              b.rig_from_world[i]->translation);
    ASSERT_EQ(a.rig_from_world[i]->rotation.coeffs(),
              b.rig_from_world[i]->rotation.coeffs());
  }
}

class BundleAdjustmentTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {
 protected:
  static RigPreset rig() { return std::get<0>(GetParam()); }
  static PathPreset path() { return std::get<1>(GetParam()); }
};

// Keypoints are single precision, hence 3e-5 px of noise.
TEST_P(BundleAdjustmentTest, PerturbedTruthIsRecovered) {
  const Simulation simulation = Simulate(SmallScene(rig(), path()));
  const Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.02, 11);
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-12;
  const BundleResult result =
      AdjustBundle(simulation.scene, initial, options, Threads(2));
  ASSERT_EQ(result.summary.solves.size(), 1u);
  EXPECT_EQ(result.summary.solves[0].termination, Termination::kConverged);
  const ModelDifference difference =
      CompareModels(simulation.scene, result.estimate, simulation.ground_truth);
  EXPECT_LT(difference.max_position, 1e-4);
  EXPECT_LT(difference.max_rotation_deg, 1e-4);
  for (const Point3D& point : result.estimate.points) {
    ASSERT_TRUE(point.error_px.has_value());
    EXPECT_GE(*point.error_px, 0.0);
    EXPECT_LT(*point.error_px, 1e-3);
  }
}

TEST_P(BundleAdjustmentTest, KnownExtrinsicsKeepMetricScale) {
  SimulationOptions simulated = SmallScene(rig(), path());
  simulated.extrinsics_are_known = true;
  const Simulation simulation = Simulate(simulated);
  Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.005, 12);
  const Reconstruction& truth = simulation.ground_truth;
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-14;
  options.max_num_iterations = 200;
  const BundleResult result =
      AdjustBundle(simulation.scene, initial, options, Threads(2));
  for (size_t i = 0; i < simulation.scene.sensors.size(); ++i) {
    EXPECT_EQ(SensorDistance(result.estimate, truth, static_cast<int>(i)), 0.0);
  }
  if (simulation.scene.sensors.size() < 2) return;
  const ModelDifference difference =
      CompareModels(simulation.scene, result.estimate, truth);
  EXPECT_NEAR(difference.scale, 1.0, 1e-3);
}

// Inaccurate prior extrinsics: refinement brings them nearer to the truth, and
// the model stays metric.
TEST(AdjustBundleTest, PriorExtrinsicsAreRefined) {
  SimulationOptions simulated =
      NoisyScene(RigPreset::kStereo, PathPreset::kCurve);
  simulated.extrinsics_are_known = true;
  Simulation simulation = Simulate(simulated);
  std::optional<Rigid3>& prior = simulation.scene.sensors[1].sensor_from_rig;
  const Rigid3 truth = *prior;
  prior->rotation = ExpSO3({0.0, DegToRad(0.3), 0.0}) * prior->rotation;
  prior->translation *= 1.004;
  Reconstruction initial = simulation.ground_truth;
  initial.sensor_from_rig[1] = prior;
  BundleAdjustmentOptions options;
  options.refine_sensor_from_rig = RefineMode::kYes;
  options.sensor_from_rig_prior_sigma_deg = 0.3;
  for (const auto backend : {SolverBackend::kNative, SolverBackend::kCeres}) {
    options.backend = backend;
    const Reconstruction refined =
        AdjustBundle(simulation.scene, initial, options, Threads(2)).estimate;
    const Rigid3& estimate = *refined.sensor_from_rig[1];
    EXPECT_LT(AngleBetween(estimate.rotation, truth.rotation),
              0.5 * AngleBetween(prior->rotation, truth.rotation));
    EXPECT_NEAR(estimate.translation.norm(), prior->translation.norm(),
                0.005 * truth.translation.norm());
    EXPECT_NEAR(
        CompareModels(simulation.scene, refined, simulation.ground_truth).scale,
        1.0, 0.01);
  }
}

// Prior extrinsics with one common center keep it.
TEST(AdjustBundleTest, CommonCenterOfPriorExtrinsicsIsKept) {
  SimulationOptions simulated =
      NoisyScene(RigPreset::kCube6, PathPreset::kCurve);
  simulated.extrinsics_are_known = true;
  Simulation simulation = Simulate(simulated);
  Reconstruction initial = simulation.ground_truth;
  for (size_t i = 0; i < simulation.scene.sensors.size(); ++i) {
    simulation.scene.sensors[i].sensor_from_rig->translation.setZero();
    initial.sensor_from_rig[i] = simulation.scene.sensors[i].sensor_from_rig;
  }
  BundleAdjustmentOptions options;
  options.refine_sensor_from_rig = RefineMode::kYes;
  const BundleResult result =
      AdjustBundle(simulation.scene, initial, options, Threads(2));
  EXPECT_TRUE(result.summary.solves[0].IsUsable());
  for (const auto& pose : result.estimate.sensor_from_rig) {
    EXPECT_TRUE(pose->translation.isZero(0.0));
  }
}

TEST_P(BundleAdjustmentTest, WholeStageRecoversTheTruthFromRoughPoses) {
  SimulationOptions simulated = NoisyScene(rig(), path());
  const Simulation simulation = Simulate(simulated);
  const Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.05, 13);
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      initial, BundleAdjustmentOptions(), Threads(2));
  for (const SolveSummary& solve : result.summary.solves) {
    EXPECT_TRUE(solve.IsUsable()) << solve.message;
    EXPECT_LE(solve.final_cost, solve.initial_cost);
  }
  EXPECT_EQ(result.summary.rounds.size(), 5u);
  EXPECT_NEAR(result.summary.rounds.back().sigma_px, 0.4, 0.15);
  EXPECT_GT(NumObservations(result.estimate),
            NumObservations(simulation.ground_truth) * 7 / 10);
  const ModelDifference difference =
      CompareModels(simulation.scene, result.estimate, simulation.ground_truth);
  EXPECT_EQ(difference.num_images,
            static_cast<int>(simulation.scene.images.size()));
  EXPECT_LT(difference.max_position, 0.1);
  EXPECT_LT(difference.max_rotation_deg, 0.6);
}

TEST_P(BundleAdjustmentTest, ThreadsDoNotChangeABit) {
  const Simulation simulation = Simulate(NoisyScene(rig(), path()));
  const Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.02, 14);
  const ObservationGroups groups = GroupTracks(simulation.ground_truth, 2);
  const auto refine = [&](int num_threads) {
    return RefineReconstruction(simulation.scene, FixedCandidates(groups),
                                initial, BundleAdjustmentOptions(),
                                Threads(num_threads))
        .estimate;
  };
  const Reconstruction one = refine(1);
  ExpectSame(one, refine(2));
  ExpectSame(one, refine(3));
}

INSTANTIATE_TEST_SUITE_P(
    Rigs, BundleAdjustmentTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kCurve)));

TEST(RefineReconstructionTest, ProgressCountsTheIterationsOfAllSolves) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  std::vector<Progress> reports;
  Context context = Threads(2);
  context.progress = [&](const Progress& progress) {
    reports.push_back(progress);
  };
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      Perturbed(simulation.scene, simulation.ground_truth, 0.02, 21),
      BundleAdjustmentOptions(), context);
  size_t num_iterations = 0;
  for (const SolveSummary& solve : result.summary.solves) {
    num_iterations += static_cast<size_t>(solve.num_iterations);
  }
  ASSERT_EQ(reports.size(), num_iterations);
  for (size_t i = 0; i < reports.size(); ++i) {
    EXPECT_EQ(reports[i].stage, "bundle adjustment");
    EXPECT_EQ(reports[i].done, i);
    EXPECT_GT(reports[i].total, i);
  }
}

// Without noise, the robust estimates of scale are zero.
TEST(RefineReconstructionTest, ExactDataKeepAllWithParallax) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      Perturbed(simulation.scene, simulation.ground_truth, 0.02, 21),
      BundleAdjustmentOptions(), Threads(2));
  for (const SolveSummary& solve : result.summary.solves) {
    EXPECT_TRUE(solve.IsUsable()) << solve.message;
  }
  const ModelDifference difference =
      CompareModels(simulation.scene, result.estimate, simulation.ground_truth);
  EXPECT_LT(difference.max_position, 1e-3);
  EXPECT_LT(difference.max_rotation_deg, 1e-3);
}

TEST(RefineReconstructionTest, OutliersAreRemoved) {
  SimulationOptions simulated =
      NoisyScene(RigPreset::kStereo, PathPreset::kCurve);
  Simulation simulation = Simulate(simulated);
  Random random(15);
  std::vector<Observation> wrong;
  for (const Point3D& point : simulation.ground_truth.points) {
    if (point.track.size() < 4) continue;
    for (const Observation& o : point.track) {
      if (random.Uniform() > 0.05) continue;
      wrong.push_back(o);
      simulation.scene.images[o.image_idx].keypoints_px[o.keypoint_idx] +=
          Eigen::Vector2f(0.0f, 40.0f);
    }
  }
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      Perturbed(simulation.scene, simulation.ground_truth, 0.02, 16),
      BundleAdjustmentOptions(), Threads(2));
  int num_wrong = 0;
  for (const Point3D& point : result.estimate.points) {
    ASSERT_TRUE(point.error_px.has_value());
    EXPECT_LE(*point.error_px, 4.0);
    for (const Observation& o : point.track) {
      num_wrong += std::find(wrong.begin(), wrong.end(), o) != wrong.end();
    }
  }
  EXPECT_LE(num_wrong, static_cast<int>(wrong.size()) / 50);
  EXPECT_LT(
      CompareModels(simulation.scene, result.estimate, simulation.ground_truth)
          .max_position,
      0.1);
}

// Wrong matches that agree with the present poses: points right in front of a
// camera, where a pixel is a fraction of a millimeter.
void AddMatchesNearby(const Reconstruction& model, double relative_distance,
                      Scene* scene, ObservationGroups* groups) {
  const std::vector<ImageView> views = MakeImageViews(*scene, model);
  const double distance = relative_distance * MedianDistance(*scene, model, 1);
  Random random(17);
  for (int i = 0; i + 1 < static_cast<int>(views.size()); ++i) {
    for (int k = 0; k < 20; ++k) {
      const Eigen::Vector3d ray(random.Uniform() - 0.5,
                                0.5 * (random.Uniform() - 0.5), 1.0);
      const Eigen::Vector3d point =
          views[i + 1].center +
          distance * views[i + 1].cam_from_world.transpose() * ray.normalized();
      for (const int image_idx : {i, i + 1}) {
        std::vector<Eigen::Vector2f>& keypoints =
            scene->images[image_idx].keypoints_px;
        groups->observations.push_back(
            {image_idx, static_cast<int>(keypoints.size())});
        keypoints.push_back(
            views[image_idx].Project(point).value().cast<float>());
      }
      groups->FinishGroup();
    }
  }
}

// The difference of refinements from two initial models with such matches.
double DifferenceOfTwoStarts(double min_two_view_relative_distance) {
  const Simulation simulation =
      Simulate(NoisyScene(RigPreset::kMono, PathPreset::kCurve));
  BundleAdjustmentOptions options;
  options.min_two_view_relative_distance = min_two_view_relative_distance;
  std::vector<Reconstruction> ends;
  for (const uint64_t seed : {18, 19}) {
    const Reconstruction initial =
        Perturbed(simulation.scene, simulation.ground_truth, 0.01, seed);
    Scene scene = simulation.scene;
    ObservationGroups groups = GroupTracks(simulation.ground_truth);
    AddMatchesNearby(initial, 0.05, &scene, &groups);
    ends.push_back(RefineReconstruction(scene, FixedCandidates(groups), initial,
                                        options, Threads(2))
                       .estimate);
  }
  return CompareModels(simulation.scene, ends[0], ends[1]).max_position;
}

TEST(RefineReconstructionTest, MatchesNextToACameraDoNotFixFrames) {
  const double by_default = DifferenceOfTwoStarts(
      BundleAdjustmentOptions().min_two_view_relative_distance);
  EXPECT_LT(100.0 * by_default, DifferenceOfTwoStarts(0.0))
      << by_default << " " << DifferenceOfTwoStarts(0.0);
}

TEST(RefineReconstructionTest, FramesAndSensorsWithoutObservations) {
  Simulation simulation =
      Simulate(SmallScene(RigPreset::kKitti360, PathPreset::kCurve));
  // Removes all keypoints of frame 4 and of the reference sensor.
  const int lost_sensor = simulation.scene.rigs[0].ref_sensor_idx;
  for (Point3D& point : simulation.ground_truth.points) {
    auto& track = point.track;
    track.erase(std::remove_if(track.begin(), track.end(),
                               [&](const Observation& o) {
                                 const Image& image =
                                     simulation.scene.images[o.image_idx];
                                 return image.frame_idx == 4 ||
                                        image.sensor_idx == lost_sensor;
                               }),
                track.end());
  }
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      simulation.ground_truth, BundleAdjustmentOptions(), Threads(2));
  ASSERT_EQ(result.summary.dropped_frames.size(), 1u);
  EXPECT_EQ(result.summary.dropped_frames[0].frame_idx, 4);
  EXPECT_FALSE(result.estimate.rig_from_world[4].has_value());
  EXPECT_EQ(result.summary.sensor_idxs_without_observations,
            std::vector<int>{lost_sensor});
  EXPECT_EQ(
      SensorDistance(result.estimate, simulation.ground_truth, lost_sensor),
      0.0);
}

// Points of one frame only, in place of the observations that it shares.
void Disconnect(const Scene& scene, int frame_idx, Reconstruction* model) {
  const size_t num_points = model->points.size();
  for (size_t i = 0; i < num_points; ++i) {
    auto& track = model->points[i].track;
    const auto own =
        std::stable_partition(track.begin(), track.end(), [&](auto& o) {
          return scene.images[o.image_idx].frame_idx != frame_idx;
        });
    Point3D separate = model->points[i];
    separate.track.assign(own, track.end());
    track.erase(own, track.end());
    if (separate.track.size() >= 2) model->points.push_back(separate);
  }
}

BundleResult Refine(const Simulation& simulation, const FixedPoses& fixed) {
  return RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(simulation.ground_truth)),
      simulation.ground_truth, BundleAdjustmentOptions(), Threads(2),
      {{}, fixed});
}

// The cameras of a frame see points together, which say nothing of its place.
TEST(RefineReconstructionTest, FramesThatShareNoPointAreDropped) {
  Simulation simulation =
      Simulate(SmallScene(RigPreset::kKitti360, PathPreset::kCurve));
  const Scene& scene = simulation.scene;
  Disconnect(scene, 4, &simulation.ground_truth);
  const BundleResult result = Refine(simulation, {});
  ASSERT_EQ(result.summary.dropped_frames.size(), 1u);
  EXPECT_EQ(result.summary.dropped_frames[0].frame_idx, 4);
  EXPECT_EQ(result.summary.dropped_frames[0].reason,
            "no point connects its images to other frames");
  EXPECT_FALSE(result.estimate.rig_from_world[4].has_value());
  for (const Point3D& point : result.estimate.points) {
    for (const Observation& o : point.track) {
      EXPECT_NE(scene.images[o.image_idx].frame_idx, 4);
    }
  }
  FixedPoses fixed;
  fixed.frames.assign(scene.frames.size(), false);
  fixed.frames[4] = true;
  EXPECT_TRUE(Refine(simulation, fixed).summary.dropped_frames.empty());
}

TEST(RefineReconstructionTest, FramesStayIfNoneAreConnected) {
  Simulation simulation =
      Simulate(SmallScene(RigPreset::kKitti360, PathPreset::kCurve));
  for (size_t i = 0; i < simulation.scene.frames.size(); ++i) {
    Disconnect(simulation.scene, static_cast<int>(i), &simulation.ground_truth);
  }
  EXPECT_TRUE(Refine(simulation, {}).summary.dropped_frames.empty());
}

TEST(RefineReconstructionTest, NothingToRefine) {
  Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  Reconstruction initial = simulation.ground_truth;
  initial.points.clear();
  const BundleResult result =
      RefineReconstruction(simulation.scene, FixedCandidates({}), initial,
                           BundleAdjustmentOptions(), Threads(1));
  EXPECT_EQ(result.summary.dropped_frames.size(),
            simulation.scene.frames.size());
  EXPECT_TRUE(result.estimate.points.empty());
}

TEST(RefineReconstructionTest, PointsWithoutGroupsAreKept) {
  const Simulation simulation =
      Simulate(NoisyScene(RigPreset::kStereo, PathPreset::kCurve));
  const BundleResult result = RefineReconstruction(
      simulation.scene, FixedCandidates({}), simulation.ground_truth,
      BundleAdjustmentOptions(), Threads(1));
  EXPECT_GT(result.estimate.points.size(),
            simulation.ground_truth.points.size() / 2);
}

TEST(AdjustBundleTest, FailureReturnsTheInitialModel) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  Reconstruction initial = simulation.ground_truth;
  initial.rig_from_world[2]->translation.x() = 1e300;
  const BundleResult result = AdjustBundle(
      simulation.scene, initial, BundleAdjustmentOptions(), Threads(1));
  for (size_t i = 0; i < initial.rig_from_world.size(); ++i) {
    if (i == 2) continue;
    EXPECT_LT((result.estimate.rig_from_world[i]->translation -
               initial.rig_from_world[i]->translation)
                  .norm(),
              1e-3);
  }
}

TEST(AdjustBundleTest, OptimumIsBelowTheCostOfTheTruth) {
  const Simulation simulation =
      Simulate(NoisyScene(RigPreset::kMono, PathPreset::kLoop));
  const BundleResult result =
      AdjustBundle(simulation.scene, simulation.ground_truth,
                   BundleAdjustmentOptions(), Threads(2));
  const SolveSummary& summary = result.summary.solves.at(0);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_GT(summary.final_cost, 0.2 * summary.initial_cost);
}

TEST(AdjustBundleTest, UnknownFocalLengthIsEstimated) {
  Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kLoop));
  Reconstruction initial = simulation.ground_truth;
  const double truth = initial.cameras[0].params[0];
  for (auto* cameras : {&simulation.scene.cameras, &initial.cameras}) {
    for (Camera& camera : *cameras) {
      camera.params[0] *= 1.02;
      camera.params[1] *= 1.02;
      camera.has_prior_focal_length = false;
    }
  }
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-9;
  const auto focal = [&] {
    return AdjustBundle(simulation.scene, initial, options, Threads(2))
        .estimate.cameras[0]
        .params[0];
  };
  EXPECT_NEAR(focal(), truth, 1e-3 * truth);
  options.refine_focal_length = RefineMode::kNo;
  EXPECT_EQ(focal(), 1.02 * truth);
  // A prior focal length is constant, or stays within its standard deviation.
  for (Camera& camera : simulation.scene.cameras) {
    camera.has_prior_focal_length = true;
  }
  options.refine_focal_length = RefineMode::kAuto;
  EXPECT_EQ(focal(), 1.02 * truth);
  options.refine_focal_length = RefineMode::kYes;
  options.focal_length_prior_sigma = 1e-8;
  EXPECT_NEAR(focal(), 1.02 * truth, 1e-4);
}

// One of ten measured directions is an outlier.
TEST(AdjustBundleTest, GravityLevelsTheModel) {
  const Simulation simulation =
      Simulate(NoisyScene(RigPreset::kStereo, PathPreset::kCurve));
  Reconstruction tilted = simulation.ground_truth;
  TransformWorld({1.0, ExpSO3({DegToRad(3.0), 0.0, DegToRad(-2.0)}),
                  Eigen::Vector3d::Zero()},
                 &tilted);
  BundlePriors priors;
  priors.gravity.emplace();
  priors.gravity->sigma_rad = DegToRad(0.5);
  Random random(2);
  for (const Rigid3& pose : simulation.cam_from_world) {
    const bool is_wrong = random.Uniform() < 0.1;
    const Eigen::Vector3d in_world =
        is_wrong ? RandomVector(1.0, &random).normalized()
                 : ExpSO3(RandomVector(DegToRad(0.5), &random)) *
                       Eigen::Vector3d::UnitY();
    priors.gravity->priors.images.push_back(pose.rotation * in_world);
  }
  const Reconstruction level =
      AdjustBundle(simulation.scene, tilted, BundleAdjustmentOptions(),
                   Threads(2), priors)
          .estimate;
  for (size_t f = 0; f < level.rig_from_world.size(); ++f) {
    const Eigen::Vector3d down =
        level.rig_from_world[f]->rotation.conjugate() *
        (simulation.ground_truth.rig_from_world[f]->rotation *
         Eigen::Vector3d::UnitY());
    EXPECT_LT(RadToDeg(AngleBetween(down, Eigen::Vector3d(0.0, 1.0, 0.0))),
              0.4);
  }
  const ModelDifference difference =
      CompareModels(simulation.scene, level, simulation.ground_truth);
  EXPECT_LT(difference.max_rotation_deg, 0.3);
}

TEST(AdjustBundleTest, OrderOfPointsDoesNotMatter) {
  const Simulation simulation =
      Simulate(NoisyScene(RigPreset::kStereo, PathPreset::kCurve));
  Reconstruction reversed = simulation.ground_truth;
  std::reverse(reversed.points.begin(), reversed.points.end());
  for (Point3D& point : reversed.points) {
    std::reverse(point.track.begin(), point.track.end());
  }
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-13;
  const BundleResult a = AdjustBundle(simulation.scene, simulation.ground_truth,
                                      options, Threads(1));
  const BundleResult b =
      AdjustBundle(simulation.scene, reversed, options, Threads(1));
  const ModelDifference difference =
      CompareModels(simulation.scene, a.estimate, b.estimate);
  EXPECT_LT(difference.max_position, 1e-6);
  EXPECT_LT(difference.max_rotation_deg, 1e-6);
}

}  // namespace
}  // namespace mgsfm
