// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/least_squares/backend.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Frame centres c^g and internal translations t^r from known rotations
// (section 3.4 of MGSfM). The centre of image i is c_i = c^g - R_i^T t^r, with
// R_i its cam_from_world. Steps, each with its objective in the header named:
//
// 1. Directions b_ij of the baselines c_j - c_i of pairs, estimated anew with
//    the known rotations (src/translation/relative_translation.h), and ratios
//    of their lengths from points that two pairs see (scale_averaging.h).
// 2. A convex L1 problem in c^g, t^r, by ADMM (position_initialization.h).
// 3. Refinement of angles between b_ij and c_j - c_i (angle_refinement.h).
//    Pairs that contradict its result, as repeated structures make them, are
//    left out from then on (pair_consistency.h).
// 4. Triangulation of the tracks, L1 (mgsfm/geometry/triangulation.h).
// 5. Refinement of the angles between rays and points, over c^g, t^r and
//    points, twice, with re-triangulation between.
//
// Pairs whose matches agree with a rotation alone have no direction; they keep
// their frames together, so frames at standstill are placed.
//
// Gauge: the first placed frame is at the origin. Unit of length: that of the
// given internal translations where they determine it; else the median
// baseline of pairs is about 1.
//
// Cost: linear in matches and observations but for the scale ratios (squared in
// the number of pairs of an image) and the sparse factorisations of step 2
// (3 unknowns a frame), 3 and 5.
//
// That is the input `hybrid` with the objective `non_bilinear`. The others are
// those of the paper's ablation, to compare with:
// - relative_translations: steps 1 to 3; points are triangulated, no more.
// - tracks: no pairs. Frames, points (step 5) and free internal translations
//   start at random (random_start.h), and are solved for once.
// - bilinear: the residuals of steps 3 and 5 with a scale d >= 0 of each as one
//   more unknown, v - d C in place of v - C / |C| (bilinear_refinement.h).
// - distance: steps 1 and 2 alone, which is what MMA does.

enum class TranslationSource {
  kAuto,  // hybrid; of kDistance relative_translations
  kRelativeTranslations,
  kTracks,
  kHybrid,
};

template <>
struct EnumTable<TranslationSource> {
  static constexpr std::pair<std::string_view, TranslationSource> kNames[] = {
      {"auto", TranslationSource::kAuto},
      {"relative_translations", TranslationSource::kRelativeTranslations},
      {"tracks", TranslationSource::kTracks},
      {"hybrid", TranslationSource::kHybrid}};
};

enum class TranslationObjective {
  kAuto,  // non_bilinear
  kDistance,
  kBilinear,
  kNonBilinear,
};

template <>
struct EnumTable<TranslationObjective> {
  static constexpr std::pair<std::string_view, TranslationObjective> kNames[] =
      {{"auto", TranslationObjective::kAuto},
       {"distance", TranslationObjective::kDistance},
       {"bilinear", TranslationObjective::kBilinear},
       {"non_bilinear", TranslationObjective::kNonBilinear}};
};

struct TranslationAveragingOptions {
  TranslationSource input = TranslationSource::kAuto;
  TranslationObjective objective = TranslationObjective::kAuto;
  SolverBackend backend = SolverBackend::kNative;
  double min_parallax_deg = 0.3;
  double max_angle_error_deg = 0.5;
  int max_num_iterations = 50;
  int min_num_points_per_image = 200;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("input", self.input, AnyValue(), "",
          "What positions are estimated from: relative translations of pairs, "
          "tracks from a random start, or both (hybrid); auto: as the method "
          "of the mapper says, else hybrid.");
    visit("objective", self.objective, AnyValue(), "",
          "What is minimised: angles (non_bilinear), the same with a scale for "
          "each observation as unknown (bilinear), or distances alone, which "
          "need relative_translations; auto: as the method of the mapper says, "
          "else non_bilinear.");
    visit("backend", self.backend, AnyValue(), "",
          "Solver of refinements: that of this program, or Ceres with the "
          "same derivatives, for comparison.");
    visit("min_parallax_deg", self.min_parallax_deg, Between(0.0, 60.0), "deg",
          "Matches with less parallax do not vote on relative translations, "
          "nor are points with less used.");
    visit("max_angle_error_deg", self.max_angle_error_deg, GreaterThan(0.0),
          "deg",
          "Largest scale of the robust loss on angles; rays that miss their "
          "point by more than twice of it are not used.");
    visit("max_num_iterations", self.max_num_iterations, AtLeast(1),
          "iterations",
          "Most iterations of the last solve of each refinement.");
    visit("min_num_points_per_image", self.min_num_points_per_image, AtLeast(0),
          "points",
          "Positions are refined with the longest tracks, until each image has "
          "so many; 0 takes all tracks.");
  }
};

// What is known of the internal translation of one sensor.
struct SensorTranslationSummary {
  bool is_observable = true;
  // Dimension of the directions that the data do not determine, 0 to 3; the
  // estimate is zero along them.
  int num_unobservable_directions = 0;
  std::string message;  // which directions were not observable, and why
};

struct TranslationSummary {
  std::vector<SensorTranslationSummary> sensors;
  SolveSummary initialization;     // L1, ADMM
  SolveSummary camera_refinement;  // angles, cameras only
  SolveSummary joint_refinement;   // angles, cameras and points
  int num_pairs_used = 0;          // with a direction
  int num_pairs_without_parallax = 0;
  int num_pairs_inconsistent = 0;  // no motion explains their matches
  int num_pairs_inconsistent_with_positions = 0;  // by direction or length
  int num_scale_groups = 0;  // sets of pairs whose lengths are not comparable
  int num_frames_placed_by_points = 0;
  int num_frames_not_placed = 0;  // though their rotations are known
  size_t num_points = 0;
  bool is_metric = false;  // unit of the given internal translations
};

struct TranslationResult {
  PositionEstimate estimate;
  // Per pair of the view graph: its measured baseline contradicts the estimate.
  Mask pair_is_inconsistent;
  TranslationSummary summary;
};

// Throws Error if options.input and options.objective contradict each other.
void CheckTranslationOptions(const TranslationAveragingOptions& options);

// All frames with a rotation must be in one connected part. Uses the pairs with
// rotations.pair_is_inlier. Points of `tracks` that could not be triangulated
// and frames that could not be placed are nullopt.
[[nodiscard]] TranslationResult AverageTranslations(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const ObservationGroups& tracks,
    const TranslationAveragingOptions& options, const Context& context);

}  // namespace mgsfm
