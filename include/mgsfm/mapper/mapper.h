// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/incremental/incremental_mapping.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/input_check/kept_matches.h"
#include "mgsfm/lenses/lenses.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/seams/confidence.h"
#include "mgsfm/soft_rig/rig_delays.h"
#include "mgsfm/soft_rig/rig_difference.h"
#include "mgsfm/soft_rig/soft_rig.h"
#include "mgsfm/tracks/track_establishment.h"
#include "mgsfm/translation_averaging/translation_averaging.h"
#include "mgsfm/view_graph/focal_length_calibration.h"
#include "mgsfm/view_graph/view_graph_estimation.h"

namespace mgsfm {

// The mapper estimates rig-consistent models from verified matches.
//
//   focal lengths -> view graph -> rotations
//       once, for all images together
//   -> tracks -> positions -> bundle adjustment
//       for each connected component of the view graph
//
// All components share the rotations of sensors in their rigs. A component of
// at least `min_num_frames` frames becomes a model with a world frame of its
// own. The rig and the intrinsics of the largest component, with their
// covariances, are priors for the others. They also define the unit of length
// of the others, unless no baseline of the rig is determined. Models of fewer
// than `min_model_size` images are dropped, as in COLMAP, except the largest
// model: small components are often wrong.

// Treatment of the weak seams of a model (mgsfm/seams/confidence.h).
enum class WeakSeams {
  kKeep,        // seams are reported; a model is split only at seams that no
                // point crosses, because the relative pose of their sides is
                // undetermined
  kSplitJumps,  // the model is also split at jumps, which contradict the motion
                // of the rig
  kSplit,       // the model is split at all seams
};

template <>
struct EnumTable<WeakSeams> {
  static constexpr std::pair<std::string_view, WeakSeams> kNames[] = {
      {"keep", WeakSeams::kKeep},
      {"split_jumps", WeakSeams::kSplitJumps},
      {"split", WeakSeams::kSplit}};
};

struct MapperOptions {
  Option<int> min_num_frames{
      "min_num_frames", 3, AtLeast(2), "frames",
      "Reconstruct only connected components of at least this many frames."};
  Option<int> min_model_size{"Mapper.min_model_size", 10, AtLeast(1), "images",
                             "Write only models of at least this many images, "
                             "and always the largest one."};
  Option<bool> compute_covariances{
      "compute_covariances", false,
      "Compute the covariances of the poses of sensors in their rig and of "
      "frames, and write them to covariances.csv next to each model."};

  Option<std::string> metric_scale{
      "metric_scale", "",
      "Scale models by the known distance of two cameras of a rig, given as "
      "known_baseline=CAMERA1:CAMERA2:METERS. It is not needed with a known "
      "rig or measured positions."};
  Option<bool> estimate_antenna{
      "estimate_antenna", false,
      "Estimate where the antenna of the positions is, starting from its place "
      "in body_calibration, and use it. The rig must turn and change its "
      "speed."};
  Option<WeakSeams> weak_seams{
      "Mapper.weak_seams", WeakSeams::kKeep,
      "Choose what happens at the weak seams of a model: keep reports them, "
      "split makes a model of each side, and split_jumps does so only where "
      "adjacent frames contradict the motion of the rig. Sides always become "
      "separate models if no points determine their relative pose, or only "
      "loops that show one place or contradict the motion of the rig. Split if "
      "a wrong model is worse than several partial ones."};

  FocalLengthOptions focal_lengths;
  ViewGraphOptions view_graph;
  PairFilteringOptions pair_filtering;
  RotationAveragingOptions rotation_averaging;
  TrackOptions tracks;
  MatchSelectionOptions match_selection;
  TranslationAveragingOptions translation_averaging;
  BundleAdjustmentOptions bundle_adjustment;
  ExtensionOptions extension;  // only listed by commands with an existing model
  SoftRigOptions soft_rig;
  ConfidenceOptions confidence;
  // Whether the models serve only to calibrate lenses: camera delays and seams
  // are then not tested. Not an option of commands.
  bool is_for_lenses = false;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_num_frames, min_model_size, compute_covariances, metric_scale,
          estimate_antenna, weak_seams);
    visit.Group("FocalLengths", focal_lengths);
    visit.Group("ViewGraph", view_graph);
    visit.Group("PairFiltering", pair_filtering);
    visit.Group("RotationAveraging", rotation_averaging);
    visit.Group("Tracks", tracks);
    visit.Group("TranslationAveraging", translation_averaging);
    visit.Group("BundleAdjustment", bundle_adjustment);
    visit.Group("SoftRig", soft_rig);
  }
};

// The treatment of the frames of a finished map in a join.
struct FinishedMapSummary {
  int num_existing_frames = 0;
  bool frames_are_fixed = false;  // if not, everything was adjusted
  // The cost of the map for new frames, relative to the most that chance
  // explains; above 1, everything is adjusted. nullopt if a solve fails, or if
  // nothing is adjusted beside the map.
  std::optional<double> bend;

  auto Fields() const {
    return Named("num_existing_frames", num_existing_frames, "frames_are_fixed",
                 frames_are_fixed, "bend", bend);
  }
};

