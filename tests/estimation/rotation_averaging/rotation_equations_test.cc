// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_equations.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

struct Example {
  RotationProblem problem;
  RotationState state;
};

// A ring of nodes with chords and three sensors, the first of which is held.
Example MakeExample(int num_nodes, double noise, Random* random) {
  Example example;
  for (int i = 0; i < num_nodes; ++i) {
    example.state.nodes.push_back(ExpSO3(NormalVector(random)));
  }
  for (int k = 0; k < 3; ++k) {
    example.state.sensors.push_back(ExpSO3(NormalVector(random)));
  }
  RotationProblem& problem = example.problem;
  problem.num_nodes = num_nodes;
  problem.sensor_is_free = {0, 1, 1};
  for (int i = 0; i < num_nodes; ++i) {
    for (const int gap : {0, 1, 3}) {
      RotationEdge edge;
      edge.node1 = i;
      edge.node2 = (i + gap) % num_nodes;
      edge.sensor1 = static_cast<int>(random->Index(3));
      edge.sensor2 = gap == 0 ? (edge.sensor1 + 1) % 3
                              : static_cast<int>(random->Index(3));
      edge.cam2_from_cam1 = example.state.sensors[edge.sensor2] *
                            example.state.nodes[edge.node2] *
                            (example.state.sensors[edge.sensor1] *
                             example.state.nodes[edge.node1])
                                .conjugate() *
                            ExpSO3(noise * NormalVector(random));
      problem.edges.push_back(edge);
    }
  }
  return example;
}

// The derivatives stated at RotationResidual().
struct RotationJacobians {
  Matrix3d node1, node2, sensor1, sensor2;
};

RotationJacobians RotationResidualJacobians(const RotationEdge& edge,
                                            const RotationState& state) {
  const Vector3d e = RotationResidual(edge, state);
  const Matrix3d by_cam1 = InverseRightJacobianSO3(e);
  const Matrix3d by_cam2 = -InverseRightJacobianSO3(-e);
  const Matrix3d G1 = state.nodes[edge.node1].toRotationMatrix();
  const Matrix3d G2 = state.nodes[edge.node2].toRotationMatrix();
  return {by_cam1, by_cam2, by_cam1 * G1.transpose(), by_cam2 * G2.transpose()};
}

// Central differences of the residual when *rotation moves to rotation Exp(d).
Matrix3d Differentiate(const RotationEdge& edge, RotationState* state,
                       Quaterniond* rotation) {
  constexpr double kStep = 1e-6;
  const Quaterniond original = *rotation;
  Matrix3d jacobian;
  for (int axis = 0; axis < 3; ++axis) {
    *rotation = original * ExpSO3(kStep * Vector3d::Unit(axis));
    const Vector3d plus = RotationResidual(edge, *state);
    *rotation = original * ExpSO3(-kStep * Vector3d::Unit(axis));
    const Vector3d minus = RotationResidual(edge, *state);
    jacobian.col(axis) = (plus - minus) / (2.0 * kStep);
  }
  *rotation = original;
  return jacobian;
}

TEST(RotationResidual, JacobiansAgreeWithDifferences) {
  Random random(1);
  for (const double noise : {0.0, 0.1, 0.8}) {
    Example example = MakeExample(6, noise, &random);
    RotationState& state = example.state;
    for (const RotationEdge& edge : example.problem.edges) {
      if (edge.node1 == edge.node2) continue;
      const RotationJacobians jacobians =
          RotationResidualJacobians(edge, state);
      const auto differentiate = [&](Quaterniond* rotation) {
        return Differentiate(edge, &state, rotation);
      };
      EXPECT_LT(
          (jacobians.node1 - differentiate(&state.nodes[edge.node1])).norm(),
          1e-7);
      EXPECT_LT(
          (jacobians.node2 - differentiate(&state.nodes[edge.node2])).norm(),
          1e-7);
      if (edge.sensor1 == edge.sensor2) {
        EXPECT_LT((jacobians.sensor1 + jacobians.sensor2 -
                   differentiate(&state.sensors[edge.sensor1]))
                      .norm(),
                  1e-7);
        continue;
      }
      EXPECT_LT(
          (jacobians.sensor1 - differentiate(&state.sensors[edge.sensor1]))
              .norm(),
          1e-7);
      EXPECT_LT(
          (jacobians.sensor2 - differentiate(&state.sensors[edge.sensor2]))
              .norm(),
          1e-7);
    }
  }
}

TEST(RotationResidual, JacobiansWithinAFrame) {
  Random random(2);
  Example example = MakeExample(4, 0.3, &random);
  for (const RotationEdge& edge : example.problem.edges) {
    if (edge.node1 != edge.node2) continue;
    const RotationJacobians jacobians =
        RotationResidualJacobians(edge, example.state);
    EXPECT_LT(
        (jacobians.node1 + jacobians.node2 -
         Differentiate(edge, &example.state, &example.state.nodes[edge.node1]))
            .norm(),
        1e-7);
  }
}

