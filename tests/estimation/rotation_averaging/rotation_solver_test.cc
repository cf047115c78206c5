// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_solver.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"
#include "rotation_averaging/rotation_initialization.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

struct Example {
  RotationProblem problem;
  RotationState truth;
};

// A ring of nodes seen by one sensor; some edges are off by `outlier_rad`.
Example MakeRing(int num_nodes, double noise_rad, double outlier_ratio,
                 double outlier_rad, Random* random) {
  Example example;
  example.truth.sensors = {Quaterniond::Identity()};
  example.problem.num_nodes = num_nodes;
  example.problem.sensor_is_free = {0};
  for (int i = 0; i < num_nodes; ++i) {
    example.truth.nodes.push_back(ExpSO3(NormalVector(random)));
  }
  for (int i = 0; i < num_nodes; ++i) {
    for (const int gap : {1, 2, 3, 5}) {
      RotationEdge edge;
      edge.node1 = i;
      edge.node2 = (i + gap) % num_nodes;
      const bool is_wrong = random->Uniform() < outlier_ratio;
      edge.cam2_from_cam1 =
          example.truth.nodes[edge.node2] *
          ExpSO3(is_wrong ? outlier_rad * NormalVector(random).normalized()
                          : noise_rad * NormalVector(random)) *
          example.truth.nodes[edge.node1].conjugate();
      example.problem.edges.push_back(edge);
    }
  }
  return example;
}

// The largest error after aligning the worlds at the node that suits best.
double MaxErrorDeg(const RotationState& state, const RotationState& truth) {
  double best = 180.0;
  for (size_t ref = 0; ref < truth.nodes.size(); ++ref) {
    const Quaterniond world = truth.nodes[ref].conjugate() * state.nodes[ref];
    double max = 0.0;
    for (size_t i = 0; i < truth.nodes.size(); ++i) {
      max = std::max(max, AngleBetween(state.nodes[i], truth.nodes[i] * world));
    }
    best = std::min(best, RadToDeg(max));
  }
  return best;
}

TEST(InitializeNodes, ChainsExactRotations) {
  Random random(1);
  const Example example = MakeRing(30, 0.0, 0.0, 0.0, &random);
  RotationState state{{}, example.truth.sensors};
  InitializeNodes(example.problem, 0.1, {}, &state);
  EXPECT_LT(MaxErrorDeg(state, example.truth), 1e-9);
}

TEST(InitializeNodes, ParallelEdgesOutvoteAStrongWrongOne) {
  RotationProblem problem;
  problem.num_nodes = 2;
  problem.sensor_is_free = {0};
  const Quaterniond truth = ExpSO3({0.2, 0.1, -0.4});
  for (int i = 0; i < 3; ++i) {
    RotationEdge edge;
    edge.node1 = i % 2;
    edge.node2 = 1 - i % 2;
    edge.cam2_from_cam1 = i % 2 == 0 ? truth : truth.conjugate();
    problem.edges.push_back(edge);
  }
  problem.edges[1].cam2_from_cam1 = ExpSO3({1.0, 1.0, 1.0});
  problem.edges[1].support = 1000.0;
  RotationState state{{}, {Quaterniond::Identity()}};
  InitializeNodes(problem, 0.1, {}, &state);
  EXPECT_LT(AngleBetween(state.nodes[1] * state.nodes[0].conjugate(), truth),
            1e-9);
}

TEST(InitializeNodes, WhatIsKnownGoesBeforeEdges) {
  Random random(3);
  const Example example = MakeRing(12, 0.0, 0.0, 0.0, &random);
  // Two components, each in its own world; one node is unknown.
  NodeStart start;
  for (int i = 0; i < 12; ++i) {
    const Quaterniond world = ExpSO3({0.1 * (i / 6), 0.2, 0.3});
    start.rotations.emplace_back(example.truth.nodes[i] * world);
    start.components.emplace_back(i / 6);
  }
  start.rotations[3].reset();
  start.components[3].reset();
  RotationProblem wrong = example.problem;
  for (RotationEdge& edge : wrong.edges) {
    if (start.Knows(edge.node1, edge.node2)) {
      edge.cam2_from_cam1 = ExpSO3({1.0, 0.0, 0.0});
    }
  }
  RotationState state{{}, example.truth.sensors};
  InitializeNodes(wrong, 0.1, start, &state);
  EXPECT_LT(MaxErrorDeg(state, example.truth), 1e-9);
}

