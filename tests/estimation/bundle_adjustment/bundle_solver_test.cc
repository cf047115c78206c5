// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "estimation/bundle_adjustment/ceres_reference.h"
#include "rig_solver/rig_solver.h"

namespace mgsfm {
namespace {

BundleAdjustmentOptions RefineEverything() {
  BundleAdjustmentOptions options;
  options.refine_focal_length = RefineMode::kYes;
  options.refine_extra_params = RefineMode::kYes;
  return options;
}

RigSolverOptions TightTolerances() {
  RigSolverOptions options;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  return options;
}

// The largest difference of image poses. Both must have the same gauge.
double MaxPoseDifference(const BundleProblem& problem, const BundleState& a,
                         const BundleState& b) {
  double max_difference = 0.0;
  for (const BundleProblem::Image& image : problem.images) {
    const auto pose = [&image](const BundleState& state) {
      const FramePose& frame = state.frames[image.frame];
      return state.sensors[image.sensor] *
             Rigid3::FromRotationAndCenter(frame.rig_from_world, frame.center);
    };
    const Rigid3 pa = pose(a), pb = pose(b);
    max_difference = std::max(
        {max_difference, (pa.Center() - pb.Center()).norm(),
         (pa.rotation.toRotationMatrix() - pb.rotation.toRotationMatrix())
             .norm()});
  }
  return max_difference;
}

void AddPixelNoise(double sigma_px, double outlier_ratio, Random* random,
                   BundleProblem* problem) {
  for (auto& observation : problem->observations) {
    const bool is_outlier = random->Uniform() < outlier_ratio;
    const double size = is_outlier ? 50.0 * sigma_px : sigma_px;
    observation.pixel +=
        (size * Eigen::Vector2d(random->Normal(), random->Normal()))
            .cast<float>();
  }
}

class BundleSolverTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {
 protected:
  void SetUp() override {
    const auto [rig, path] = GetParam();
    simulation_ = Simulate(SmallScene(rig, path));
  }

  Simulation simulation_;
};

TEST_P(BundleSolverTest, ExactDataGiveTheTruth) {
  BuiltProblem built = ExactProblem(simulation_, BundleAdjustmentOptions());
  for (const bool minimizes_points : {false, true}) {
    BundleState state = built.state;
    Random random(1);
    Perturb(built.problem, 0.02, &random, &state);
    RigSolverOptions options = TightTolerances();
    options.minimizes_points = minimizes_points;
    const SolveSummary summary =
        SolveRigProblem(built.problem, options, Threads(2), &state);
    EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
    EXPECT_LT(summary.final_cost, RoundingCost(built.problem));
    EXPECT_LT(MaxPoseDifference(built.problem, state, built.state), 1e-5);
  }
}

TEST_P(BundleSolverTest, OptimumIsThatOfCeres) {
  // With noise, a point with a small angle can have its optimum at infinity.
  PointFilterOptions with_parallax;
  with_parallax.min_angle_rad = DegToRad(3.0);
  FilterPoints(simulation_.scene, with_parallax, 2, &simulation_.ground_truth);
  // Every third point: numeric derivatives are slow.
  std::vector<Point3D>& points = simulation_.ground_truth.points;
  for (size_t i = 0; 3 * i < points.size(); ++i) {
    if (i > 0) points[i] = points[3 * i];
  }
  points.resize((points.size() + 2) / 3);
  BuiltProblem built = ExactProblem(simulation_, BundleAdjustmentOptions());
  Random random(2);
  AddPixelNoise(1.0, 0.0, &random, &built.problem);
  BundleState expected = built.state;
  const double expected_cost = SolveWithCeres(built.problem, &expected);
  ASSERT_GT(expected_cost, 10.0);  // there is noise to fit
  for (const bool minimizes_points : {false, true}) {
    BundleState state = built.state;
    RigSolverOptions options = TightTolerances();
    options.minimizes_points = minimizes_points;
    const SolveSummary summary =
        SolveRigProblem(built.problem, options, Threads(2), &state);
    EXPECT_TRUE(summary.IsUsable());
    EXPECT_NEAR(summary.final_cost, expected_cost, 1e-8 * expected_cost);
    EXPECT_LT(MaxPoseDifference(built.problem, state, expected), 1e-4);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
  }
}

TEST_P(BundleSolverTest, ThreadsDoNotChangeABit) {
  BuiltProblem built = ExactProblem(simulation_, RefineEverything());
  Random random(3);
  AddPixelNoise(0.5, 0.02, &random, &built.problem);
  BundleState one = built.state, three = built.state;
  RigSolverOptions options;
  options.max_num_iterations = 10;
  options.minimizes_points = true;
  const SolveSummary summary_one =
      SolveRigProblem(built.problem, options, Threads(1), &one);
  const SolveSummary summary_three =
      SolveRigProblem(built.problem, options, Threads(3), &three);
  EXPECT_EQ(summary_one.final_cost, summary_three.final_cost);
  EXPECT_EQ(summary_one.num_iterations, summary_three.num_iterations);
  EXPECT_EQ(MaxPoseDifference(built.problem, one, three), 0.0);
  EXPECT_EQ(one.cameras, three.cameras);
  EXPECT_EQ(one.points, three.points);
}

INSTANTIATE_TEST_SUITE_P(
    Rigs, BundleSolverTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kCurve, PathPreset::kLoop)));

TEST(BundleSolverEdgeTest, InvisibleObservationIsAFailure) {
  BuiltProblem built =
      ExactProblem(Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve)),
                   BundleAdjustmentOptions());
  BundleState state = built.state;
  state.points[0] = Eigen::Vector3d::Constant(std::nan(""));
  const BundleState before = state;
  const SolveSummary summary =
      SolveRigProblem(built.problem, RigSolverOptions(), Threads(1), &state);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(MaxPoseDifference(built.problem, state, before), 0.0);
}

TEST(BundleSolverEdgeTest, EmptyProblemConverges) {
  BundleProblem problem;
  BundleState state;
  const SolveSummary summary =
      SolveRigProblem(problem, RigSolverOptions(), Threads(1), &state);
  EXPECT_EQ(summary.termination, Termination::kConverged);
}

TEST(BundleSolverEdgeTest, ConstantPointsOrFramesDoNotMove) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  for (const bool points_are_constant : {true, false}) {
    BundleAdjustmentOptions options;
    options.refine_points = !points_are_constant;
    options.refine_rig_from_world = points_are_constant;
    options.refine_sensor_from_rig = RefineMode::kNo;
    BuiltProblem built = ExactProblem(simulation, options);
    BundleState state = built.state;
    Random random(4);
    Perturb(built.problem, 0.01, &random, &state);
    if (points_are_constant) state.points = built.state.points;
    const SolveSummary summary =
        SolveRigProblem(built.problem, TightTolerances(), Threads(2), &state);
    EXPECT_LT(summary.final_cost, RoundingCost(built.problem));
    EXPECT_LT(MaxPoseDifference(built.problem, state, built.state), 1e-5);
    for (size_t p = 0; p < state.points.size(); ++p) {
      EXPECT_LT((state.points[p] - built.state.points[p]).norm(), 1e-3);
    }
  }
}

}  // namespace
}  // namespace mgsfm
