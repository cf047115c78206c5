// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/view_graph_estimation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

SimulationOptions SmallSimulation(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = 5;
  options.num_matched_frames = 2;
  options.min_num_matches = 30;
  return options;
}

void RemoveGeometry(ViewGraph* view_graph) {
  for (ImagePair& pair : view_graph->pairs) {
    pair.relative_pose.reset();
    pair.F.reset();
    pair.E.reset();
    pair.H.reset();
  }
}

ViewGraphResult Estimate(const Simulation& simulation,
                         const ViewGraphOptions& options = {},
                         const Context& context = {}) {
  return EstimateViewGraph(simulation.scene,
                           ComputeBearings(simulation.scene, 1),
                           simulation.view_graph, options, context);
}

Rigid3 TrueRelativePose(const Simulation& simulation, const ImagePair& pair) {
  const Reconstruction& truth = simulation.ground_truth;
  return *truth.CamFromWorld(simulation.scene, pair.image_idx2) *
         truth.CamFromWorld(simulation.scene, pair.image_idx1)->Inverse();
}

// The largest errors over all pairs, and over those with a direction.
struct MaxErrors {
  double rotation_deg = 0.0;
  double direction_deg = 0.0;
  double position_m = 0.0;  // of camera 2, for the true baseline length
};

MaxErrors CompareWithTruth(const Simulation& simulation,
                           const ViewGraphResult& result) {
  MaxErrors errors;
  for (const ImagePair& pair : result.estimate.pairs) {
    const Rigid3 truth = TrueRelativePose(simulation, pair);
    const RelativePose& pose = *pair.relative_pose;
    errors.rotation_deg =
        std::max(errors.rotation_deg,
                 RadToDeg(AngleBetween(pose.cam2_from_cam1, truth.rotation)));
    if (!pose.translation_direction) continue;
    EXPECT_NEAR(pose.translation_direction->norm(), 1.0, 1e-12);
    errors.direction_deg = std::max(
        errors.direction_deg,
        RadToDeg(AngleBetween(*pose.translation_direction, truth.translation)));
    errors.position_m =
        std::max(errors.position_m,
                 (truth.translation.norm() * *pose.translation_direction -
                  truth.translation)
                     .norm());
  }
  return errors;
}

void ExpectExact(const Simulation& simulation, const ViewGraphResult& result) {
  EXPECT_EQ(result.estimate.pairs.size(), simulation.view_graph.pairs.size());
  const MaxErrors errors = CompareWithTruth(simulation, result);
  // Keypoints are single precision numbers of up to 1000 px.
  EXPECT_LE(errors.rotation_deg, 1e-3);
  EXPECT_LE(errors.direction_deg, 1e-2);
}

TEST(ViewGraphEstimationTest, RefinesInputPoses) {
  for (const RigPreset rig :
       {RigPreset::kStereo, RigPreset::kKitti360, RigPreset::kCube6}) {
    SimulationOptions options = SmallSimulation(rig);
    options.relative_rotation_noise_deg = 0.1;
    Simulation simulation = Simulate(options);
    for (ImagePair& pair : simulation.view_graph.pairs) pair.E.reset();
    const ViewGraphResult result = Estimate(simulation);
    ExpectExact(simulation, result);
    EXPECT_EQ(result.summary.num_pairs,
              static_cast<int>(simulation.view_graph.pairs.size()));
    EXPECT_GT(result.summary.num_from_row, result.summary.num_pairs / 2);
  }
}

TEST(ViewGraphEstimationTest, DecomposesEssentialMatrices) {
  Simulation simulation = Simulate(SmallSimulation(RigPreset::kCube6));
  for (ImagePair& pair : simulation.view_graph.pairs) {
    pair.relative_pose.reset();
  }
  const ViewGraphResult result = Estimate(simulation);
  ExpectExact(simulation, result);
  EXPECT_EQ(result.summary.num_decomposed, result.summary.num_pairs);
}

// All that image pairs have are the fundamental matrices of pinholes.
Simulation WithFundamentalMatrices() {
  Simulation simulation = Simulate(SmallSimulation(RigPreset::kStereo));
  const auto calibration = [&](int image_idx) {
    const Camera& camera =
        simulation.scene.cameras[simulation.scene.images[image_idx].camera_idx];
    EXPECT_EQ(camera.model, CameraModelId::kPinhole);
    Eigen::Matrix3d K;
    K << camera.params[0], 0, camera.params[2], 0, camera.params[1],
        camera.params[3], 0, 0, 1;
    return K;
  };
  for (ImagePair& pair : simulation.view_graph.pairs) {
    pair.F = calibration(pair.image_idx2).inverse().transpose() * *pair.E *
             calibration(pair.image_idx1).inverse();
    pair.relative_pose.reset();
    pair.E.reset();
  }
  return simulation;
}

