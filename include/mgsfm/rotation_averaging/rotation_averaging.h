// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Decoupled multi-camera rotation averaging (MGSfM, ICCV 2025, section 3.3).
//
// Measurements: relative rotations R_ij (j from i) of image pairs.
// Unknowns: the rotation G_f of each frame f (rig_from_world) and the rotation
// S_k of each sensor k in its rig (sensor_from_rig) that is not known. With
// image i by sensor k in frame f and j by sensor l in frame g, the model is
//
//   R_i = S_k G_f,   R_ij = R_j R_i^T = S_l G_g G_f^T S_k^T.
//
// Objective: sum_ij w_ij rho(|e_ij|^2) / 2 with e_ij = Log(R_j^T R_ij R_i). rho
// is the loss of Geman and McClure; its scale is annealed from 5 deg to six
// robust standard deviations of e (rotation_solver.h). For n matches, let s =
// min(n, inlier_cap) / inlier_cap. At the last scale, w_ij = s, the inverse
// variance of a correct pair; before, w_ij = sqrt(s), so that strong wrong
// pairs do not outvote the weak correct pairs of a thin cut. Method:
//
// 1. Rotations of single images without regard to rigs: spanning forest, L1
//    averaging, iteratively re-weighted least squares (IRLS).
// 2. S_k as the geodesic L1 median over frames of R_j R_i^T S_i, along a
//    spanning tree of sensors rooted at the known ones. Sensors that share no
//    frame with others in a connected component use hand-eye calibration, A S_k
//    = S_k B, from relative rotations A of the sensor and B of the rig. It
//    fails for a sensor that rotated about less than two axes. Such a sensor is
//    reported, its rotation stays nullopt, and no frame depends on its images.
// 3. Rotations of frames with S_k fixed, by the method of step 1.
// 4. All G_f and S_k jointly, by IRLS.
// 5. Pairs with |e_ij| > max_error_deg are removed, step 4 is repeated, and all
//    pairs are judged again. Frames are numbered by connected component.
//
// Gauge: one rotation of the world for each connected component, fixed by its
// first frame. S_k of reference sensors and known sensors is fixed.
// Stopping criteria of IRLS: max_i |step_i| <= step_tolerance_deg at the final
// scale, or max_num_iterations.
// Cost: one sparse Cholesky factorization of a frames x frames matrix in each
// iteration, with 3 + 9 K right-hand sides for K unknown sensors.
//
// Gravity priors u (unit vectors in the camera) add the terms
// sum_g w_g rho_g(angle((S_k G_f)^T u, y)^2) / 2 to step 4, after each
// component was leveled as a whole. The world then has gravity along +y, and
// its tilt does not grow with the length of the trajectory. w_g is the ratio of
// the variances of e and of the priors; rho_g is the loss of Geman and McClure.
// Priors with errors of more than four standard deviations are reported.
//
// The strategy `joint` replaces steps 1 to 3, as MMA does: S_k starts at the
// median of the relative rotations measured within frames, or at the identity
// if the sensor overlaps with no other; the frames start from a spanning
// forest.
//
// Robust averaging resists wrong pairs that disagree with each other. Duplicate
// structures agree; src/estimation/rotation_averaging/rotation_estimation.h
// combines averaging with the filters of mgsfm/pair_filtering/pair_filtering.h
// against them.
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
  Option<RotationStrategy> strategy{
      "strategy", RotationStrategy::kAuto,
      "Estimate sensor_from_rig rotations first and frames next (decoupled), "
      "or all jointly (joint). auto: joint if the method of the mapper is mma, "
      "else decoupled."};
  Option<double> max_error_deg{
      "max_error_deg", 10.0, Between(0.0, 180.0), "deg",
      "Reject pairs whose relative rotation deviates more from the estimate."};
  // Matches beyond this count do not increase the weight of a pair.
  int inlier_cap = 200;
  // Maximum number of linearizations of L1 averaging.
  int max_num_l1_iterations = 5;
  // Maximum number of iterations of re-weighted least squares.
  int max_num_iterations = 100;
  // Iterations stop when no rotation changes by more than this angle.
  double step_tolerance_deg = 5e-5;
  // A sensor without overlap is unobservable if its rotations about a second
  // axis have a smaller root mean square.
  double min_hand_eye_rotation_deg = 3.0;
  // Standard deviation of gravity priors. It is increased if errors are larger.
  double gravity_sigma_deg = 1.0;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(strategy, max_error_deg);
  }
};

// The estimated sensor_from_rig rotation of one sensor.
struct SensorRotationSummary {
  int num_samples = 0;                         // frames that contributed
  std::optional<double> median_deviation_deg;  // of the samples
  bool is_observable = false;
  std::string message;  // how it was estimated, or why it was not

  auto Fields() const {
    return Named("is_observable", is_observable, "num_samples", num_samples,
                 "median_deviation_deg", median_deviation_deg, "message",
                 message);
  }
};

struct RotationSummary {
  std::vector<SensorRotationSummary> sensors;  // per sensor
  SolveSummary images;                         // step 1
  SolveSummary frames;                         // step 3
  SolveSummary joint;                          // step 4, last run
  int num_pairs_without_rotation = 0;          // no relative pose
  int num_pairs_unobservable = 0;   // unknown sensor_from_rig rotation
  int num_pairs_dropped = 0;        // all other pairs that are not inliers
  int num_unsupported_bridges = 0;  // dropped unsupported bridges
  int num_components = 0;           // connected components of frames
  std::optional<double> median_error_deg;  // of the pairs kept by step 5
  std::optional<GravitySummary> gravity;   // if there are priors

  // The fields that are not per sensor.
  auto Fields() const {
    return Named("gravity", gravity, "images", images, "frames", frames,
                 "joint", joint, "num_components", num_components,
                 "median_error_deg", median_error_deg, "dropped",
                 Named("without_relative_rotation", num_pairs_without_rotation,
                       "of_unobservable_sensors", num_pairs_unobservable,
                       "inconsistent", num_pairs_dropped, "unsupported_bridges",
                       num_unsupported_bridges));
  }
};

struct RotationResult {
  RotationEstimate estimate;
  RotationSummary summary;
};

struct RotationAveragingInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const Mask& pair_is_used;
  // Initial rotations of the frames that it contains; L1 averaging is then
  // skipped. May be null.
  const RotationEstimate* start = nullptr;
  const GravityPriors& gravity = kNoGravity;
};

// Averages the relative rotations of the used pairs, once. Throws Error if no
// used pair has a relative pose.
[[nodiscard]] RotationResult AverageRotations(
    const RotationAveragingInput& input,
    const RotationAveragingOptions& options, const Context& context);

}  // namespace mgsfm
