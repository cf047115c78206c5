// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "base/random.h"
#include "geometry/so3.h"
#include "georegistration/world_frame.h"
#include "math/random_vector.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/simulator/simulation.h"
#include "rotation_averaging/rotation_solver.h"
#include "support/prior_measurement.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

// A chain of nodes with two sensors, of which the second is free, and gravity
// in some of them.
struct Example {
  RotationProblem problem;
  RotationState state;
};

Example MakeExample(double noise) {
  Random random(3);
  Example example;
  constexpr int kNumNodes = 6;
  for (int i = 0; i < kNumNodes; ++i) {
    example.state.nodes.push_back(ExpSO3(NormalVector(&random)));
  }
  for (int k = 0; k < 2; ++k) {
    example.state.sensors.push_back(ExpSO3(NormalVector(&random)));
  }
  RotationProblem& problem = example.problem;
  problem.num_nodes = kNumNodes;
  problem.sensor_is_free = {0, 1};
  const auto rotation = [&](int sensor, int node) {
    return example.state.sensors[sensor] * example.state.nodes[node];
  };
  for (int i = 0; i + 1 < kNumNodes; ++i) {
    for (const int sensor : {0, 1}) {
      RotationEdge edge;
      edge.node1 = i;
      edge.node2 = i + 1;
      edge.sensor1 = sensor;
      edge.sensor2 = i % 2;
      edge.cam2_from_cam1 = rotation(i % 2, i + 1) *
                            rotation(sensor, i).conjugate() *
                            ExpSO3(noise * NormalVector(&random));
      problem.edges.push_back(edge);
    }
  }
  for (const int node : {1, 2, 4}) {
    const int sensor = node % 2;
    problem.gravity.push_back(
        {node, sensor,
         rotation(sensor, node) *
             (ExpSO3(noise * NormalVector(&random)) * Vector3d::UnitY())});
  }
  return example;
}

TEST(GravityResidual, TurnsGravityToY) {
  Example example = MakeExample(0.5);
  for (const GravityTerm& term : example.problem.gravity) {
    const Vector3d v =
        (example.state.sensors[term.sensor] * example.state.nodes[term.node])
            .conjugate() *
        term.direction;
    const Vector3d e = GravityResidual(term, example.state);
    EXPECT_LT((ExpSO3(e) * v - Vector3d::UnitY()).norm(), 1e-12);
    EXPECT_EQ(e.y(), 0.0);
    EXPECT_NEAR(e.norm(), AngleBetween(v, Vector3d(0.0, 1.0, 0.0)), 1e-12);
  }
  GravityTerm upside_down = example.problem.gravity[0];
  upside_down.direction =
      -(example.state.sensors[1] * example.state.nodes[1] * Vector3d::UnitY());
  EXPECT_NEAR(GravityResidual(upside_down, example.state).norm(), kPi, 1e-6);
}

// The gradient of |e|^2 / 2 by rotations of the node is exactly e.
TEST(GravityResidual, GradientAgreesWithDifferences) {
  Example example = MakeExample(0.5);
  for (const GravityTerm& term : example.problem.gravity) {
    const Vector3d e = GravityResidual(term, example.state);
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kStep = 1e-6;
      double cost[2];
      for (int side = 0; side < 2; ++side) {
        RotationState moved = example.state;
        Quaterniond& G = moved.nodes[term.node];
        G = G * ExpSO3((side == 0 ? -kStep : kStep) * Vector3d::Unit(axis));
        cost[side] = 0.5 * GravityResidual(term, moved).squaredNorm();
      }
      EXPECT_NEAR((cost[1] - cost[0]) / (2.0 * kStep), e[axis], 1e-8);
    }
  }
}

// A step against dense least squares with the rotation of the first node about
// gravity held.
TEST(RotationEquations, StepWithGravityAgreesWithDenseLeastSquares) {
  const Example example = MakeExample(0.1);
  const RotationProblem& problem = example.problem;
  const RotationState& state = example.state;
  const int num_nodes = problem.num_nodes;
  const int num_rows = static_cast<int>(3 * problem.edges.size() +
                                        3 * problem.gravity.size() + 1);
  MatrixXd A = MatrixXd::Zero(num_rows, 3 * num_nodes + 3);
  VectorXd b = VectorXd::Zero(num_rows);
  std::vector<Vector3d> residuals;
  std::vector<double> weights;
  GravityValues gravity;
  const Matrix3d P = Vector3d(1.0, 0.0, 1.0).asDiagonal();
  const auto add = [&](int row, int node, int sensor, const Matrix3d& factor) {
    A.block<3, 3>(row, 3 * node) += factor;
    if (sensor == 0) return;
    A.block<3, 3>(row, 3 * num_nodes) +=
        factor * state.nodes[node].conjugate().toRotationMatrix();
  };
  int row = 0;
  for (const RotationEdge& edge : problem.edges) {
    residuals.push_back(RotationResidual(edge, state));
    weights.push_back(0.5 + 0.1 * static_cast<double>(weights.size()));
    const double root = std::sqrt(weights.back());
    add(row, edge.node1, edge.sensor1, root * Matrix3d::Identity());
    add(row, edge.node2, edge.sensor2, -root * Matrix3d::Identity());
    b.segment<3>(row) = -root * residuals.back();
    row += 3;
  }
  for (const GravityTerm& term : problem.gravity) {
    gravity.residuals.push_back(GravityResidual(term, state));
    gravity.weights.push_back(0.3);
    const double root = std::sqrt(0.3);
    add(row, term.node, term.sensor, root * P);
    b.segment<3>(row) = -root * gravity.residuals.back();
    row += 3;
  }
  A(row, 1) = 1.0;
  const VectorXd expected = A.colPivHouseholderQr().solve(b);
  RotationEquations equations(problem);
  RotationStep step;
  ASSERT_TRUE(equations.Solve(weights, residuals, state, &step, gravity));
  ASSERT_EQ(step.nodes.rows(), num_nodes);
  for (int i = 0; i < num_nodes; ++i) {
    EXPECT_LT(
        (step.nodes.row(i).transpose() - expected.segment<3>(3 * i)).norm(),
        1e-8);
  }
  EXPECT_LT((step.sensors.col(0) - expected.tail<3>()).norm(), 1e-8);
}

