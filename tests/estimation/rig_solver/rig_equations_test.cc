// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_equations.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <tuple>
#include <vector>

#include "estimation/rig_solver/dense_equations.h"
#include "estimation/rig_solver/rig_fixtures.h"
#include "rig_solver/baseline_terms.h"
#include "rig_solver/schur_kernels.h"

namespace mgsfm {
namespace {

constexpr double kLambda = 1e-3;

// The free parts of a problem.
struct Freedom {
  const char* label;
  bool rotations = true;
  bool sensors = true;
  bool params = false;
  bool points = true;
};

std::vector<Freedom> AllFreedoms() {
  return {{"Frames", true, false},
          {"FramesAndSensors", true, true},
          {"Intrinsics", true, false, true},
          {"Everything", true, true, true},
          {"Translations", false, true},
          {"TranslationsAndIntrinsics", false, false, true},
          {"HeldPoints", true, true, true, false}};
}

RigSceneOptions SmallScene(const std::vector<TestCamera>& cameras,
                           const Freedom& freedom) {
  RigSceneOptions options;
  options.cameras = cameras;
  options.num_points = 24;
  options.rotations_are_free = freedom.rotations;
  options.sensors_are_free = freedom.sensors;
  options.params_are_free = freedom.params;
  options.points_are_free = freedom.points;
  options.noise_px = 1.0;
  return options;
}

// The change of the unknowns of the dense equations by a trial step.
template <class R>
Eigen::VectorXd TrialStepOf(const RigEquations<R>& equations,
                            const RigProblemBase& problem) {
  const RigStructure& s = equations.structure();
  const size_t num_points = problem.points_are_free ? problem.num_points() : 0;
  Eigen::VectorXd step(
      static_cast<Eigen::Index>(s.num_unknowns + 3 * num_points));
  step.head(s.num_unknowns) = equations.step();
  for (size_t p = 0; p < num_points; ++p) {
    step.segment<3>(s.num_unknowns + 3 * s.point_order[p]) =
        equations.trial_points()[p] - equations.points()[p];
  }
  return step;
}

// Expects that a trial predicts the decrease of the step `promised` by the
// dense equations, and that the new state is `step` from the old one.
template <class Observation>
void ExpectTrial(const TrialStep& trial, const DenseEquations& dense,
                 const Eigen::VectorXd& promised,
                 const RigProblem<Observation>& problem, const RigStructure& s,
                 const RigState& state, const Eigen::VectorXd& step) {
  const double predicted = -dense.gradient.dot(promised) -
                           0.5 * promised.dot(dense.hessian * promised);
  EXPECT_NEAR(trial.predicted_decrease, predicted, 1e-5 * predicted);
  EXPECT_NEAR(trial.step_norm, step.norm(), 1e-9 * step.norm());
  const double new_cost =
      CostOfResiduals(AllResiduals(problem, Moved(problem, s, state, step)));
  EXPECT_NEAR(trial.new_cost, new_cost, 1e-9 * new_cost);
}

// Compares a step, its predicted decrease and its new cost with those of the
// dense equations. Differences are measured in the norm of the equations, so
// units do not matter.
template <class R>
void ExpectStepOfDenseEquations(
    const RigProblem<typename R::Observation>& problem, const RigState& state) {
  RigEquations<R> equations(problem, {ReducedSolver::kDirect}, Threads(2));
  equations.SetState(state);
  const RigStructure& s = equations.structure();
  const DenseEquations dense = MakeDenseEquations(problem, s, state);
  const Eigen::MatrixXd damped = dense.Damped(kLambda);
  const Eigen::VectorXd expected = damped.ldlt().solve(-dense.gradient);

  EXPECT_NEAR(equations.Cost(), dense.cost, 1e-10 * dense.cost);
  ASSERT_TRUE(equations.Linearize(kLambda));
  ASSERT_TRUE(equations.Solve());
  const TrialStep trial = equations.TryStep();
  const Eigen::VectorXd step = TrialStepOf(equations, problem);
  const Eigen::VectorXd error = step - expected;
  EXPECT_LT(std::sqrt(error.dot(damped * error)),
            2e-6 * std::sqrt(expected.dot(damped * expected)));
  ExpectTrial(trial, dense, expected, problem, s, state, step);
}

class CameraModelTest : public testing::TestWithParam<TestCamera> {};

TEST_P(CameraModelTest, StepSolvesTheFullEquations) {
  for (const Freedom& freedom : AllFreedoms()) {
    SCOPED_TRACE(freedom.label);
    RigScene<PixelObservation> scene =
        MakePixelScene(SmallScene({GetParam(), GetParam()}, freedom));
    ASSERT_GT(scene.problem.observations.size(), 60u);
    RigState state = scene.truth;
    Random random(3);
    Perturb(scene.problem, 2e-3, &random, &state);
    ExpectStepOfDenseEquations<PixelResidual>(scene.problem, state);
  }
}

// A perturbation of the state and the corresponding column of derivatives.
struct Column {
  std::function<void(double, RigState*)> move;
  Eigen::Vector2d expected;
};

std::vector<Column> PoseColumns(const RigProblemBase::Image& image, size_t p,
                                const ObservationRows<2, 6>& rows) {
  std::vector<Column> columns;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = Eigen::Vector3d::Unit(i);
    const int frame = image.frame, sensor = image.sensor;
    columns.push_back({[=](double h, RigState* s) { s->points[p] += h * axis; },
                       {rows.point[i], rows.point[3 + i]}});
    columns.push_back({[=](double h, RigState* s) {
                         Eigen::Quaterniond& q =
                             s->frames[frame].rig_from_world;
                         q = ExpSO3(Eigen::Vector3d(h * axis)) * q;
                       },
                       {rows.frame[i], rows.frame[6 + i]}});
    columns.push_back(
        {[=](double h, RigState* s) { s->frames[frame].center += h * axis; },
         {rows.frame[3 + i], rows.frame[9 + i]}});
    columns.push_back({[=](double h, RigState* s) {
                         Eigen::Quaterniond& q = s->sensors[sensor].rotation;
                         q = ExpSO3(Eigen::Vector3d(h * axis)) * q;
                       },
                       {rows.image[i], rows.image[6 + i]}});
    columns.push_back({[=](double h, RigState* s) {
                         s->sensors[sensor].translation += h * axis;
                       },
                       {rows.image[3 + i], rows.image[9 + i]}});
  }
  return columns;
}

void ExpectDerivatives(const RigScene<PixelObservation>& scene,
                       const PixelObservation& o, size_t p,
                       const std::vector<Column>& columns) {
  constexpr double kStep = 1e-6;
  for (const Column& column : columns) {
    RigState before = scene.truth, after = scene.truth;
    column.move(-kStep, &before);
    column.move(kStep, &after);
    const Eigen::Vector2d difference =
        (ObservationResidual(scene.problem, after, o, after.points[p]) -
         ObservationResidual(scene.problem, before, o, before.points[p])) /
        (2.0 * kStep);
    EXPECT_LT((difference - column.expected).norm(),
              2e-6 * (1.0 + difference.norm()));
  }
}

// Compares the derivatives of single observations with finite differences.
TEST_P(CameraModelTest, RowsAreDerivatives) {
  RigSceneOptions options =
      SmallScene({GetParam()}, Freedom{"Everything", true, true, true});
  options.num_points = 8;
  const RigScene<PixelObservation> scene = MakePixelScene(options);
  const RigProblem<PixelObservation>& problem = scene.problem;
  std::vector<ImagePose> poses;
  ComputeImagePoses(problem, scene.truth, &poses);
  for (size_t p = 0; p < problem.num_points(); ++p) {
    for (size_t k = problem.point_begin[p]; k < problem.point_begin[p + 1];
         ++k) {
      const PixelObservation& o = problem.observations[k];
      const ImagePose& pose = poses[o.image];
      ObservationTerms<2> terms;
      ASSERT_TRUE(LinearizeObservation<PixelResidual>(
          {RobustLossType::kTrivial, 1.0}, pose, scene.truth.points[p].data(),
          o.pixel.data(), &terms));
      ObservationRows<2, 6> rows;
      ComputeRows<2, 6>(pose, terms, &rows);
      std::vector<Column> columns =
          PoseColumns(problem.images[o.image], p, rows);
      for (int i = 0; i < pose.num_free_params; ++i) {
        columns.push_back(
            {[i](double h, RigState* s) { s->cameras[0][i] += h; },
             {terms.K[i], terms.K[pose.num_free_params + i]}});
      }
      ExpectDerivatives(scene, o, p, columns);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Models, CameraModelTest, testing::ValuesIn(AllTestCameras()),
    [](const testing::TestParamInfo<TestCamera>& camera_info) {
      return camera_info.param.label;
    });

TEST(RigEquationsTest, RaysAndBaselinesSolveTheFullEquations) {
  for (const bool sensors : {false, true}) {
    for (const bool points : {false, true}) {
      SCOPED_TRACE(testing::Message() << sensors << points);
      const Freedom freedom{"", false, sensors, false, points};
      const std::vector<TestCamera> cameras(3, PerspectiveTestCameras()[0]);
      RigScene<RayObservation> scene =
          MakeRayScene(SmallScene(cameras, freedom), 0.01);
      RigState state = scene.truth;
      Random random(4);
      Perturb(scene.problem, 5e-3, &random, &state);
      ExpectStepOfDenseEquations<RayResidual>(scene.problem, state);
    }
  }
}

// The step of a point at more than twice its true distance leads behind the
// cameras. This step is shortened; those of the other points are not.
TEST(RigEquationsTest, LongStepsOfPointsDoNotIncreaseTheirCost) {
  const Freedom freedom{"", true, true};
  RigSceneOptions options = SmallScene(
      {PerspectiveTestCameras()[0], FisheyeTestCameras()[0]}, freedom);
  options.noise_px = 0.0;
  const RigScene<PixelObservation> scene = MakePixelScene(options);
  RigState state = scene.truth;
  for (size_t p = 0; p < state.points.size(); p += 8) {
    MovePointAway(scene.problem, p, 5.0, &state);
  }
  RigEquations<PixelResidual> equations(scene.problem, {ReducedSolver::kDirect},
                                        Threads(2));
  equations.SetState(state);
  ASSERT_TRUE(equations.Linearize(1e-10));
  ASSERT_TRUE(equations.Solve());
  const TrialStep trial = equations.TryStep();
  EXPECT_LT(trial.new_cost, 0.9 * equations.Cost());
  const DenseEquations dense =
      MakeDenseEquations(scene.problem, equations.structure(), state);
  const Eigen::VectorXd whole =
      dense.Damped(1e-10).ldlt().solve(-dense.gradient);
  const RigStructure& s = equations.structure();
  for (size_t p = 0; p < scene.problem.num_points(); ++p) {
    const size_t point = s.point_order[p];
    const Eigen::Vector3d step = whole.segment<3>(s.num_unknowns + 3 * point);
    const Eigen::Vector3d moved =
        equations.trial_points()[p] - equations.points()[p];
    const double share = moved.norm() / step.norm();
    EXPECT_LT((moved - share * step).norm(), 1e-4 * step.norm()) << point;
    if (point % 8 == 0) {
      EXPECT_LT(share, 0.51) << point;
      EXPECT_GT(share, 0.01) << point;
    } else {
      EXPECT_NEAR(share, 1.0, 1e-4) << point;
    }
  }
}

// Each point ends at a local minimum of the cost for the cameras after the
// step, and no camera moves further.
TEST(RigEquationsTest, PointsOfTrialStepsAreMinimizedByThemselves) {
  RigSceneOptions options =
      SmallScene({PerspectiveTestCameras()[0], FisheyeTestCameras()[0]},
                 Freedom{"", true, true, true});
  RigScene<PixelObservation> scene = MakePixelScene(options);
  scene.problem.loss = {RobustLossType::kCauchy, 1.0};
  RigEquations<PixelResidual> equations(scene.problem, {ReducedSolver::kDirect},
                                        Threads(2));
  equations.SetState(scene.truth);
  const double before = equations.Cost();
  ASSERT_TRUE(equations.Linearize(10.0));
  ASSERT_TRUE(equations.Solve());
  const double trial = equations.TryStep().new_cost;
  EXPECT_LT(trial, before);
  const double cost = equations.MinimizeTrialPoints(trial, 1e-12 * before);
  EXPECT_LT(cost, trial);
  EXPECT_EQ(equations.Cost(), before);
  equations.AcceptStep();
  EXPECT_NEAR(cost, equations.Cost(), 1e-12 * cost);
  RigState state;
  equations.GetState(&state);
  EXPECT_NE(state.cameras, scene.truth.cameras);
  for (size_t p = 0; p < state.points.size(); ++p) {
    for (int i = 0; i < 6; ++i) {
      RigState moved = state;
      moved.points[p][i / 2] += i % 2 == 0 ? 1e-3 : -1e-3;
      equations.SetState(moved);
      EXPECT_GT(equations.Cost(), cost) << p << " " << i;
    }
  }
}

TEST(RigEquationsTest, RaysWithFreeRotationsSolveTheFullEquations) {
  RigSceneOptions options = SmallScene(
      {PerspectiveTestCameras()[0], FisheyeTestCameras()[0]}, Freedom{""});
  const RigScene<PixelObservation> pixels = MakePixelScene(options);
  RigProblem<RayObservation> problem;
  static_cast<RigProblemBase&>(problem) = pixels.problem;
  problem.loss = {RobustLossType::kHuber, 0.01};
  Random random(5);
  for (size_t p = 0; p < problem.num_points(); ++p) {
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      const int image = pixels.problem.observations[o].image;
      const Eigen::Vector3d x =
          PointInCamera(problem, pixels.truth, image, pixels.truth.points[p]);
      problem.observations.push_back(
          {image, (x.normalized() + RandomVector(0.01, &random)).normalized()});
    }
  }
  ExpectStepOfDenseEquations<RayResidual>(problem, pixels.truth);
}

// Rotations of images in the problem replace those of the state.
TEST(RigEquationsTest, HeldRotationsMayBeTheProblems) {
  const Freedom freedom{"", false, true};
  const std::vector<TestCamera> cameras(2, PerspectiveTestCameras()[0]);
  RigScene<RayObservation> scene =
      MakeRayScene(SmallScene(cameras, freedom), 0.01);
  RigProblem<RayObservation> held = scene.problem;
  for (const RigProblemBase::Image& image : held.images) {
    held.held_cam_from_world.push_back(
        (scene.truth.sensors[image.sensor].rotation *
         scene.truth.frames[image.frame].rig_from_world)
            .toRotationMatrix());
  }
  RigEquations<RayResidual> by_state(scene.problem, {ReducedSolver::kDirect},
                                     Threads(1));
  RigEquations<RayResidual> by_problem(held, {ReducedSolver::kDirect},
                                       Threads(1));
  for (auto* equations : {&by_state, &by_problem}) {
    equations->SetState(scene.truth);
    ASSERT_TRUE(equations->Linearize(kLambda));
    ASSERT_TRUE(equations->Solve());
  }
  EXPECT_LT((by_state.step() - by_problem.step()).norm(),
            1e-9 * by_state.step().norm());
}

TEST(RigEquationsTest, PriorsOnPosesSolveTheFullEquations) {
  for (const Freedom& freedom : AllFreedoms()) {
    SCOPED_TRACE(freedom.label);
    const std::vector<TestCamera> cameras(2, PerspectiveTestCameras()[0]);
    RigScene<PixelObservation> scene =
        MakePixelScene(SmallScene(cameras, freedom));
    AddPosePriorsNearby(0.1, &scene);
    RigState state = scene.truth;
    Random random(6);
    Perturb(scene.problem, 2e-3, &random, &state);
    ExpectStepOfDenseEquations<PixelResidual>(scene.problem, state);
  }
}

TEST(RigEquationsTest, ImagesThatMoveSolveTheFullEquations) {
  for (const Freedom& freedom : AllFreedoms()) {
    SCOPED_TRACE(freedom.label);
    const std::vector<TestCamera> cameras(2, PerspectiveTestCameras()[0]);
    RigSceneOptions options = SmallScene(cameras, freedom);
    options.images_move = true;
    RigScene<PixelObservation> scene = MakePixelScene(options);
    AddPosePriorsNearby(0.1, &scene);
    RigState state = scene.truth;
    Random random(7);
    Perturb(scene.problem, 2e-3, &random, &state);
    ExpectStepOfDenseEquations<PixelResidual>(scene.problem, state);
  }
}

// The problem (with its state) whose points are the parts of the points of a
// structure.
RigScene<PixelObservation> SceneOfParts(const RigScene<PixelObservation>& scene,
                                        const RigStructure& s) {
  RigScene<PixelObservation> cut = scene;
  cut.problem.observations.clear();
  cut.problem.point_begin = {0};
  cut.truth.points.clear();
  for (const ChunkRanges& chunk : s.chunks) {
    for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
      const int point = s.point_order[p];
      for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
        const int image =
            s.chunk_images[chunk.images.begin + s.observation_image[k]].image;
        if (s.observation_starts_part[k]) {
          cut.problem.point_begin.push_back(cut.problem.observations.size());
          cut.truth.points.push_back(scene.truth.points[point]);
        }
        for (size_t o = scene.problem.point_begin[point];
             o < scene.problem.point_begin[point + 1]; ++o) {
          if (scene.problem.observations[o].image != image) continue;
          cut.problem.observations.push_back(scene.problem.observations[o]);
        }
      }
      cut.problem.point_begin.push_back(cut.problem.observations.size());
      cut.truth.points.push_back(scene.truth.points[point]);
    }
  }
  return cut;
}