// The solver's Jacobians, with Jr and Jl as the identity, give exact gradients.
TEST(RotationResidual, SimplifiedGradientIsExact) {
  Random random(3);
  Example example = MakeExample(6, 0.8, &random);
  for (const RotationEdge& edge : example.problem.edges) {
    const Vector3d e = RotationResidual(edge, example.state);
    const RotationJacobians jacobians =
        RotationResidualJacobians(edge, example.state);
    const Matrix3d G1 =
        example.state.nodes[edge.node1].conjugate().toRotationMatrix();
    EXPECT_LT((jacobians.node1.transpose() * e - e).norm(), 1e-9);
    EXPECT_LT((jacobians.node2.transpose() * e + e).norm(), 1e-9);
    EXPECT_LT((jacobians.sensor1.transpose() * e - G1.transpose() * e).norm(),
              1e-9);
  }
}

// The bordered system against dense least squares with all rows written out.
TEST(RotationEquations, StepAgreesWithDenseLeastSquares) {
  Random random(4);
  const Example example = MakeExample(9, 0.2, &random);
  const RotationProblem& problem = example.problem;
  RotationEquations equations(problem);
  const RotationUnknowns& unknowns = equations.unknowns();
  EXPECT_EQ(unknowns.num_node_columns, 8);
  EXPECT_EQ(unknowns.num_sensor_columns, 2);

  const int num_edges = static_cast<int>(problem.edges.size());
  std::vector<double> weights;
  std::vector<Vector3d> residuals;
  MatrixXd J = MatrixXd::Zero(3 * num_edges, 3 * (8 + 2));
  VectorXd r(3 * num_edges);
  for (int e = 0; e < num_edges; ++e) {
    const RotationEdge& edge = problem.edges[e];
    weights.push_back(random.Uniform(0.1, 2.0));
    residuals.push_back(RotationResidual(edge, example.state));
    const auto add = [&](std::optional<int> column, const Matrix3d& block) {
      if (!column) return;
      J.block<3, 3>(3 * e, 3 * *column) += std::sqrt(weights[e]) * block;
    };
    const auto sensor_column = [&](int sensor) {
      std::optional<int> column = unknowns.column_of_sensor[sensor];
      if (column) *column += 8;
      return column;
    };
    const Matrix3d G1 = example.state.nodes[edge.node1].toRotationMatrix();
    const Matrix3d G2 = example.state.nodes[edge.node2].toRotationMatrix();
    add(unknowns.column_of_node[edge.node1], Matrix3d::Identity());
    add(unknowns.column_of_node[edge.node2], -Matrix3d::Identity());
    add(sensor_column(edge.sensor1), G1.transpose());
    add(sensor_column(edge.sensor2), -G2.transpose());
    r.segment<3>(3 * e) = std::sqrt(weights[e]) * residuals[e];
  }
  const VectorXd expected = J.colPivHouseholderQr().solve(-r);

  RotationStep step;
  ASSERT_TRUE(equations.Solve(weights, residuals, example.state, &step));
  for (int i = 0; i < 8; ++i) {
    EXPECT_LT(
        (step.nodes.row(i).transpose() - expected.segment<3>(3 * i)).norm(),
        1e-7);
  }
  for (int k = 0; k < 2; ++k) {
    EXPECT_LT((step.sensors.col(k) - expected.segment<3>(24 + 3 * k)).norm(),
              1e-7);
  }
}

TEST(RotationEquations, NotFiniteWeightsAreReported) {
  Random random(5);
  const Example example = MakeExample(5, 0.1, &random);
  RotationEquations equations(example.problem);
  std::vector<Vector3d> residuals;
  ComputeResiduals(example.problem, example.state, 1, &residuals);
  std::vector<double> weights(residuals.size(), 1.0);
  weights[4] = std::nan("");
  RotationStep step;
  EXPECT_FALSE(equations.Solve(weights, residuals, example.state, &step));
}

TEST(RotationEquations, OneNodeOfEachPartIsHeld) {
  RotationProblem problem;
  problem.num_nodes = 5;
  problem.sensor_is_free = {0};
  RotationEdge edge;
  edge.cam2_from_cam1 = Quaterniond::Identity();
  edge.node1 = 1;
  edge.node2 = 3;
  problem.edges.push_back(edge);
  edge.node1 = 4;
  edge.node2 = 2;
  problem.edges.push_back(edge);
  const RotationUnknowns unknowns = NumberUnknowns(problem);
  EXPECT_EQ(unknowns.num_node_columns, 2);
  EXPECT_EQ(unknowns.column_of_node,
            (std::vector<std::optional<int>>{std::nullopt, std::nullopt,
                                             std::nullopt, 0, 1}));
}

}  // namespace
}  // namespace mgsfm