// Few, noisy pairs: a chain that drifts.
Simulation WeakDrive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kCurve;
  options.num_frames = 150;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 60;
  options.num_matched_frames = 1;
  options.relative_rotation_noise_deg = 0.4;
  return Simulate(options);
}

// The largest error of roll and pitch: that of the direction of gravity in
// frames, in the world as it is (is_level) or aligned with the first frame.
double MaxTiltDeg(const Simulation& simulation,
                  const RotationEstimate& estimate, bool is_level) {
  double most = 0.0;
  Vector3d down = Vector3d::UnitY();
  for (size_t f = 0; f < estimate.rig_from_world.size(); ++f) {
    const Vector3d true_down =
        simulation.ground_truth.rig_from_world[f]->rotation * Vector3d::UnitY();
    const Vector3d in_world =
        estimate.rig_from_world[f]->conjugate() * true_down;
    if (f == 0 && !is_level) down = in_world;
    most = std::max(most, RadToDeg(AngleBetween(down, in_world)));
  }
  return most;
}

RotationResult Average(const Simulation& simulation,
                       const GravityPriors& gravity) {
  return AverageRotations(
      {simulation.scene, simulation.view_graph,
       Mask(simulation.view_graph.pairs.size(), true), nullptr, gravity},
      {}, {});
}

TEST(Gravity, KeepsAWeakChainLevel) {
  for (const RigPreset rig : {RigPreset::kMono, RigPreset::kStereo}) {
    const Simulation simulation = WeakDrive(rig);
    const GravityPriors gravity = MeasuredGravity(simulation, 0.5, 0.1);
    const auto average = [&](const GravityPriors& used) {
      return Average(simulation, used);
    };
    const RotationResult without = average({});
    const RotationResult with = average(gravity);
    EXPECT_FALSE(without.summary.gravity.has_value());
    ASSERT_TRUE(with.summary.gravity.has_value());
    const double tilt_without = MaxTiltDeg(simulation, without.estimate, false);
    const double tilt_with = MaxTiltDeg(simulation, with.estimate, true);
    EXPECT_GT(tilt_without, 2.0);
    EXPECT_LT(tilt_with, 2.0);
    EXPECT_LT(tilt_with, 0.5 * tilt_without);
    EXPECT_EQ(with.summary.gravity->num_priors, 150);
    EXPECT_LT(*with.summary.gravity->median_error_deg, 1.0);
  }
}

TEST(Gravity, OutliersAreFound) {
  const Simulation simulation = WeakDrive(RigPreset::kStereo);
  const GravityPriors gravity = MeasuredGravity(simulation, 0.5, 0.1);
  const GravitySummary summary = *Average(simulation, gravity).summary.gravity;
  Mask is_listed(gravity.images.size(), false);
  for (const auto& outlier : summary.outliers) {
    is_listed[outlier.image_idx] = true;
  }
  int num_wrong = 0;
  for (size_t i = 0; i < gravity.images.size(); ++i) {
    if (!gravity.images[i]) continue;
    const Vector3d down =
        simulation.cam_from_world[i].rotation * Vector3d::UnitY();
    const double error_deg = RadToDeg(AngleBetween(*gravity.images[i], down));
    num_wrong += error_deg > 6.0;
    if (error_deg > 6.0) {
      EXPECT_TRUE(is_listed[i]) << error_deg;
    } else if (error_deg < 2.0) {
      EXPECT_FALSE(is_listed[i]) << error_deg;
    }
  }
  EXPECT_GE(num_wrong, 8);
}

// Gravity measured by a camera that is not the reference and whose pose in the
// rig is unknown.
TEST(Gravity, OfAnyCameraHelps) {
  const Simulation simulation = WeakDrive(RigPreset::kStereo);
  GravityPriors gravity = MeasuredGravity(simulation, 0.5, 0.0);
  for (const Frame& frame : simulation.scene.frames) {
    for (const int image_idx : frame.image_idxs) {
      const bool is_second = simulation.scene.images[image_idx].sensor_idx == 1;
      gravity.images[image_idx].reset();
      if (!is_second) continue;
      gravity.images[image_idx] =
          simulation.cam_from_world[image_idx].rotation * Vector3d::UnitY();
    }
  }
  const RotationResult result = Average(simulation, gravity);
  EXPECT_LT(MaxTiltDeg(simulation, result.estimate, true), 1.5);
}

}  // namespace
}  // namespace mgsfm