TEST(ViewGraphEstimationTest, DecomposesFundamentalMatricesOfPinholes) {
  const Simulation simulation = WithFundamentalMatrices();
  const ViewGraphResult result = Estimate(simulation);
  ExpectExact(simulation, result);
  EXPECT_EQ(result.summary.num_decomposed, result.summary.num_pairs);
}

// Distortion moves the pixels by up to 20 px.
TEST(ViewGraphEstimationTest, EstimatedLensesStartAtFundamentalMatrices) {
  Simulation simulation = WithFundamentalMatrices();
  for (Camera& camera : simulation.scene.cameras) {
    camera.model = CameraModelId::kOpenCV;
    camera.params.insert(camera.params.end(), {-0.05, 0.0, 0.0, 0.0});
  }
  for (Image& image : simulation.scene.images) {
    const Camera& camera = simulation.scene.cameras[image.camera_idx];
    const std::vector<double>& p = camera.params;
    for (Eigen::Vector2f& keypoint : image.keypoints_px) {
      const auto pixel = ProjectToPixel(
          camera.model, p.data(),
          {(keypoint.x() - p[2]) / p[0], (keypoint.y() - p[3]) / p[1], 1.0});
      ASSERT_TRUE(pixel.has_value());
      keypoint = pixel->cast<float>();
    }
  }
  for (const bool is_estimated : {false, true}) {
    for (Camera& camera : simulation.scene.cameras) {
      camera.has_prior_focal_length = !is_estimated;
    }
    const ViewGraphResult result = Estimate(simulation);
    ExpectExact(simulation, result);
    const int num_started = result.summary.num_decomposed;
    if (is_estimated) {
      EXPECT_GT(num_started, result.summary.num_pairs / 2);
    } else {
      EXPECT_EQ(num_started, 0);
    }
  }
}

TEST(ViewGraphEstimationTest, EstimatesPairsWithoutGeometry) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kCube6}) {
    Simulation simulation = Simulate(SmallSimulation(rig));
    RemoveGeometry(&simulation.view_graph);
    for (ImagePair& pair : simulation.view_graph.pairs) {
      pair.config = TwoViewConfig::kUndefined;
    }
    const ViewGraphResult result = Estimate(simulation);
    ExpectExact(simulation, result);
    EXPECT_EQ(result.summary.num_reestimated, result.summary.num_pairs);
  }
}

TEST(ViewGraphEstimationTest, ReplacesWrongInputPoses) {
  Simulation simulation = Simulate(SmallSimulation(RigPreset::kStereo));
  Random random(3);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    pair.relative_pose->cam2_from_cam1 =
        ExpSO3({random.Normal(), random.Normal(), random.Normal()});
    pair.E = Eigen::Matrix3d::Zero();
    pair.H = Eigen::Matrix3d::Zero();
  }
  const ViewGraphResult result = Estimate(simulation);
  ExpectExact(simulation, result);
  EXPECT_EQ(result.summary.num_reestimated, result.summary.num_pairs);
}

TEST(ViewGraphEstimationTest, MismatchesAreDropped) {
  SimulationOptions options = SmallSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.3;
  Simulation clean = Simulate(options);
  RemoveGeometry(&clean.view_graph);
  const MaxErrors clean_errors = CompareWithTruth(clean, Estimate(clean));
  options.mismatch_ratio = 0.4;
  Simulation simulation = Simulate(options);
  RemoveGeometry(&simulation.view_graph);
  const ViewGraphResult result = Estimate(simulation);
  EXPECT_EQ(result.estimate.pairs.size(), simulation.view_graph.pairs.size());
  const MaxErrors errors = CompareWithTruth(simulation, result);
  EXPECT_LE(errors.rotation_deg, 3.0 * clean_errors.rotation_deg);
  // Wrong matches that are inliers by chance rotate short baselines most, so
  // check the position of the other camera.
  EXPECT_LE(errors.position_m, 0.08);
  EXPECT_LE(clean_errors.position_m, 0.05);
  const double inlier_ratio = static_cast<double>(result.summary.num_inliers) /
                              static_cast<double>(result.summary.num_matches);
  EXPECT_NEAR(inlier_ratio, 0.6, 0.04);
}

