// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/stage_time.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/bundle/covariance.h"
#include "mgsfm/bundle/focal_length_check.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/pipeline/model_extension.h"
#include "mgsfm/priors/prior_summaries.h"
#include "mgsfm/rotation/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/soft_rig/soft_rig.h"
#include "mgsfm/tracks/track_establishment.h"
#include "mgsfm/translation/translation_averaging.h"
#include "mgsfm/view_graph/focal_length_calibration.h"
#include "mgsfm/view_graph/view_graph_estimation.h"

namespace mgsfm {

// The main job: from verified matches to rig-consistent models.
//
//   focal lengths -> view graph -> rotation averaging
//                                             once, for all parts together
//   -> tracks -> translation averaging -> bundle adjustment     for each part
//
// Internal rotations are shared by all parts; every part that is connected and
// has at least `min_num_frames` frames becomes a model with a world of its own.

struct MapperOptions {
  int min_num_frames = 3;
  bool compute_covariances = false;

  FocalLengthOptions focal_lengths;
  ViewGraphOptions view_graph;
  RotationAveragingOptions rotation_averaging;
  TrackOptions tracks;
  MatchSelectionOptions match_selection;
  TranslationAveragingOptions translation_averaging;
  BundleAdjustmentOptions bundle_adjustment;
  ExtensionOptions extension;  // listed by commands that can have a start
  SoftRigOptions soft_rig;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_num_frames", self.min_num_frames, AtLeast(2), "frames",
          "Connected parts with fewer frames do not become models.");
    visit("compute_covariances", self.compute_covariances, AnyValue(), "",
          "Compute how exact the poses of cameras in the rig and of frames "
          "are; to covariances.csv beside each model.");
    visit.Group("FocalLengths", self.focal_lengths);
    visit.Group("ViewGraph", self.view_graph);
    visit.Group("RotationAveraging", self.rotation_averaging);
    visit.Group("Tracks", self.tracks);
    visit.Group("MatchSelection", self.match_selection);
    visit.Group("TranslationAveraging", self.translation_averaging);
    visit.Group("BundleAdjustment", self.bundle_adjustment);
    visit.Group("SoftRig", self.soft_rig);
  }
};

struct MapperModel {
  Reconstruction reconstruction;    // positions are those of the whole scene
  int num_frames_in_component = 0;  // before translation averaging
  TrackSummary tracks;
  TranslationSummary translation;
  BundleSummary bundle;
  std::optional<PositionPriorSummary> position_priors;  // if some are given
  std::optional<GravitySummary> gravity;                // if it was measured
  std::vector<FocalLengthCheck> focal_lengths;          // of those refined
  std::optional<CovarianceResult> covariances;          // if asked for
  std::optional<ExtensionSummary> extension;            // if it had a start
  // If asked for; then `reconstruction` has the mean rig, and points that fit
  // these poses of images. Covariances are those before.
  std::optional<SoftRigImages> soft_rig_images;
  // Pairs of this part that rotations or positions contradict.
  std::vector<RejectedGroup> rejected_groups;
  std::vector<StageTime> times;  // in the order in which stages ran
};

struct UnregisteredFrame {
  int frame_idx = 0;
  std::string reason;
};

struct MapperResult {
  std::vector<MapperModel> models;  // by descending number of frames
  std::vector<UnregisteredFrame> unregistered_frames;  // in no model
  // Of cameras without prior focal length.
  std::vector<FocalLengthEstimate> focal_lengths;
  ViewGraphSummary view_graph;
  RotationSummary rotation;
  std::vector<StageTime> times;
};

// With SoftRig.method time_offset, all images of the scene must
// have times.
//
// With `priors`, models come out in their world where they determine it, bent
// to them where they drifted, and bundle adjustment keeps images near them.
// With `gravity` rotations are levelled by it; models that are not in the world
// of positions, nor of `start`, have gravity along +y.
//
// With `start`, a model of some of the frames in positions of the scene, goes
// on from it as mgsfm/pipeline/extension.h says, and gives that one model.
//
// Throws Error if given poses of sensors contradict the matches, see
// src/pipeline/known_rigs.h. No model in the result means that the input held
// no reconstructable scene; `unregistered_frames` then says why for each frame.
[[nodiscard]] MapperResult RunMapper(const Scene& scene,
                                     const ViewGraph& view_graph,
                                     const MapperOptions& options,
                                     const Context& context,
                                     const PositionPriors& priors = {},
                                     const GravityPriors& gravity = {},
                                     const Reconstruction* start = nullptr);

// The points of a model whose poses are held: tracks of the verified matches
// between its images, triangulated and filtered as the mapper does, in rounds.
// Points of `start` that are in no track are kept if they pass the filters.
// What bundle_adjustment allows to refine is refined.
[[nodiscard]] MapperResult TriangulatePoints(const Scene& scene,
                                             const ViewGraph& view_graph,
                                             const Reconstruction& start,
                                             const MapperOptions& options,
                                             const Context& context);

}  // namespace mgsfm
