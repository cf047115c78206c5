// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// What a first model is adjusted to.
struct AdjustmentInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const PositionPriors& positions;
  const GravityPriors& gravity;
  Mask pair_is_used = {};  // those whose matches make tracks
  bool is_metric = false;  // the first model
  // A model that was gone on from. The result is where it is, unless measured
  // positions say otherwise; null: none.
  const Reconstruction* start = nullptr;
  FixedPoses held = {};
};

// The way of every first model to the final one: moved and bent to measured
// positions, bundle adjustment with tracks made anew, back to the start or
// levelled by gravity, then what is to be known of it, and poses of single
// images, as far as the options ask for them. Adds all that to `model`.
void AdjustModel(const AdjustmentInput& input, const MapperOptions& options,
                 const Context& context, Reconstruction initial,
                 MapperModel* model);

// old_from_new, which brings the images that both models have back to where
// they were in the old one: the rotation is the mean of those of the images,
// scale and translation fit the centres in the least squares sense. Scale is 1
// if `is_metric` or all centres coincide.
Sim3 AlignToModel(const Scene& scene, const Reconstruction& old_model,
                  const Reconstruction& new_model, bool is_metric);

}  // namespace mgsfm
