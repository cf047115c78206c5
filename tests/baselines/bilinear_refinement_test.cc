// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/bilinear_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "support/translation_input.h"
#include "translation/position_initialization.h"
#include "translation/position_problem.h"
#include "translation/track_points.h"

namespace mgsfm {
namespace {

constexpr double kMinParallaxDeg = 0.3;

Context Threads(int num_threads) {
  Context context;
  context.num_threads = num_threads;
  return context;
}

// What the refinements get of the stages before.
struct Stages {
  explicit Stages(const TranslationInput& input)
      : problem(MakePositionProblem(input.simulation.scene, input.rotations)),
        baselines(EstimateBaselineDirections(
            input.simulation.scene, input.bearings, input.simulation.view_graph,
            input.rotations.pair_is_inlier, problem, kMinParallaxDeg,
            Threads(2))),
        scales(AverageScales(
            baselines, static_cast<int>(input.simulation.scene.images.size()),
            Threads(2))),
        pair_is_used(input.rotations.pair_is_inlier),
        initial(InitializePositions(problem, baselines, scales, pair_is_used,
                                    kMinParallaxDeg)),
        rays(ComputeTrackRays(problem, input.bearings, input.tracks, 2)) {
    TrackPointOptions options;
    options.max_error_rad = DegToRad(4.0);
    options.min_angle_rad = DegToRad(kMinParallaxDeg);
    points = TriangulateTracks(problem, rays, initial.positions, options, 2);
    for (size_t t = 0; t < points.point_in_world.size(); ++t) {
      if (points.point_in_world[t]) track_idxs.push_back(t);
    }
  }

  RefinementInput Input() const {
    return {problem, baselines, scales, initial, pair_is_used};
  }

  PositionProblem problem;
  std::vector<BaselineDirection> baselines;
  PairScales scales;
  Mask pair_is_used;
  InitialPositions initial;
  TrackRays rays;
  TrackPoints points;
  std::vector<size_t> track_idxs;
};

RefinementOptions Tight(SolverBackend backend) {
  RefinementOptions options;
  options.max_num_iterations = 300;
  options.loss_scale_rad = DegToRad(0.5);
  options.function_tolerance = 1e-13;
  options.backend = backend;
  return options;
}

struct Refined {
  SolveSummary summary;
  Positions positions;
  TrackPoints points;
};

Refined RefineCameras(const Stages& stages, const RefinementOptions& options) {
  Refined refined{{}, stages.initial.positions, stages.points};
  refined.summary = RefineCamerasBilinearly(stages.Input(), options, Threads(2),
                                            &refined.positions);
  return refined;
}

Refined RefineAll(const Stages& stages, const RefinementOptions& options,
                  int num_threads = 2) {
  Refined refined{{}, stages.initial.positions, stages.points};
  refined.summary = RefineCamerasAndPointsBilinearly(
      stages.Input(), stages.rays, stages.track_idxs, options,
      Threads(num_threads), &refined.positions, &refined.points);
  return refined;
}

void ExpectSameOptimum(const Refined& a, const Refined& b) {
  ASSERT_TRUE(a.summary.IsUsable()) << a.summary.message;
  ASSERT_TRUE(b.summary.IsUsable()) << b.summary.message;
  EXPECT_LT(a.summary.final_cost, a.summary.initial_cost);
  EXPECT_NEAR(a.summary.final_cost, b.summary.final_cost,
              1e-7 * b.summary.final_cost);
}

SimulationOptions Noisy(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kCurve;
  options.num_frames = 10;
  options.num_points_per_frame = 60;
  options.max_num_features_per_image = 120;
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.05;
  return options;
}

class RigTest : public testing::TestWithParam<RigPreset> {};

TEST_P(RigTest, OptimumOfCamerasIsThatOfCeres) {
  const TranslationInput input = MakeTranslationInput(Noisy(GetParam()));
  const Stages stages(input);
  const Refined native = RefineCameras(stages, Tight(SolverBackend::kNative));
  const Refined ceres = RefineCameras(stages, Tight(SolverBackend::kCeres));
  ExpectSameOptimum(native, ceres);
  for (size_t f = 0; f < native.positions.frame_center.size(); ++f) {
    EXPECT_LT(
        (native.positions.frame_center[f] - ceres.positions.frame_center[f])
            .norm(),
        1e-4);
  }
}

TEST_P(RigTest, OptimumWithPointsIsThatOfCeres) {
  const TranslationInput input = MakeTranslationInput(Noisy(GetParam()));
  const Stages stages(input);
  ASSERT_GT(stages.track_idxs.size(), 100u);
  ExpectSameOptimum(RefineAll(stages, Tight(SolverBackend::kNative)),
                    RefineAll(stages, Tight(SolverBackend::kCeres)));
}

INSTANTIATE_TEST_SUITE_P(Rigs, RigTest,
                         testing::Values(RigPreset::kStereo,
                                         RigPreset::kKitti360));

TEST(BilinearRefinementTest, OrderOfTracksDoesNotMatter) {
  const TranslationInput input =
      MakeTranslationInput(Noisy(RigPreset::kStereo));
  Stages stages(input);
  const Refined forward = RefineAll(stages, Tight(SolverBackend::kNative));
  std::reverse(stages.track_idxs.begin(), stages.track_idxs.end());
  const Refined backward = RefineAll(stages, Tight(SolverBackend::kNative));
  ExpectSameOptimum(forward, backward);
}

TEST(BilinearRefinementTest, ThreadsDoNotChangeABit) {
  const TranslationInput input =
      MakeTranslationInput(Noisy(RigPreset::kKitti360));
  const Stages stages(input);
  RefinementOptions options = Tight(SolverBackend::kNative);
  options.max_num_iterations = 10;
  const Refined one = RefineAll(stages, options, 1);
  const Refined three = RefineAll(stages, options, 3);
  EXPECT_EQ(one.summary.final_cost, three.summary.final_cost);
  EXPECT_EQ(one.positions.frame_center, three.positions.frame_center);
  EXPECT_EQ(one.points.point_in_world, three.points.point_in_world);
}

}  // namespace
}  // namespace mgsfm
