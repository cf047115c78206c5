// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/priors/prior_summaries.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Decoupled multi-camera rotation averaging (MGSfM, ICCV 2025, section 3.3).
//
// Measured is the relative rotation R_ij (j from i) of image pairs. With S_k
// the internal rotation of sensor k (sensor_from_rig) and G_f the rotation of
// frame f (rig_from_world), an image has R_i = S_k G_f, and the model is
//
//   R_ij = S_l G_g G_f^T S_k^T,     i by sensor k in frame f, j by l in g.
//
// Minimised is  sum_ij w_ij rho(|e_ij|^2) / 2,  e_ij = Log(R_j^T R_ij R_i),
// over all G_f and all S_k that are not known beforehand, in five steps:
//
// 1. All images alone: R_i from pairs (spanning forest, L1, re-weighted least
//    squares).
// 2. S_k as the geodesic L1 median over frames of R_j R_i^T S_i, along a
//    spanning tree over sensors rooted at the known ones; sensors in no common
//    frame of one connected part by hand-eye calibration (A S_k = S_k B from
//    relative rotations A of its own part and B of the rig). A sensor whose
//    images turned about less than two axes is not observable that way; it is
//    reported and keeps nullopt, and so do no images depend on it.
// 3. All frames with S_k held fixed, by the method of step 1.
// 4. All G_f and S_k together (exact coefficients).
// 5. Pairs with |e_ij| > max_error_deg are dropped, connectivity is checked
//    anew, step 4 is repeated on the pairs kept, and all pairs are judged
//    again. Of these, pairs of two frames that alone join two parts are left
//    out where others contradict them and no third image confirms them
//    (rotation/unsupported_bridges.h): the parts stay apart, with a warning.
//
// Weights: w_ij = sqrt(min(n, inlier_cap) / inlier_cap) with n matches.
// rho: Geman-McClure, its scale lowered from 5 deg to six robust standard
// deviations of e. Gauge: one rotation of the world for each connected part,
// held by its first frame; S of reference and known sensors is held.
// Stopping rules of all re-weighted loops: max_i |step_i| <= step_tolerance_deg
// at the final scale (converged), or max_num_iterations.
// Cost: a sparse Cholesky factorisation of a frames x frames matrix in each
// iteration, with 3 + 9 K right-hand sides for K unknown sensors.
//
// With the direction of gravity measured in images, u in the camera, step 4
// also minimises sum_g w_g rho_g(angle((S_k G_f)^T u, y)^2) / 2, after every
// part was levelled as a whole: worlds have gravity along +y, and do not tilt,
// how long ever the chain of frames is. w_g is the ratio of the variances of e
// and of gravity; rho_g: Geman-McClure. What is off in the end by more than
// four standard deviations is listed as an outlier.
//
// That is the strategy `decoupled`. `joint` (as MMA has it) does without images
// alone: S_k starts at the median of the relative rotations measured inside
// frames, or at the identity where the sensors share no view; the frames
// start by a spanning forest; and step 4 does the rest.
enum class RotationStrategy {
  kAuto,  // decoupled
  kDecoupled,
  kJoint,
};

template <>
struct EnumTable<RotationStrategy> {
  static constexpr std::pair<std::string_view, RotationStrategy> kNames[] = {
      {"auto", RotationStrategy::kAuto},
      {"decoupled", RotationStrategy::kDecoupled},
      {"joint", RotationStrategy::kJoint}};
};

struct RotationAveragingOptions {
  RotationStrategy strategy = RotationStrategy::kAuto;
  double max_error_deg = 10.0;
  int inlier_cap = 200;
  int max_num_l1_iterations = 5;
  int max_num_iterations = 100;
  double step_tolerance_deg = 5e-5;
  double min_hand_eye_rotation_deg = 3.0;
  double gravity_sigma_deg = 1.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("strategy", self.strategy, AnyValue(), "",
          "Internal rotations first and then frames (decoupled), or all at "
          "once (joint); auto: as the method of the mapper says, else "
          "decoupled.");
    visit("max_error_deg", self.max_error_deg, Between(0.0, 180.0), "deg",
          "Pairs whose relative rotation differs more are dropped.");
    visit("inlier_cap", self.inlier_cap, AtLeast(1), "matches",
          "Matches beyond so many do not raise the weight of a pair.");
    visit("max_num_l1_iterations", self.max_num_l1_iterations, AtLeast(0),
          "iterations", "Most linearisations of the L1 step.");
    visit("max_num_iterations", self.max_num_iterations, AtLeast(1),
          "iterations", "Most iterations of re-weighted least squares.");
    visit("step_tolerance_deg", self.step_tolerance_deg, GreaterThan(0.0),
          "deg", "Iterations end when no rotation changes by more.");
    visit("min_hand_eye_rotation_deg", self.min_hand_eye_rotation_deg,
          Between(0.0, 90.0), "deg",
          "Turns about a second axis (root mean square) below which a sensor "
          "that shares no view with the others counts as unobservable.");
    visit("gravity_sigma_deg", self.gravity_sigma_deg, GreaterThan(0.0), "deg",
          "Standard deviation of measured directions of gravity; if they are "
          "worse, that is noticed.");
  }
};

// What is known of the internal rotation of one sensor.
struct SensorRotationSummary {
  int num_samples = 0;                         // frames that gave one
  std::optional<double> median_deviation_deg;  // of the samples
  bool is_observable = false;
  std::string message;  // how it was found, or why it was not, in words
};

struct RotationSummary {
  std::vector<SensorRotationSummary> sensors;  // per sensor
  SolveSummary images;                         // single-image averaging
  SolveSummary frames;                         // rigid-unit averaging
  SolveSummary joint;                          // joint refinement, the last
  int num_pairs_without_rotation = 0;          // no relative pose: never used
  int num_pairs_unobservable = 0;  // of sensors without internal rotation
  int num_pairs_dropped = 0;       // of all others: not consistent
  // Of these: would alone join two parts, but see
  // rotation/unsupported_bridges.h.
  int num_unsupported_bridges = 0;
  int num_components = 0;                  // connected parts of the result
  std::optional<double> median_error_deg;  // of the pairs kept
  std::optional<GravitySummary> gravity;   // if it was measured
};

struct RotationResult {
  RotationEstimate estimate;
  RotationSummary summary;
};

[[nodiscard]] RotationResult AverageRotations(
    const Scene& scene, const ViewGraph& view_graph,
    const RotationAveragingOptions& options, const Context& context,
    const GravityPriors& gravity = {});

}  // namespace mgsfm
