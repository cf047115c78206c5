// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "soft_rig/shared_calibration.h"

namespace mgsfm {

// Makes the source of candidate tracks for bundle adjustment: tracks from the
// matches of used pairs that agree with a model. `matches` are the input
// matches; the view graph has a subset of them. The source refers to all
// arguments except the mask; they must outlive it.
CandidateSource MakeCandidateSource(const Scene& scene,
                                    const ViewGraph& view_graph,
                                    const ViewGraph& matches, Mask pair_is_used,
                                    const MapperOptions& options,
                                    const Context& context);

// The data for the adjustment of an initial model.
struct AdjustmentInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const ViewGraph& matches;  // of the input
  const PositionPriors& positions;
  const GravityPriors& gravity;
  Mask pair_is_used = {};  // those whose matches make tracks
  bool is_metric = false;  // the first model
  // The points of the initial model stand for the matches that made them; used
  // pairs are those with new images.
  bool keeps_points = false;
  // The existing model of an extension, or null. It determines the world frame
  // of the result unless position priors do.
  const Reconstruction* start = nullptr;
  FixedPoses held = {};
  ModelObserver observer = {};  // of the rounds of bundle adjustment
  SharedCalibration* calibration = nullptr;  // of all models, or null
};

// The candidates of a scene with the images of the input. Refers to its
// arguments but the mask.
CandidateSource CandidatesOf(const AdjustmentInput& input, const Scene& scene,
                             const MapperOptions& options,
                             const Context& context);

// Throws Error if the method estimates times and an image has none.
void CheckTimes(const Scene& scene, SoftRig method);

// Turns an initial model into the final one: registration and deformation to
// the position priors, bundle adjustment with re-established tracks and the
// calibration of earlier models as prior, or without it if the observations of
// the model contradict it, alignment to the existing model or to gravity; then
// the checks of focal lengths, the covariances and the soft rig that the
// options request. Adds all results to `model`.
void AdjustModel(const AdjustmentInput& input, const MapperOptions& options,
                 const Context& context, Reconstruction initial,
                 MapperModel* model);

// Passes the calibration of an adjusted model on to the next ones, unless the
// model contradicts the rig of an earlier one.
void PassOn(const MapperModel& model, const PositionPriors& positions,
            const MapperOptions& options, const Context& context,
            SharedCalibration* calibration);

}  // namespace mgsfm