TEST(ViewGraphEstimationTest, PairsOfOneInstantAndPlaceHaveNoDirection) {
  for (const double noise_px : {0.0, 0.5}) {
    SimulationOptions options = SmallSimulation(RigPreset::kStereo);
    options.path = PathPreset::kStanding;
    options.pixel_noise_px = noise_px;
    Simulation simulation = Simulate(options);
    RemoveGeometry(&simulation.view_graph);
    const ViewGraphResult result = Estimate(simulation);
    EXPECT_EQ(result.estimate.pairs.size(), simulation.view_graph.pairs.size());
    for (const ImagePair& pair : result.estimate.pairs) {
      const bool has_baseline =
          TrueRelativePose(simulation, pair).translation.norm() > 1e-9;
      EXPECT_EQ(pair.relative_pose->translation_direction.has_value(),
                has_baseline);
    }
    EXPECT_GT(result.summary.num_low_parallax, 0);
    EXPECT_LE(CompareWithTruth(simulation, result).rotation_deg,
              noise_px > 0.0 ? 0.3 : 1e-3);
  }
}

// Two pinhole images of a plane, with the homography that it induces.
Simulation MakePlanarPair() {
  Simulation simulation;
  const double f = 500.0;
  simulation.scene.cameras = {{CameraId(1),
                               CameraModelId::kSimplePinhole,
                               1000,
                               800,
                               {f, 500.0, 400.0},
                               true}};
  simulation.scene.images.resize(2, Image{ImageId(1), "", 0, 0, 0, {}});
  const Rigid3 cam2_from_cam1{ExpSO3({0.02, -0.05, 0.03}), {0.6, 0.1, 0.2}};
  const Eigen::Vector3d plane =
      Eigen::Vector3d(0.3, -0.4, 1.0).normalized() / 4.0;  // plane . x1 = 1
  Random random(7);
  ImagePair pair;
  for (uint32_t i = 0; i < 200; ++i) {
    const Eigen::Vector3d ray(random.Uniform(-0.8, 0.8),
                              random.Uniform(-0.6, 0.6), 1.0);
    const Eigen::Vector3d point = ray / plane.dot(ray);
    int image_idx = 0;
    for (const Eigen::Vector3d& x : {point, cam2_from_cam1 * point}) {
      simulation.scene.images[image_idx++].keypoints_px.emplace_back(
          f * x.x() / x.z() + 500.0, f * x.y() / x.z() + 400.0);
    }
    pair.matches.push_back({i, i});
  }
  Eigen::Matrix3d K;
  K << f, 0, 500, 0, f, 400, 0, 0, 1;
  pair.image_idx2 = 1;
  pair.config = TwoViewConfig::kPlanar;
  pair.H = -0.3 * K *
           (cam2_from_cam1.rotation.toRotationMatrix() +
            cam2_from_cam1.translation * plane.transpose()) *
           K.inverse();
  simulation.view_graph.pairs = {pair};
  return simulation;
}

TEST(ViewGraphEstimationTest, DecomposesHomographiesOfPlanes) {
  const Simulation simulation = MakePlanarPair();
  const ViewGraphResult result = Estimate(simulation);
  EXPECT_EQ(result.summary.num_decomposed, 1);
  EXPECT_EQ(result.summary.num_inliers, 200u);
  ASSERT_EQ(result.estimate.pairs.size(), 1u);
  EXPECT_TRUE(result.estimate.pairs[0].relative_pose->translation_direction);
}

TEST(ViewGraphEstimationTest, DropsUnusablePairs) {
  SimulationOptions options = SmallSimulation(RigPreset::kStereo);
  options.wrong_pair_ratio = 0.3;
  Simulation simulation = Simulate(options);
  auto& pairs = simulation.view_graph.pairs;
  pairs[0].config = TwoViewConfig::kWatermark;
  pairs[1].config = TwoViewConfig::kDegenerate;
  pairs[2].matches.resize(10);
  ViewGraphOptions view_graph_options;
  view_graph_options.min_inlier_ratio = 0.6;
  const ViewGraphResult result = Estimate(simulation, view_graph_options);
  EXPECT_EQ(result.summary.num_dropped_config, 2);
  EXPECT_GE(result.summary.num_dropped_few_inliers, 1);
  EXPECT_EQ(result.summary.num_pairs,
            static_cast<int>(result.estimate.pairs.size()) +
                result.summary.num_dropped_config +
                result.summary.num_dropped_few_inliers);
  EXPECT_LE(CompareWithTruth(simulation, result).rotation_deg, 1e-3);
}

