// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/relative_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>

#include "bundle_adjustment/point_filters.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"

namespace mgsfm {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kFirst = 2, kSecond = 3;  // next to the seam

// Options without a robust loss, and with tight convergence.
BundleAdjustmentOptions LeastSquares() {
  BundleAdjustmentOptions options;
  options.loss_scale_px = 100.0;
  options.loss_sigma_factor = 1000.0;
  options.function_tolerance = 1e-9;
  return options;
}

// A drive of six frames. All but `num_crossing` points are observed on only one
// side of the seam.
Simulation DriveWithSeam(int num_crossing) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  options.num_frames = 6;
  options.num_points_per_frame = 40;
  options.extrinsics_are_known = true;
  Simulation simulation = Simulate(options);
  for (Point3D& point : simulation.ground_truth.points) {
    const auto is_beyond = [&](const Observation& o) {
      return simulation.scene.images[o.image_idx].frame_idx >= kSecond;
    };
    auto& track = point.track;
    const auto num_beyond =
        std::count_if(track.begin(), track.end(), is_beyond);
    if (num_beyond == 0 || num_beyond == static_cast<int>(track.size())) {
      continue;
    }
    if (num_crossing-- > 0) continue;
    track.erase(std::remove_if(track.begin(), track.end(), is_beyond),
                track.end());
  }
  auto& points = simulation.ground_truth.points;
  points.erase(
      std::remove_if(points.begin(), points.end(),
                     [](const Point3D& p) { return p.track.size() < 2; }),
      points.end());
  return simulation;
}

// The rotation and position of the second frame in the first, relative to those
// of another model.
Vector6d RelativeChange(const Reconstruction& model,
                        const Reconstruction& base) {
  const auto relative = [](const Reconstruction& m) {
    return *m.rig_from_world[kSecond] * m.rig_from_world[kFirst]->Inverse();
  };
  const Rigid3 pose = relative(model), base_pose = relative(base);
  Vector6d change;
  change << LogSO3(pose.rotation * base_pose.rotation.conjugate()),
      pose.Center() - base_pose.Center();
  return change;
}

// Direct application of the definition: projections as a function of all frames
// but the first and of all points, differentiated numerically, and the inverse
// of the dense normal matrix.
class DenseProblem {
 public:
  explicit DenseProblem(const Simulation& simulation)
      : scene_(simulation.scene), model_(simulation.ground_truth) {}

  // For noise of one pixel.
  PoseMatrix RelativeCovariance() const {
    const Eigen::MatrixXd jacobian = Differentiate(
        [&](const Reconstruction& moved) { return Pixels(moved); });
    const Eigen::MatrixXd of_pose =
        Differentiate([&](const Reconstruction& moved) -> Eigen::VectorXd {
          return RelativeChange(moved, model_);
        });
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    return of_pose * normal.ldlt().solve(of_pose.transpose());
  }

 private:
  Reconstruction Moved(const Eigen::VectorXd& parameters) const {
    Reconstruction moved = model_;
    Eigen::Index k = 0;
    for (size_t i = 1; i < moved.rig_from_world.size(); ++i, k += 6) {
      Rigid3& pose = *moved.rig_from_world[i];
      pose = Rigid3::FromRotationAndCenter(
          ExpSO3(parameters.segment<3>(k)) * pose.rotation,
          pose.Center() + parameters.segment<3>(k + 3));
    }
    for (Point3D& point : moved.points) {
      point.point_in_world += parameters.segment<3>(k);
      k += 3;
    }
    return moved;
  }

  Eigen::VectorXd Pixels(const Reconstruction& model) const {
    std::vector<double> pixels;
    for (const Point3D& point : model.points) {
      for (const Observation& o : point.track) {
        const Camera& camera =
            model.cameras[scene_.images[o.image_idx].camera_idx];
        const Eigen::Vector2d pixel =
            ProjectToPixel(
                camera.model, camera.params.data(),
                *model.CamFromWorld(scene_, o.image_idx) * point.point_in_world)
                .value();
        pixels.insert(pixels.end(), {pixel.x(), pixel.y()});
      }
    }
    return Eigen::Map<Eigen::VectorXd>(
        pixels.data(), static_cast<Eigen::Index>(pixels.size()));
  }