TEST(RigEquationsTest, PreconditionerIsTheMatrixOfCutPoints) {
  const RigScene<PixelObservation> scene = MakePixelScene(SceneOfLongTracks());
  RigEquations<PixelResidual> iterative(
      scene.problem, {ReducedSolver::kIterative}, Threads(2));
  const RigStructure& s = iterative.structure();
  const RigScene<PixelObservation> cut = SceneOfParts(scene, s);
  ASSERT_EQ(cut.problem.observations.size(), scene.problem.observations.size());
  EXPECT_GT(cut.problem.num_points(), scene.problem.num_points());
  RigEquations<PixelResidual> direct(cut.problem, {ReducedSolver::kDirect},
                                     Threads(2));
  const RigStructure& d = direct.structure();
  ASSERT_EQ(d.num_unknowns, s.num_unknowns);
  iterative.SetState(scene.truth);
  direct.SetState(cut.truth);
  Random random(3);
  Eigen::MatrixXd b(s.num_unknowns, 1), other_b(s.num_unknowns, 1), x, other_x;
  for (size_t block = 0; block < s.block_size.size(); ++block) {
    for (int i = 0; i < s.block_size[block]; ++i) {
      b(s.block_first[block] + i) = other_b(d.block_first[block] + i) =
          random.Normal();
    }
  }
  for (auto [equations, rhs, solution] :
       {std::tuple{&iterative, &b, &x},
        std::tuple{&direct, &other_b, &other_x}}) {
    ASSERT_TRUE(equations->Linearize(kLambda));
    ASSERT_TRUE(equations->Factorize());
    solution->resizeLike(*rhs);
    equations->SolveColumns(*rhs, solution);
  }
  for (size_t block = 0; block < s.block_size.size(); ++block) {
    const auto part =
        x.col(0).segment(s.block_first[block], s.block_size[block]);
    const auto other =
        other_x.col(0).segment(d.block_first[block], d.block_size[block]);
    EXPECT_LT((part - other).norm(), 1e-6 * x.norm());
  }
}

