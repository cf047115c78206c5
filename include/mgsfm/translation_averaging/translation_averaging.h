// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Translation averaging: frame centers c^g and translations t^r of
// sensor_from_rig from known rotations (section 3.4 of MGSfM). The center of
// image i is c_i = c^g - R_i^T t^r, with R_i its cam_from_world. Stages, each
// with its objective in the header named:
//
// 1. Directions b_ij of the baselines c_j - c_i of pairs, estimated again with
//    the known rotations
//    (src/estimation/translation_averaging/baseline_directions.h), and ratios
//    of their lengths from points that two pairs see (scale_averaging.h).
// 2. A convex L1 problem in c^g and t^r, by ADMM (position_initialization.h).
// 3. Refinement of the angles between b_ij and c_j - c_i
//    (translation_stages.h).
// 4. Triangulation of the tracks, L1 (geometry/triangulation.h).
// 5. Refinement of the angles between rays and points, over c^g, t^r and
//    points, twice, with another triangulation in between.
//
// Pairs whose matches agree with a rotation alone have no direction; they keep
// their frames together, so that frames at standstill are placed.
//
// Gauge: the first placed frame is at the origin. Unit of length: given by the
// known sensor translations if the data determine it; otherwise the median
// baseline of pairs is about 1.
//
// Cost: linear in matches and observations, except for the scale ratios, which
// are quadratic in the pairs of an image, and the sparse factorizations of
// stages 2 (3 unknowns per frame), 3 and 5.

struct TranslationAveragingOptions {
  // Solver of the refinements. kCeres uses the same derivatives and serves as a
  // reference.
  SolverBackend backend = SolverBackend::kNative;
  // Smallest parallax of matches that determine relative translations, and of
  // points. Decrease it for small baselines and precise keypoints.
  double min_parallax_deg = 0.3;
  // Largest scale of the robust loss on angles. Rays that miss their point by
  // more than twice this angle are rejected.
  double max_angle_error_deg = 0.5;
  // Of the last solve of each refinement.
  int max_num_iterations = 50;
  // Positions are refined with the longest tracks until each image has this
  // many observations. 0 uses all tracks, which takes longer.
  int min_num_points_per_image = 200;

  template <class Visitor>
  void Describe(Visitor&) {}
};

// Estimate of the translation of sensor_from_rig of one sensor.
struct SensorTranslationSummary {
  bool is_observable = true;
  // Dimension of the subspace that the data do not determine, 0 to 3; the
  // estimate is zero in it.
  int num_unobservable_directions = 0;
  std::string message;  // which directions are not observable, and why

  auto Fields() const {
    return Named("is_observable", is_observable, "message", message);
  }
};

struct TranslationSummary {
  std::vector<SensorTranslationSummary> sensors;
  SolveSummary initialization;     // L1, ADMM
  SolveSummary camera_refinement;  // angles, cameras only
  SolveSummary joint_refinement;   // angles, cameras and points
  int num_pairs_used = 0;          // with a direction
  int num_pairs_without_parallax = 0;
  int num_pairs_inconsistent = 0;  // no direction explains their matches
  int num_pairs_inconsistent_with_positions = 0;  // by direction or length
  // Relative motions of adjacent frames that nearly all pairs of neighbors
  // contradict.
  int num_displaced_steps = 0;
  // The number of rotation corrections because of such motions.
  int num_rotation_corrections = 0;
  int num_scale_groups = 0;  // sets of pairs whose lengths are not comparable
  int num_frames_placed_by_points = 0;
  int num_frames_not_placed = 0;  // frames with known rotation
  size_t num_points = 0;
  bool is_metric = false;  // in the unit of the known sensor offsets

  // The fields that are not per sensor.
  auto Fields() const {
    return Named("initialization", initialization, "camera_refinement",
                 camera_refinement, "joint_refinement", joint_refinement,
                 "num_pairs_used", num_pairs_used, "num_pairs_without_parallax",
                 num_pairs_without_parallax, "num_pairs_inconsistent",
                 num_pairs_inconsistent,
                 "num_pairs_inconsistent_with_positions",
                 num_pairs_inconsistent_with_positions, "num_displaced_steps",
                 num_displaced_steps, "num_rotation_corrections",
                 num_rotation_corrections, "num_points", num_points);
  }
};

struct TranslationResult {
  PositionEstimate estimate;
  TranslationSummary summary;
};

struct TranslationAveragingInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const RotationEstimate& rotations;
  const ObservationGroups& tracks;
};

struct
    TranslationHooks;  // src/estimation/translation_averaging/translation_stages.h

// Averages once. Trusts all pairs with rotations.pair_is_inlier, unless hooks
// reject some: those of the mapper filter pairs by their baselines
// (src/estimation/translation_averaging/position_estimation.h). All frames with
// a rotation must be in one connected component. Frames that could not be
// placed and points of `tracks` that could not be triangulated are nullopt.
[[nodiscard]] TranslationResult AverageTranslations(
    const TranslationAveragingInput& input,
    const TranslationAveragingOptions& options, const Context& context,
    const TranslationHooks* hooks = nullptr);

}  // namespace mgsfm