  template <class Function>
  Eigen::MatrixXd Differentiate(const Function& function) const {
    constexpr double kStep = 1e-6;
    const Eigen::Index num_parameters =
        6 * (static_cast<Eigen::Index>(model_.rig_from_world.size()) - 1) +
        3 * static_cast<Eigen::Index>(model_.points.size());
    Eigen::MatrixXd jacobian(function(model_).size(), num_parameters);
    for (Eigen::Index i = 0; i < num_parameters; ++i) {
      const Eigen::VectorXd step =
          kStep * Eigen::VectorXd::Unit(num_parameters, i);
      jacobian.col(i) =
          (function(Moved(step)) - function(Moved(-step))) / (2.0 * kStep);
    }
    return jacobian;
  }

  const Scene& scene_;
  const Reconstruction& model_;
};

TEST(RelativeCovariance, EqualsThatOfTheDenseProblem) {
  const Simulation simulation = DriveWithSeam(15);
  const auto covariances = ComputeRelativeCovariances(
      simulation.scene, simulation.ground_truth, LeastSquares(),
      {{kFirst, kSecond}}, Threads(2));
  ASSERT_EQ(covariances.size(), 1u);
  ASSERT_TRUE(covariances[0].has_value());
  // Keypoints without noise.
  const PoseMatrix expected = kMinKeypointSigmaPx * kMinKeypointSigmaPx *
                              DenseProblem(simulation).RelativeCovariance();
  for (const int first : {0, 3}) {
    const Eigen::Matrix3d block = expected.block<3, 3>(first, first);
    EXPECT_LT((covariances[0]->block<3, 3>(first, first) - block).norm(),
              1e-3 * block.norm());
  }
}

// For normal noise, the mean of d^T C^-1 d is the number of coordinates, 6. Its
// standard deviation over 40 draws is sqrt(12 / 40) = 0.55.
TEST(RelativeCovariance, PredictsTheErrorsOfRepeatedAdjustments) {
  Simulation simulation = DriveWithSeam(15);
  const BundleAdjustmentOptions options = LeastSquares();
  constexpr int kNumDraws = 40;
  Random random(7);
  double sum = 0.0;
  for (int i = 0; i < kNumDraws; ++i) {
    DrawNoise(0.5, &random, &simulation);
    const Reconstruction model =
        AdjustBundle(simulation.scene, simulation.ground_truth, options,
                     Threads(2))
            .estimate;
    const auto covariances = ComputeRelativeCovariances(
        simulation.scene, model, options, {{kFirst, kSecond}}, Threads(1));
    ASSERT_TRUE(covariances[0].has_value());
    const Vector6d error = RelativeChange(model, simulation.ground_truth);
    sum += error.dot(covariances[0]->ldlt().solve(error));
  }
  EXPECT_NEAR(sum / kNumDraws, 6.0, 2.0);
}

TEST(RelativeCovariance, IsUnknownIfNoPointCrosses) {
  const Simulation simulation = DriveWithSeam(0);
  const auto covariances = ComputeRelativeCovariances(
      simulation.scene, simulation.ground_truth, {},
      {{kFirst, kSecond}, {kFirst, kFirst - 1}}, Threads(1));
  ASSERT_EQ(covariances.size(), 2u);
  EXPECT_FALSE(covariances[0].has_value());
  EXPECT_TRUE(covariances[1].has_value());
}

TEST(RelativeCovariance, IsUnknownWithoutPoints) {
  Simulation simulation = DriveWithSeam(15);
  simulation.ground_truth.points.clear();
  EXPECT_FALSE(ComputeRelativeCovariances(simulation.scene,
                                          simulation.ground_truth, {},
                                          {{kFirst, kSecond}}, Threads(1))[0]);
}

TEST(UnbiasedNoiseSigmaPx, IsThatOfShortTracks) {
  SimulationOptions simulated =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  simulated.num_points_per_frame = 400;
  simulated.max_num_features_per_image = 1000;
  Simulation simulation = Simulate(simulated);
  constexpr double kSigmaPx = 0.5;
  Random random(3);
  DrawNoise(kSigmaPx, &random, &simulation);
  for (Point3D& point : simulation.ground_truth.points) {
    point.track.resize(std::min<size_t>(point.track.size(), 2));
  }
  FixedPoses fixed;
  fixed.frames.assign(simulation.scene.frames.size(), true);
  fixed.sensors.assign(simulation.scene.sensors.size(), true);
  const Reconstruction model =
      AdjustBundle(simulation.scene, simulation.ground_truth, LeastSquares(),
                   Threads(2), {}, fixed)
          .estimate;
  EXPECT_NEAR(UnbiasedNoiseSigmaPx(simulation.scene, model, 2), kSigmaPx,
              0.04 * kSigmaPx);
  EXPECT_LT(NoiseSigmaPx(simulation.scene, model, 2), 0.9 * kSigmaPx);
}

}  // namespace
}  // namespace mgsfm
