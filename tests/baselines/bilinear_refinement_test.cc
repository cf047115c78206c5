// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/bilinear_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "baselines/bilinear_costs.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "support/threads.h"
#include "support/translation_input.h"
#include "translation_averaging/position_initialization.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/track_points.h"

namespace mgsfm {
namespace {

constexpr double kMinParallaxDeg = 0.3;

// The results of the stages before the refinements.
struct Stages {
  explicit Stages(const TranslationInput& input)
      : problem(MakePositionProblem(input.simulation.scene, input.rotations)),
        baselines(EstimateBaselineDirections(
            {input.simulation.scene, input.bearings,
             input.simulation.view_graph, input.rotations.pair_is_inlier,
             problem},
            kMinParallaxDeg, Threads(2))),
        scales(AverageScales(
            baselines, static_cast<int>(input.simulation.scene.images.size()),
            Threads(2))),
        pair_is_used(input.rotations.pair_is_inlier),
        initial(InitializePositions({problem, baselines, scales, pair_is_used},
                                    {kMinParallaxDeg})),
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

RefinementOptions Tight() {
  RefinementOptions options;
  options.max_num_iterations = 300;
  options.loss_scale_rad = DegToRad(0.5);
  options.function_tolerance = 1e-13;
  return options;
}

struct Refined {
  SolveSummary summary;
  PositionsAndPoints placed;
};

Refined RefineCameras(const Stages& stages, const RefinementOptions& options) {
  Refined refined{{}, {stages.initial.positions, stages.points}};
  refined.summary = RefineCamerasBilinearly(stages.Input(), options, Threads(2),
                                            &refined.placed.positions);
  return refined;
}

Refined RefineAll(const Stages& stages, const RefinementOptions& options,
                  int num_threads = 2) {
  Refined refined{{}, {stages.initial.positions, stages.points}};
  refined.summary = RefineCamerasAndPointsBilinearly(
      stages.Input(), stages.rays, stages.track_idxs, options,
      Threads(num_threads), &refined.placed);
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

// Half the loss of |v - d C| at the best scale d.
double CostAtBestScale(const Eigen::Vector3d& v, const Eigen::Vector3d& C,
                       double weight, double loss_scale) {
  const double d = std::max(v.dot(C) / C.squaredNorm(), 1e-5);
  const double s = weight * weight * (v - d * C).squaredNorm();
  const double a2 = loss_scale * loss_scale;
  return 0.5 * a2 * std::log1p(s / a2);  // Cauchy
}

// The objective of the header with points, minimized over the scales.
double CostWithPoints(const Stages& stages, const Positions& positions,
                      const TrackPoints& points,
                      const RefinementOptions& options) {
  const RefinementInput input = stages.Input();
  double cost = 0.0;
  const ObservationGroups& tracks = stages.rays.tracks;
  for (const size_t t : stages.track_idxs) {
    for (size_t k = tracks.offsets[t]; k < tracks.offsets[t + 1]; ++k) {
      if (!points.observation_is_used[k]) continue;
      cost += CostAtBestScale(
          stages.rays.rays_in_world[k],
          *points.point_in_world[t] -
              positions.CamCenter(stages.problem,
                                  tracks.observations[k].image_idx),
          1.0, options.loss_scale_rad);
    }
  }
  for (size_t i = 0; i < stages.baselines.size(); ++i) {
    if (!input.IsUsable(i, BaselineKind::kDirection, positions)) continue;
    const BaselineDirection& pair = stages.baselines[i];
    cost += CostAtBestScale(
        pair.direction,
        positions.CamCenter(stages.problem, pair.image_idx2) -
            positions.CamCenter(stages.problem, pair.image_idx1),
        input.DirectionWeight(i, kPairWeightWithPoints),
        options.loss_scale_rad);
  }
  return cost;
}

class RigTest : public testing::TestWithParam<RigPreset> {};

// The cost is that of the header, and no position near the solution has less.
TEST_P(RigTest, OptimumWithPointsIsAMinimumOfTheObjective) {
  const TranslationInput input = MakeTranslationInput(Noisy(GetParam()));
  const Stages stages(input);
  ASSERT_GT(stages.track_idxs.size(), 100u);
  const Refined refined = RefineAll(stages, Tight());
  ASSERT_TRUE(refined.summary.IsUsable()) << refined.summary.message;
  EXPECT_LT(refined.summary.final_cost, refined.summary.initial_cost);
  const double cost = CostWithPoints(stages, refined.placed.positions,
                                     refined.placed.points, Tight());
  EXPECT_NEAR(cost, refined.summary.final_cost, 1e-6 * cost);
  Random random(2);
  const auto step = [&](double radius) -> Eigen::Vector3d {
    return radius *
           Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  for (int trial = 0; trial < 60; ++trial) {
    Positions positions = refined.placed.positions;
    TrackPoints points = refined.placed.points;
    const double radius = std::pow(10.0, random.Uniform(-5.0, -1.0));
    const bool moves_all = trial % 2 == 0;
    // Frame 0 is the gauge.
    const auto moved = static_cast<size_t>(
        1 +
        random.Index(static_cast<uint32_t>(positions.frame_center.size() - 1)));
    for (size_t f = 1; f < positions.frame_center.size(); ++f) {
      if (moves_all || f == moved) positions.frame_center[f] += step(radius);
    }
    for (const size_t t : stages.track_idxs) {
      if (moves_all) *points.point_in_world[t] += step(radius);
    }
    EXPECT_GE(CostWithPoints(stages, positions, points, Tight()),
              cost * (1.0 - 1e-6));
  }
}

// Exact rays: the objective without points has its minimum at the truth, where
// all directions and lengths agree.
TEST_P(RigTest, OptimumOfCamerasIsTheTruthOfExactRays) {
  SimulationOptions options = Noisy(GetParam());
  options.pixel_noise_px = 0.0;
  options.mismatch_ratio = 0.0;
  const TranslationInput input = MakeTranslationInput(options);
  const Stages stages(input);
  const Refined refined = RefineCameras(stages, Tight());
  ASSERT_TRUE(refined.summary.IsUsable()) << refined.summary.message;
  PositionEstimate estimate;
  for (const auto& center : refined.placed.positions.frame_center) {
    estimate.frame_center_in_world.emplace_back(center);
  }
  for (const auto& t : refined.placed.positions.sensor_translation) {
    estimate.sensor_from_rig_translation.emplace_back(t);
  }
  EXPECT_LT(MeasureCenters(input, estimate).max_relative, 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Rigs, RigTest,
                         testing::Values(RigPreset::kStereo,
                                         RigPreset::kKitti360));

TEST(BilinearRefinementTest, OrderOfTracksDoesNotMatter) {
  const TranslationInput input =
      MakeTranslationInput(Noisy(RigPreset::kStereo));
  Stages stages(input);
  const Refined forward = RefineAll(stages, Tight());
  std::reverse(stages.track_idxs.begin(), stages.track_idxs.end());
  const Refined backward = RefineAll(stages, Tight());
  ExpectSameOptimum(forward, backward);
}

TEST(BilinearRefinementTest, ThreadsDoNotChangeABit) {
  const TranslationInput input =
      MakeTranslationInput(Noisy(RigPreset::kKitti360));
  const Stages stages(input);
  RefinementOptions options = Tight();
  options.max_num_iterations = 10;
  const Refined one = RefineAll(stages, options, 1);
  const Refined three = RefineAll(stages, options, 3);
  EXPECT_EQ(one.summary.final_cost, three.summary.final_cost);
  EXPECT_EQ(one.placed.positions.frame_center,
            three.placed.positions.frame_center);
  EXPECT_EQ(one.placed.points.point_in_world,
            three.placed.points.point_in_world);
}

// Derivatives against central differences.
TEST(DifferenceCostTest, DerivativesAreThoseOfDifferences) {
  Random random(9);
  const auto any = [&]() -> Eigen::Vector3d {
    return Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  for (int trial = 0; trial < 20; ++trial) {
    double blocks[7];
    for (double& value : blocks) value = random.Normal();
    LinearDifference difference;
    for (double* block : {blocks, blocks + 3}) {
      Eigen::Matrix3d A;
      A << any(), any(), any();
      difference.Add(block, A);
    }
    difference.offset = any();
    const DifferenceCost cost(difference, any(), 0.7);
    const double* parameters[] = {blocks, blocks + 3, blocks + 6};
    double r[3], J0[9], J1[9], J2[3];
    double* jacobians[] = {J0, J1, J2};
    ASSERT_TRUE(cost.Evaluate(parameters, r, jacobians));
    for (int i = 0; i < 7; ++i) {
      constexpr double kStep = 1e-6;
      double plus[3], minus[3];
      const double value = blocks[i];
      blocks[i] = value + kStep;
      cost.Evaluate(parameters, plus, nullptr);
      blocks[i] = value - kStep;
      cost.Evaluate(parameters, minus, nullptr);
      blocks[i] = value;
      for (int k = 0; k < 3; ++k) {
        const double analytic = i < 3   ? J0[3 * k + i]
                                : i < 6 ? J1[3 * k + i - 3]
                                        : J2[k];
        EXPECT_NEAR((plus[k] - minus[k]) / (2.0 * kStep), analytic, 1e-7);
      }
    }
  }
}

}  // namespace
}  // namespace mgsfm
