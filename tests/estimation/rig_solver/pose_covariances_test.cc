// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/pose_covariances.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "estimation/rig_solver/dense_equations.h"
#include "estimation/rig_solver/rig_fixtures.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"

namespace mgsfm {
namespace {

// The inverse of the full dense equations, including points.
void ExpectBlocksOfDenseInverse(const RigSceneOptions& options,
                                bool has_priors) {
  RigScene<PixelObservation> scene = MakePixelScene(options);
  if (has_priors) AddPosePriorsNearby(0.05, &scene);
  const RigEquations<PixelResidual> equations(
      scene.problem, {ReducedSolver::kDirect}, Threads(1));
  const RigStructure& s = equations.structure();
  const DenseEquations dense =
      MakeDenseEquations(scene.problem, s, scene.truth);
  const Eigen::MatrixXd inverse = dense.Damped(0.0).inverse();
  const auto covariances =
      ComputePoseCovariances(scene.problem, scene.truth, Threads(2));
  ASSERT_TRUE(covariances.has_value());
  const auto expect_block = [&](int block, const PoseMask& mask,
                                const std::optional<PoseMatrix>& covariance) {
    ASSERT_TRUE(covariance.has_value());
    PoseMatrix expected = PoseMatrix::Zero();
    if (block >= 0) {
      const int n = s.pose_size;
      expected.bottomRightCorner(n, n) =
          inverse.block(s.block_first[block], s.block_first[block], n, n);
    }
    expected = mask.asDiagonal() * expected * mask.asDiagonal();
    EXPECT_LT((*covariance - expected).norm(), 1e-4 * expected.norm() + 1e-15);
  };
  for (size_t i = 0; i < scene.truth.frames.size(); ++i) {
    expect_block(s.frame_block[i], scene.problem.frame_masks[i],
                 covariances->frames[i]);
  }
  for (size_t i = 0; i < scene.truth.sensors.size(); ++i) {
    expect_block(s.sensor_block[i], scene.problem.sensor_masks[i],
                 covariances->sensors[i]);
  }
}

TEST(PoseCovariancesTest, AreBlocksOfTheDenseInverse) {
  RigSceneOptions options;
  options.cameras = {PerspectiveTestCameras()[0], PerspectiveTestCameras()[0]};
  options.num_points = 40;
  options.noise_px = 0.5;
  for (const bool has_priors : {false, true}) {
    ExpectBlocksOfDenseInverse(options, has_priors);
  }
  options.params_are_free = true;
  ExpectBlocksOfDenseInverse(options, false);
  options.rotations_are_free = false;
  ExpectBlocksOfDenseInverse(options, false);
}

TEST(PoseCovariancesTest, GroupsOfSensorsAreBlocksOfTheDenseInverse) {
  RigSceneOptions options;
  options.cameras = {PerspectiveTestCameras()[0], PerspectiveTestCameras()[0],
                     PerspectiveTestCameras()[0]};
  options.num_points = 40;
  const RigScene<PixelObservation> scene = MakePixelScene(options);
  const RigEquations<PixelResidual> equations(
      scene.problem, {ReducedSolver::kDirect}, Threads(1));
  const RigStructure& structure = equations.structure();
  const Eigen::MatrixXd inverse =
      MakeDenseEquations(scene.problem, structure, scene.truth)
          .Damped(0.0)
          .inverse();
  const std::vector<std::vector<int>> groups = {{2, 1}, {0}};
  const auto covariances =
      ComputeSensorCovariances(scene.problem, scene.truth, groups, Threads(1));
  ASSERT_TRUE(covariances.has_value());
  ASSERT_EQ(covariances->size(), 2u);
  Eigen::MatrixXd expected(12, 12);
  for (int a = 0; a < 2; ++a) {
    for (int b = 0; b < 2; ++b) {
      const int row = structure.sensor_block[groups[0][a]];
      const int column = structure.sensor_block[groups[0][b]];
      ASSERT_TRUE(row >= 0 && column >= 0);
      expected.block<6, 6>(6 * a, 6 * b) =
          scene.problem.sensor_masks[groups[0][a]].asDiagonal() *
          inverse.block(structure.block_first[row],
                        structure.block_first[column], 6, 6) *
          scene.problem.sensor_masks[groups[0][b]].asDiagonal();
    }
  }
  EXPECT_LT(((*covariances)[0] - expected).norm(), 1e-4 * expected.norm());
  // The reference sensor is constant.
  EXPECT_TRUE((*covariances)[1].isZero(0.0));
}

TEST(PoseCovariancesTest, GroupsOfFramesAreBlocksOfTheDenseInverse) {
  RigSceneOptions options;
  options.cameras = {PerspectiveTestCameras()[0], PerspectiveTestCameras()[0]};
  options.num_points = 40;
  RigScene<PixelObservation> scene = MakePixelScene(options);
  scene.problem.frame_masks[4][5] = 0.0;
  const RigEquations<PixelResidual> equations(
      scene.problem, {ReducedSolver::kDirect}, Threads(1));
  const RigStructure& structure = equations.structure();
  const Eigen::MatrixXd inverse =
      MakeDenseEquations(scene.problem, structure, scene.truth)
          .Damped(0.0)
          .inverse();
  const std::vector<int> group = {4, 2};
  const auto covariances =
      ComputeFrameCovariances(scene.problem, scene.truth, {group}, Threads(1));
  ASSERT_TRUE(covariances.has_value());
  Eigen::MatrixXd expected(12, 12);
  for (int a = 0; a < 2; ++a) {
    for (int b = 0; b < 2; ++b) {
      const int row = structure.frame_block[group[a]];
      const int column = structure.frame_block[group[b]];
      ASSERT_TRUE(row >= 0 && column >= 0);
      expected.block<6, 6>(6 * a, 6 * b) =
          scene.problem.frame_masks[group[a]].asDiagonal() *
          inverse.block(structure.block_first[row],
                        structure.block_first[column], 6, 6) *
          scene.problem.frame_masks[group[b]].asDiagonal();
    }
  }
  EXPECT_LT((covariances->front() - expected).norm(), 1e-4 * expected.norm());
  EXPECT_TRUE(covariances->front().row(5).isZero(0.0));
}

TEST(PoseCovariancesTest, UnobservableDirectionsHaveHugeVariances) {
  RigSceneOptions options;
  options.cameras = {PerspectiveTestCameras()[0]};
  RigScene<PixelObservation> scene = MakePixelScene(options);
  const auto gauge_is_held =
      ComputePoseCovariances(scene.problem, scene.truth, Threads(1));
  ASSERT_TRUE(gauge_is_held.has_value());
  scene.problem.frame_masks.assign(scene.problem.frame_masks.size(),
                                   PoseMask::Ones());
  const auto gauge_is_free =
      ComputePoseCovariances(scene.problem, scene.truth, Threads(1));
  if (!gauge_is_free) return;  // rounding errors can make it singular
  EXPECT_GT(gauge_is_free->frames[3]->trace(),
            1e4 * gauge_is_held->frames[3]->trace());
}

}  // namespace
}  // namespace mgsfm