// The images of two sensors that do not overlap are two parts, which loops
// join.
TEST(InitializeNodes, PartsAreJoinedByMostPairsBetweenThem) {
  Random random(4);
  Example example = MakeRing(20, 0.0, 0.0, 0.0, &random);
  NodeStart start;
  for (int i = 0; i < 20; ++i) {
    const Quaterniond world = ExpSO3({0.7 * (i / 10), 0.2, 0.3});
    start.rotations.emplace_back(example.truth.nodes[i] * world);
    start.components.emplace_back(i / 10);
  }
  int num_between = 0, num_wrong = 0;
  for (RotationEdge& edge : example.problem.edges) {
    if (start.Knows(edge.node1, edge.node2) || num_between++ % 3 != 0) continue;
    edge.cam2_from_cam1 = ExpSO3(NormalVector(&random)) * edge.cam2_from_cam1;
    edge.support = 1000.0;
    ++num_wrong;
  }
  ASSERT_GT(num_wrong, 5);
  RotationState state{{}, example.truth.sensors};
  InitializeNodes(example.problem, 0.1, start, &state);
  EXPECT_LT(MaxErrorDeg(state, example.truth), 1e-6);
}

// Small outliers are where an L1 step with a fixed penalty does nothing.
TEST(AverageL1, RejectsSmallOutliersThatLeastSquaresDoesNot) {
  for (const double outlier_deg : {0.5, 6.0, 60.0}) {
    Random random(2);
    const Example example =
        MakeRing(40, 0.0, 0.15, DegToRad(outlier_deg), &random);
    RotationState state = example.truth;
    for (Quaterniond& node : state.nodes) {
      node = node * ExpSO3(DegToRad(outlier_deg) * 0.3 * NormalVector(&random));
    }
    const SolveSummary summary = AverageL1(
        example.problem, RotationAveragingOptions(), Context(), &state);
    EXPECT_TRUE(summary.IsUsable());
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    EXPECT_LT(MaxErrorDeg(state, example.truth), 0.05 * outlier_deg);
  }
}

TEST(AverageRobust, IsExactWithWrongEdgesButNoNoise) {
  Random random(3);
  const Example example = MakeRing(60, 0.0, 0.3, 1.0, &random);
  RotationState state{{}, example.truth.sensors};
  const SolveSummary summary = AverageNodes(
      example.problem, {}, RotationAveragingOptions(), Context(), &state);
  EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
  EXPECT_LE(summary.final_cost, summary.initial_cost);
  EXPECT_LT(MaxErrorDeg(state, example.truth), 1e-6);
}

TEST(AverageRobust, ThreadsDoNotChangeTheResult) {
  Random random(4);
  const Example example = MakeRing(3000, 0.01, 0.1, 1.0, &random);
  std::vector<RotationState> states;
  for (const int num_threads : {1, 3}) {
    Context context;
    context.num_threads = num_threads;
    RotationState state{{}, example.truth.sensors};
    ASSERT_TRUE(AverageNodes(example.problem, {}, RotationAveragingOptions(),
                             context, &state)
                    .IsUsable());
    states.push_back(state);
  }
  for (size_t i = 0; i < states[0].nodes.size(); ++i) {
    EXPECT_EQ(states[0].nodes[i].coeffs(), states[1].nodes[i].coeffs());
  }
}

TEST(RobustScaleSchedule, FallsToTheNoiseAndStays) {
  RobustScaleSchedule schedule;
  const std::vector<double> norms(10, DegToRad(0.1));
  double last = schedule.Next(norms).scale;
  EXPECT_GE(last, DegToRad(5.0) * (1 - 1e-12));
  while (!schedule.IsFinal()) {
    const double scale = schedule.Next(norms).scale;
    EXPECT_LT(scale, last);
    last = scale;
  }
  EXPECT_LT(last, DegToRad(0.5));
  EXPECT_EQ(schedule.Next({1.0}).scale, last);
}

}  // namespace
}  // namespace mgsfm