struct MapperModel {
  Reconstruction reconstruction;    // indices refer to the whole scene
  int num_frames_in_component = 0;  // before translation averaging
  TrackSummary tracks;
  TranslationSummary translation;
  BundleSummary bundle;
  std::optional<PositionPriorSummary> position_priors;  // if given
  std::optional<double> meters_per_unit;        // scale from the known baseline
  std::optional<GravitySummary> gravity;        // if measured
  std::vector<FocalLengthCheck> focal_lengths;  // of refined cameras
  std::optional<CovarianceResult> covariances;  // if requested
  std::optional<RigDelays> delays;              // for rigs with several cameras
  std::optional<ExtensionSummary> extension;  // if it extends an existing model
  std::optional<FinishedMapSummary> finished_map;  // if it was joined to one
  // Models with this flag have the same unit of length, defined by the
  // baselines of their rig.
  bool has_shared_unit = false;
  // Empty unless the observations of the model contradict the rig of a larger
  // one. The model then keeps its own rig.
  std::vector<RigDifference> rig_differences;
  // Set if the options request it. `reconstruction` then has the mean rig and
  // points that fit the individual poses of images; covariances are from before
  // that estimation.
  std::optional<SoftRigImages> soft_rig_images;
  // Groups of pairs that contradict the rotations or positions.
  std::vector<RejectedGroup> rejected_groups;
  KeptMatches kept_matches;  // verified matches that the model explains
  Confidence confidence;     // empty for extended models
  // The model contradicts most motions that motion continuity expects next to
  // moving objects.
  bool refutes_motion = false;
  std::vector<StageTime> times;  // in the order in which stages ran

  // Whether the model is in the world of the measured positions.
  bool IsAtPositions() const {
    return position_priors && position_priors->is_registered;
  }
  // The positions as those of the estimated antenna, if there is one.
  PositionPriors PositionsOf(PositionPriors positions) const;
};

struct UnregisteredFrame {
  int frame_idx = 0;
  std::string reason;

  auto Fields() const {
    return Named("frame_id", As<Item::kFrameId>(frame_idx), "name",
                 As<Item::kFrameName>(frame_idx), "reason", reason);
  }
};

// The parts of all images of a sensor that show what moves along with the rig
// during the whole recording: equal cells, row by row.
struct FixedRegion {
  int sensor_idx = 0;
  int num_rows = 0;
  int num_columns = 0;
  Mask is_fixed;
};

struct MapperResult {
  std::vector<MapperModel> models;  // by descending number of frames
  std::vector<UnregisteredFrame> unregistered_frames;  // in no model
  // One per camera without a prior focal length.
  std::vector<FocalLengthEstimate> focal_lengths;
  std::optional<LensSummary> lenses;  // if any were estimated
  ViewGraphSummary view_graph;
  // Pairs of the view graph that were rejected, by reason. Empty for an
  // extended model.
  std::vector<RejectionCount> rejected_pairs;
  // The rule of motion continuity was switched off, because a first model
  // contradicted most motions that it expected.
  bool motion_was_refuted = false;
  std::vector<FixedRegion> fixed_regions;  // of sensors that have any
  RotationSummary rotation;
  std::optional<IncrementalSummary> incremental;  // of an incremental mapper
  // Why measured gravity was not used; nullopt if it was used or is not
  // available.
  std::optional<std::string> gravity_rejection;
  // Suspected defects of the input or the result, causes before effects.
  std::vector<Finding> findings;
  std::vector<StageTime> times;
};

// Called as a model grows: when frames have positions, with coarse points, then
// after each round of bundle adjustment. Coordinates change from call to call.
// Runs on the thread of the mapper and does not affect results.
using ModelObserver = std::function<void(const Reconstruction& model)>;

struct MapperInput {
  Scene scene;           // images, frames, rigs and cameras
  ViewGraph view_graph;  // verified matches between the images of the scene
  // Measured positions of cameras or antennas. Models are registered to the
  // world of the positions if these determine it, and deformed toward them if
  // the models drifted.
  PositionPriors position_priors = {};
  // Measured directions of gravity. Models that neither position priors nor an
  // existing model align have gravity along +y.
  GravityPriors gravity_priors = {};
  // A model of some frames of the scene, with the indices of the scene. The
  // mapper then adds the other frames (mgsfm/registration/model_extension.h)
  // and returns this one model.
  std::optional<Reconstruction> existing_model = {};
  // Whether cameras without common frames raise a finding; false if single
  // images are intended.
  bool expects_rigs = true;
  ModelObserver observer = {};  // may be null
};

// Estimates a model for each connected component of the input. A result without
// models means that nothing could be reconstructed; `unregistered_frames` then
// states the reason for each frame.
//
// SoftRig.method time_offset requires the timestamps of all images. Throws
// Error if known poses of sensors in their rig contradict the matches
// (src/estimation/input_check/known_rigs.h), and if metric_scale is malformed,
// names no cameras of a rig or contradicts their known poses.
[[nodiscard]] MapperResult RunMapper(const MapperInput& input,
                                     const MapperOptions& options,
                                     const Context& context);

// Triangulates the points of `input.existing_model`, which must be set, with
// its poses fixed: tracks of the verified matches between its images are
// triangulated and filtered in rounds, as in the mapper. Existing points that
// belong to no track are kept if they pass the filters. Bundle adjustment
// refines what its options allow.
[[nodiscard]] MapperResult TriangulatePoints(const MapperInput& input,
                                             const MapperOptions& options,
                                             const Context& context);

}  // namespace mgsfm