TEST(RigEquationsTest, TheLossFollowsTheFreedomOfPoints) {
  for (const Freedom& freedom : AllFreedoms()) {
    SCOPED_TRACE(freedom.label);
    for (const int num_observations : {2, 3, 6}) {
      SCOPED_TRACE(num_observations);
      RigSceneOptions options =
          SmallScene({PerspectiveTestCameras()[0]}, freedom);
      options.num_frames_of_point = num_observations;
      RigScene<PixelObservation> scene = MakePixelScene(options);
      scene.problem.loss = {RobustLossType::kCauchy, 1.3};
      scene.problem.loss_follows_freedom = true;
      ExpectStepOfDenseEquations<PixelResidual>(scene.problem, scene.truth);
    }
  }
}

TEST(RigEquationsTest, EveryLossWeighsAsItsDerivativeDoes) {
  for (const auto type :
       {RobustLossType::kTrivial, RobustLossType::kHuber,
        RobustLossType::kCauchy, RobustLossType::kGemanMcClure}) {
    SCOPED_TRACE(static_cast<int>(type));
    RigScene<PixelObservation> scene =
        MakePixelScene(SmallScene({PerspectiveTestCameras()[0]}, Freedom{""}));
    scene.problem.loss = {type, 1.3};
    ExpectStepOfDenseEquations<PixelResidual>(scene.problem, scene.truth);
  }
}

}  // namespace
}  // namespace mgsfm
