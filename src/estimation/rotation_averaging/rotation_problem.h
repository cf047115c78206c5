// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "math/graph.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The averaging problem without ids, frames or images: nodes with rotations G_n
// and sensors with rotations S_k, some of them unknown. Nodes are either frames
// of rigs, or single images with one common sensor S = I.

// A measured rotation R of camera 2 (sensor2 at node2) from camera 1.
struct RotationEdge {
  int node1 = 0;
  int node2 = 0;
  int sensor1 = 0;
  int sensor2 = 0;
  Eigen::Quaterniond cam2_from_cam1;
  double support = 1.0;  // number of matches, for the spanning forest
  double weight = 1.0;   // in the objective until outliers are known
  double final_weight = 1.0;
};

// A gravity prior: the direction of gravity, a unit vector in the camera of
// `sensor` at `node`. Gravity in the world is +y.
struct GravityTerm {
  int node = 0;
  int sensor = 0;
  Eigen::Vector3d direction;
};

struct RotationProblem {
  int num_nodes = 0;
  Mask sensor_is_free;  // per sensor: unknown
  std::vector<RotationEdge> edges;
  std::vector<GravityTerm> gravity;
  double gravity_sigma_rad = 1.0;
};

struct RotationState {
  std::vector<Eigen::Quaterniond> nodes;    // G
  std::vector<Eigen::Quaterniond> sensors;  // S
};

// e = Log(R_2^T R R_1) with R_i = S_i G_i, in the world frame, radians.
//
// Derivatives: G <- G Exp(d) moves R_i to R_i Exp(d); S <- S Exp(c) moves it to
// S Exp(c) G = R_i Exp(G^T c). With a_i = d_i + G_i^T c_i then
//
//   e(a) = Log(Exp(-a_2) Exp(e) Exp(a_1)) = e + Jr^-1(e) a_1 - Jl^-1(e) a_2,
//
// Jr and Jl the right and left Jacobians of SO(3), Jl(e) = Jr(-e). The solvers
// replace both by the identity. The gradient of |e|^2 is still exact, because
// Jr^-T(e) e = Jl^-T(e) e = e. The minimum is thus the minimum of the exact
// problem, and the node block of the normal equations is a scalar graph
// Laplacian.
Eigen::Vector3d RotationResidual(const RotationEdge& edge,
                                 const RotationState& state);

// The shortest rotation e of the world that maps the gravity v = (S G)^-1 u of
// a prior u to y: e = angle (v x y) / |v x y|, radians.
//
// If R = S G moves to R Exp(a), a as above, v becomes Exp(-a) v, and to first
// order e becomes e + P a with P = diag(1, 0, 1): rotations about gravity do
// not change it. The gradient of |e|^2 / 2 with respect to a is exactly e.
Eigen::Vector3d GravityResidual(const GravityTerm& term,
                                const RotationState& state);

// Residuals of all edges; in parallel.
void ComputeResiduals(const RotationProblem& problem,
                      const RotationState& state, int num_threads,
                      std::vector<Eigen::Vector3d>* residuals);

std::vector<double> Norms(const std::vector<Eigen::Vector3d>& residuals);

// Connected components of the nodes.
ConnectedComponents FindComponents(const RotationProblem& problem);

// Averaging problems from the pairs of a view graph.

// A problem and, per edge, its pair in the view graph.
struct PairProblem {
  RotationProblem problem;
  std::vector<size_t> pair_idxs;
};

// Per sensor; nullopt: unknown.
using SensorFromRig = std::vector<std::optional<Eigen::Quaterniond>>;

// Nodes are images with one common sensor whose rotation is the identity. With
// the joint strategy, only pairs within a frame are edges.
PairProblem BuildImageProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const RotationAveragingOptions& options);

// Whether a pair has a relative pose and the sensors of both images have a
// rotation.
bool IsUsable(const Scene& scene, const ImagePair& pair,
              const SensorFromRig& sensor_from_rig);

// Nodes are frames. Edges are the usable ones among the used pairs; all sensors
// are fixed.
PairProblem BuildFrameProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const SensorFromRig& sensor_from_rig,
                              const RotationAveragingOptions& options);

// The problem without self-loops.
RotationProblem WithoutLoops(const RotationProblem& problem);

// The problem of the edges whose residual is at most max_error_rad.
PairProblem KeepConsistentEdges(const PairProblem& pairs,
                                const RotationState& state,
                                double max_error_rad);

}  // namespace mgsfm
