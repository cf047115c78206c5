// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_solver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "estimation/rig_solver/rig_fixtures.h"

namespace mgsfm {
namespace {

RigSolverOptions Tight() {
  RigSolverOptions options;
  options.max_num_iterations = 300;
  options.function_tolerance = 1e-15;
  options.parameter_tolerance = 1e-15;
  return options;
}

template <class Observation>
SolveSummary SolveWith(const RigScene<Observation>& scene, double perturbation,
                       const RigSolverOptions& options, int num_threads,
                       RigState* state) {
  *state = scene.truth;
  Random random(7);
  Perturb(scene.problem, perturbation, &random, state);
  return SolveRigProblem(scene.problem, options, Threads(num_threads), state);
}

// The largest difference of positions and of rotations.
double PoseDifference(const RigState& a, const RigState& b) {
  double most = 0.0;
  for (size_t i = 0; i < a.frames.size(); ++i) {
    most = std::max({most, (a.frames[i].center - b.frames[i].center).norm(),
                     a.frames[i].rig_from_world.angularDistance(
                         b.frames[i].rig_from_world)});
  }
  for (size_t i = 0; i < a.sensors.size(); ++i) {
    most = std::max(
        {most, (a.sensors[i].translation - b.sensors[i].translation).norm(),
         a.sensors[i].rotation.angularDistance(b.sensors[i].rotation)});
  }
  return most;
}

template <class Observation>
void ExpectSameOptimum(const RigScene<Observation>& scene,
                       const RigSolverOptions& a, const RigSolverOptions& b) {
  RigState state_a, state_b;
  const SolveSummary summary_a = SolveWith(scene, 5e-3, a, 2, &state_a);
  const SolveSummary summary_b = SolveWith(scene, 5e-3, b, 2, &state_b);
  EXPECT_TRUE(summary_a.IsUsable()) << summary_a.message;
  EXPECT_TRUE(summary_b.IsUsable()) << summary_b.message;
  EXPECT_LT(summary_a.final_cost, summary_a.initial_cost);
  EXPECT_NEAR(summary_a.final_cost, summary_b.final_cost,
              1e-8 * summary_b.final_cost);
  EXPECT_LT(PoseDifference(state_a, state_b), 1e-5);
}

RigSceneOptions NoisyScene(const std::vector<TestCamera>& cameras) {
  RigSceneOptions options;
  options.cameras = cameras;
  options.noise_px = 0.5;
  return options;
}

class EachModelTest : public testing::TestWithParam<TestCamera> {
 protected:
  // Free and constant extrinsics and intrinsics, and constant rotations.
  static std::vector<RigSceneOptions> Scenes() {
    RigSceneOptions all = NoisyScene({GetParam(), GetParam()});
    all.params_are_free = true;
    RigSceneOptions sensors = all;
    sensors.params_are_free = false;
    RigSceneOptions frames = sensors;
    frames.sensors_are_free = false;
    RigSceneOptions translations = sensors;
    translations.rotations_are_free = false;
    return {all, sensors, frames, translations};
  }
};

TEST_P(EachModelTest, OptimumIsThatOfCeres) {
  RigSolverOptions ceres = Tight();
  ceres.backend = SolverBackend::kCeres;
  int i = 0;
  for (const RigSceneOptions& options : Scenes()) {
    SCOPED_TRACE(i++);
    RigScene<PixelObservation> scene = MakePixelScene(options);
    ExpectSameOptimum(scene, Tight(), ceres);
    scene.problem.loss = {RobustLossType::kCauchy, 1.0};
    scene.problem.loss_follows_freedom = true;
    ExpectSameOptimum(scene, Tight(), ceres);
  }
}

TEST_P(EachModelTest, IterativeOptimumIsTheDirectOne) {
  RigSolverOptions iterative = Tight();
  iterative.reduced_solver = ReducedSolver::kIterative;
  ExpectSameOptimum(MakePixelScene(Scenes().front()), iterative, Tight());
}

TEST(RigSolverTest, OptimumOfCutPointsIsTheDirectOne) {
  RigSolverOptions iterative = Tight();
  iterative.reduced_solver = ReducedSolver::kIterative;
  RigSceneOptions options = SceneOfLongTracks();
  ExpectSameOptimum(MakePixelScene(options), iterative, Tight());
  options.rotations_are_free = false;
  ExpectSameOptimum(MakePixelScene(options), iterative, Tight());
  ExpectSameOptimum(MakeRayScene(options, 0.005), iterative, Tight());
}

INSTANTIATE_TEST_SUITE_P(
    Models, EachModelTest, testing::ValuesIn(AllTestCameras()),
    [](const testing::TestParamInfo<TestCamera>& camera_info) {
      return camera_info.param.label;
    });

RigScene<RayObservation> RayScene() {
  return MakeRayScene(
      NoisyScene(std::vector<TestCamera>(3, PerspectiveTestCameras()[0])),
      0.005);
}

TEST(RigSolverTest, OptimumWithPriorsOnPosesIsThatOfCeres) {
  RigSolverOptions ceres = Tight(), iterative = Tight();
  ceres.backend = SolverBackend::kCeres;
  iterative.reduced_solver = ReducedSolver::kIterative;
  RigSceneOptions options =
      NoisyScene({PerspectiveTestCameras()[0], FisheyeTestCameras()[0]});
  for (const bool images_move : {false, true}) {
    options.images_move = images_move;
    RigScene<PixelObservation> scene = MakePixelScene(options);
    AddPosePriorsNearby(0.05, &scene);
    ExpectSameOptimum(scene, Tight(), ceres);
    ExpectSameOptimum(scene, iterative, Tight());
  }
}

TEST(RigSolverTest, OptimumOfRaysAndBaselinesIsThatOfCeres) {
  RigSolverOptions ceres = Tight(), iterative = Tight();
  ceres.backend = SolverBackend::kCeres;
  iterative.reduced_solver = ReducedSolver::kIterative;
  const RigScene<RayObservation> scene = RayScene();
  ExpectSameOptimum(scene, Tight(), ceres);
  ExpectSameOptimum(scene, iterative, Tight());
}

template <class Observation>
void ExpectSameBits(const RigScene<Observation>& scene, ReducedSolver solver,
                    SolverBackend backend = SolverBackend::kNative) {
  RigSolverOptions options;
  options.backend = backend;
  options.max_num_iterations = 8;
  options.reduced_solver = solver;
  RigState one, three;
  const SolveSummary a = SolveWith(scene, 0.01, options, 1, &one);
  const SolveSummary b = SolveWith(scene, 0.01, options, 3, &three);
  EXPECT_TRUE(a.IsUsable());
  EXPECT_EQ(a.final_cost, b.final_cost);
  EXPECT_EQ(a.num_iterations, b.num_iterations);
  EXPECT_EQ(one.points, three.points);
  EXPECT_EQ(one.cameras, three.cameras);
  for (size_t i = 0; i < one.frames.size(); ++i) {
    EXPECT_EQ(one.frames[i].center, three.frames[i].center);
    EXPECT_EQ(one.frames[i].rig_from_world.coeffs(),
              three.frames[i].rig_from_world.coeffs());
  }
  for (size_t i = 0; i < one.sensors.size(); ++i) {
    EXPECT_EQ(one.sensors[i].translation, three.sensors[i].translation);
    EXPECT_EQ(one.sensors[i].rotation.coeffs(),
              three.sensors[i].rotation.coeffs());
  }
}

// Large enough for several chunks of work.
TEST(RigSolverTest, ThreadsDoNotChangeABit) {
  RigSceneOptions options =
      NoisyScene({PerspectiveTestCameras()[0], FisheyeTestCameras()[0]});
  options.num_frames = 30;
  options.num_points = 1200;
  options.params_are_free = true;
  const RigScene<PixelObservation> pixels = MakePixelScene(options);
  const RigScene<RayObservation> rays = MakeRayScene(options, 0.005);
  for (const auto solver :
       {ReducedSolver::kDirect, ReducedSolver::kIterative}) {
    ExpectSameBits(pixels, solver);
    ExpectSameBits(rays, solver);
  }
  ExpectSameBits(pixels, ReducedSolver::kDirect, SolverBackend::kCeres);
  ExpectSameBits(rays, ReducedSolver::kDirect, SolverBackend::kCeres);
  ExpectSameBits(MakePixelScene(SceneOfLongTracks()),
                 ReducedSolver::kIterative);
}

TEST(RigSolverTest, CanSolveAgainWithOtherValues) {
  RigScene<RayObservation> scene = RayScene();
  RigState again = scene.truth;
  RigSolver<RayObservation> solver(scene.problem, Tight(), Threads(2));
  solver.Solve(300, &again);
  for (BaselineTerm& term : scene.problem.baselines) term.weight *= 2.0;
  scene.problem.loss.scale *= 0.5;
  const SolveSummary summary = solver.Solve(300, &again);
  RigState anew = scene.truth;
  const SolveSummary expected =
      SolveRigProblem(scene.problem, Tight(), Threads(2), &anew);
  EXPECT_NEAR(summary.final_cost, expected.final_cost,
              1e-8 * expected.final_cost);
  EXPECT_LT(PoseDifference(again, anew), 1e-5);
}

TEST(RigSolverTest, FinalCostIsThatOfTheState) {
  const RigScene<RayObservation> scene = RayScene();
  RigState state = scene.truth;
  const SolveSummary summary =
      SolveRigProblem(scene.problem, Tight(), Threads(2), &state);
  const SolveSummary again =
      SolveRigProblem(scene.problem, Tight(), Threads(1), &state);
  EXPECT_NEAR(summary.final_cost, again.initial_cost,
              1e-12 * summary.initial_cost);
}

TEST(RigSolverTest, EmptyProblemConverges) {
  RigState state;
  for (const auto backend : {SolverBackend::kNative, SolverBackend::kCeres}) {
    RigSolverOptions options;
    options.backend = backend;
    EXPECT_EQ(SolveRigProblem(RigProblem<PixelObservation>(), options,
                              Threads(1), &state)
                  .termination,
              Termination::kConverged);
  }
}

}  // namespace
}  // namespace mgsfm
