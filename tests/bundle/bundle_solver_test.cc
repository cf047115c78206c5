// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/bundle_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "bundle/bundle_fixtures.h"
#include "bundle/ceres_reference.h"
#include "bundle/normal_equations.h"
#include "bundle/point_filters.h"

namespace mgsfm {
namespace {

BundleAdjustmentOptions RefineEverything() {
  BundleAdjustmentOptions options;
  options.refine_focal_length = RefineMode::kYes;
  options.refine_extra_params = RefineMode::kYes;
  return options;
}

BundleSolverOptions TightTolerances() {
  BundleSolverOptions options;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  return options;
}

// The largest difference in pose of any image. The gauge must be the same.
double MaxPoseDifference(const BundleProblem& problem, const BundleState& a,
                         const BundleState& b) {
  double max_difference = 0.0;
  const auto poses_a = ComputeImagePoses(problem, a);
  const auto poses_b = ComputeImagePoses(problem, b);
  for (size_t i = 0; i < poses_a.size(); ++i) {
    const ImagePose& pa = poses_a[i];
    const ImagePose& pb = poses_b[i];
    const auto center = [](const ImagePose& p) -> Eigen::Vector3d {
      return p.center - p.cam_from_world.transpose() * p.translation;
    };
    max_difference = std::max({max_difference, (center(pa) - center(pb)).norm(),
                               (pa.cam_from_world - pb.cam_from_world).norm()});
  }
  return max_difference;
}

void AddPixelNoise(double sigma_px, double outlier_ratio, Random* random,
                   BundleProblem* problem) {
  for (auto& observation : problem->observations) {
    const bool is_outlier = random->Uniform() < outlier_ratio;
    const double size = is_outlier ? 50.0 * sigma_px : sigma_px;
    observation.pixel +=
        size * Eigen::Vector2d(random->Normal(), random->Normal());
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
  BundleState state = built.state;
  Random random(1);
  Perturb(built.problem, 0.02, &random, &state);
  const SolveSummary summary =
      SolveBundle(built.problem, TightTolerances(), 2, &state);
  EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-12);
  EXPECT_LT(MaxPoseDifference(built.problem, state, built.state), 1e-8);
}

TEST_P(BundleSolverTest, OptimumIsThatOfCeres) {
  // Noise may put the optimum of a point with little parallax at infinity.
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
  BundleState state = built.state;
  BundleState expected = built.state;
  const SolveSummary summary =
      SolveBundle(built.problem, TightTolerances(), 2, &state);
  EXPECT_TRUE(summary.IsUsable());
  const double expected_cost = SolveWithCeres(built.problem, &expected);
  ASSERT_GT(expected_cost, 10.0);  // there is noise to fit
  EXPECT_NEAR(summary.final_cost, expected_cost, 1e-8 * expected_cost);
  EXPECT_LT(MaxPoseDifference(built.problem, state, expected), 1e-4);
  EXPECT_LT(summary.final_cost, BundleCost(built.problem, built.state, 1));
}

TEST_P(BundleSolverTest, ThreadsDoNotChangeABit) {
  BuiltProblem built = ExactProblem(simulation_, RefineEverything());
  Random random(3);
  AddPixelNoise(0.5, 0.02, &random, &built.problem);
  BundleState one = built.state, three = built.state;
  BundleSolverOptions options;
  options.max_num_iterations = 10;
  const SolveSummary summary_one = SolveBundle(built.problem, options, 1, &one);
  const SolveSummary summary_three =
      SolveBundle(built.problem, options, 3, &three);
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

// The step of the reduced equations against the full ones, solved densely.
TEST(NormalEquationsTest, StepSolvesTheFullSystem) {
  SimulationOptions small = SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  small.num_frames = 4;
  small.num_points_per_frame = 20;
  small.max_num_features_per_image = 30;
  BuiltProblem built = ExactProblem(Simulate(small), RefineEverything());
  Random random(5);
  Perturb(built.problem, 0.01, &random, &built.state);
  const BundleProblem& problem = built.problem;
  const BundleStructure structure(problem);
  const auto poses = ComputeImagePoses(problem, built.state);
  const int num_z = structure.num_unknowns;
  const int size = num_z + 3 * static_cast<int>(problem.num_points());
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
  double cost = 0.0;
  for (size_t o = 0; o < problem.observations.size(); ++o) {
    const auto& observation = problem.observations[o];
    const auto& image = problem.images[observation.image];
    const int point = structure.observation_point[o];
    ObservationTerms terms;
    ASSERT_TRUE(EvaluateTerms(poses[observation.image],
                              built.state.points[point], observation.pixel,
                              true, &terms));
    const ColumnLayout& layout = structure.layouts[observation.image];
    ObservationColumns columns(2, layout.num_columns);
    FillColumns(problem, image, poses[observation.image], terms, layout,
                &columns);
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(2, size);
    const auto place = [&](int block, int offset) {
      if (block < 0) return;
      const auto [width, first] = structure.blocks[block];
      J.middleCols(first, width) = columns.middleCols(offset, width);
    };
    place(structure.frame_block[image.frame], layout.frame);
    place(structure.sensor_block[image.sensor], layout.sensor);
    place(structure.camera_block[image.camera], layout.camera);
    J.middleCols<3>(num_z + 3 * point) = terms.point;
    const double r = terms.residual.norm();
    const double weight = r > 1.0 ? 1.0 / r : 1.0;
    H += weight * J.transpose() * J;
    g += weight * J.transpose() * terms.residual;
    cost += r > 1.0 ? r - 0.5 : 0.5 * r * r;
  }
  for (const auto& prior : problem.priors) {
    const auto& free = problem.cameras[prior.camera].free_params;
    const int i =
        structure.blocks[structure.camera_block[prior.camera]].first +
        static_cast<int>(std::find(free.begin(), free.end(), prior.param) -
                         free.begin());
    const double difference =
        built.state.cameras[prior.camera][prior.param] - prior.value;
    H(i, i) += 1.0 / (prior.sigma * prior.sigma);
    g[i] += difference / (prior.sigma * prior.sigma);
    cost += 0.5 * std::pow(difference / prior.sigma, 2);
  }
  EXPECT_NEAR(cost, BundleCost(problem, built.state, 2), 1e-9 * cost);

  constexpr double kLambda = 1e-3;
  Eigen::MatrixXd damped = H;
  for (int i = 0; i < size; ++i) {
    damped(i, i) =
        H(i, i) > 0.0 ? H(i, i) + kLambda * std::max(H(i, i), 1e-6) : 1.0;
  }
  const Eigen::VectorXd expected = damped.ldlt().solve(-g);

  NormalEquations equations(problem, structure, 2);
  ASSERT_TRUE(equations.Linearize(built.state));
  BundleStep step;
  ASSERT_TRUE(equations.Solve(kLambda, &step));
  EXPECT_LT((step.blocks - expected.head(num_z)).norm(),
            1e-7 * expected.norm());
  for (size_t p = 0; p < problem.num_points(); ++p) {
    EXPECT_LT((step.points[p] - expected.segment<3>(num_z + 3 * p)).norm(),
              1e-7 * expected.norm());
  }
  const double predicted = -g.dot(expected) - 0.5 * expected.dot(H * expected);
  EXPECT_NEAR(equations.PredictedDecrease(kLambda, step), predicted,
              1e-7 * predicted);
}

TEST(BundleSolverEdgeTest, InvisibleObservationIsAFailure) {
  BuiltProblem built =
      ExactProblem(Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve)),
                   BundleAdjustmentOptions());
  BundleState state = built.state;
  state.points[0] = Eigen::Vector3d::Constant(std::nan(""));
  const BundleState before = state;
  const SolveSummary summary =
      SolveBundle(built.problem, BundleSolverOptions(), 1, &state);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(MaxPoseDifference(built.problem, state, before), 0.0);
}

TEST(BundleSolverEdgeTest, EmptyProblemConverges) {
  BundleProblem problem;
  BundleState state;
  const SolveSummary summary =
      SolveBundle(problem, BundleSolverOptions(), 1, &state);
  EXPECT_EQ(summary.termination, Termination::kConverged);
}

TEST(BundleSolverEdgeTest, HeldPointsOrFramesStay) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  for (const bool points_are_held : {true, false}) {
    BundleAdjustmentOptions options;
    options.refine_points = !points_are_held;
    options.refine_rig_from_world = points_are_held;
    options.refine_sensor_from_rig = RefineMode::kNo;
    BuiltProblem built = ExactProblem(simulation, options);
    BundleState state = built.state;
    Random random(4);
    Perturb(built.problem, 0.01, &random, &state);
    if (points_are_held) state.points = built.state.points;
    const SolveSummary summary =
        SolveBundle(built.problem, TightTolerances(), 2, &state);
    EXPECT_LT(summary.final_cost, 1e-12);
    EXPECT_LT(MaxPoseDifference(built.problem, state, built.state), 1e-8);
    for (size_t p = 0; p < state.points.size(); ++p) {
      EXPECT_LT((state.points[p] - built.state.points[p]).norm(), 1e-4);
    }
  }
}

}  // namespace
}  // namespace mgsfm