// Matches on a line do not determine a plane, so its second pose may agree with
// none of them.
TEST(ViewGraphEstimationTest, PairsOfFewOrCollinearMatchesAreNoError) {
  Random random(3);
  ViewGraphOptions options;
  options.min_num_inliers = 8;
  int num_kept = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    Simulation simulation = MakePlanarPair();
    ImagePair& pair = simulation.view_graph.pairs[0];
    pair.H.reset();
    pair.matches.resize(12);
    const Eigen::Vector3d direction =
        Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal())
            .normalized();
    pair.relative_pose = {Eigen::Quaterniond::Identity(), direction};
    const double noise_px = trial % 5 == 0 ? 0.0 : 2.0;
    const double parallax = std::pow(10.0, random.Uniform(-4.0, 0.0));
    for (size_t i = 0; i < pair.matches.size(); ++i) {
      auto& pixel1 = simulation.scene.images[0].keypoints_px[i];
      if (trial % 2 == 0) pixel1.y() = 400.0f;
      const Eigen::Vector3d point =
          (trial % 3 == 0 ? 1.0 : random.Uniform(0.5, 2.0)) *
              Eigen::Vector3d((pixel1.x() - 500) / 500,
                              (pixel1.y() - 400) / 500, 1.0) +
          parallax * direction;
      simulation.scene.images[1].keypoints_px[i] =
          (500.0 * point.head<2>() / point.z() +
           Eigen::Vector2d(500.0 + noise_px * random.Normal(),
                           400.0 + noise_px * random.Normal()))
              .cast<float>();
    }
    num_kept +=
        static_cast<int>(Estimate(simulation, options).estimate.pairs.size());
  }
  EXPECT_GT(num_kept, 100);
}

TEST(ViewGraphEstimationTest, KeypointsWithoutRayAreNoInliers) {
  const Simulation simulation = Simulate(SmallSimulation(RigPreset::kMono));
  Bearings bearings = ComputeBearings(simulation.scene, 1);
  for (size_t i = 0; i < bearings.images[0].size(); i += 2) {
    bearings.images[0].is_valid[i] = false;
  }
  const ViewGraphResult result = EstimateViewGraph(
      simulation.scene, bearings, simulation.view_graph, {}, {});
  ExpectExact(simulation, result);
  for (const ImagePair& pair : result.estimate.pairs) {
    if (pair.image_idx1 != 0) continue;
    for (const Match& match : pair.matches) {
      EXPECT_EQ(match.keypoint_idx1 % 2, 1u);
    }
  }
}

TEST(ViewGraphEstimationTest, ThreadsDoNotChangeTheResult) {
  SimulationOptions options = SmallSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 1.0;
  options.mismatch_ratio = 0.3;
  Simulation simulation = Simulate(options);
  RemoveGeometry(&simulation.view_graph);
  Context three_threads;
  three_threads.num_threads = 3;
  const ViewGraphResult result1 = Estimate(simulation);
  const ViewGraphResult result3 = Estimate(simulation, {}, three_threads);
  ASSERT_EQ(result1.estimate.pairs.size(), result3.estimate.pairs.size());
  for (size_t i = 0; i < result1.estimate.pairs.size(); ++i) {
    const ImagePair& pair1 = result1.estimate.pairs[i];
    const ImagePair& pair3 = result3.estimate.pairs[i];
    EXPECT_EQ(pair1.relative_pose->cam2_from_cam1.coeffs(),
              pair3.relative_pose->cam2_from_cam1.coeffs());
    EXPECT_EQ(pair1.relative_pose->translation_direction,
              pair3.relative_pose->translation_direction);
    EXPECT_EQ(pair1.matches.size(), pair3.matches.size());
  }
}

TEST(ViewGraphEstimationTest, EmptyViewGraphGivesEmptyResult) {
  Simulation simulation = Simulate(SmallSimulation(RigPreset::kMono));
  simulation.view_graph.pairs.clear();
  EXPECT_TRUE(Estimate(simulation).estimate.pairs.empty());
}

}  // namespace
}  // namespace mgsfm
