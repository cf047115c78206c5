// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mapper/model_adjustment.h"
#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The world of a model: measured positions and gravity, a known distance of two
// sensors, or the existing model.

// Before bundle adjustment: moves the model to the measured positions, and adds
// the positions and directions of gravity to those that bundle adjustment uses.
void UsePriors(const AdjustmentInput& input, const MapperOptions& options,
               const Context& context, Reconstruction* initial,
               BundlePriors* used, MapperModel* model);

// The same for a model that is in the world of the positions and stays there.
void UsePriorsInPlace(const AdjustmentInput& input,
                      const MapperOptions& options, const Context& context,
                      BundlePriors* used, MapperModel* model);

// After bundle adjustment: states how well they agree, checks the focal
// lengths, and moves the model to its final world.
void PlaceModelInWorld(const AdjustmentInput& input, const BundlePriors& used,
                       const MapperOptions& options, const Context& context,
                       MapperModel* model);

// old_from_new, aligned by the images of both models: the rotation is the mean
// of their relative rotations, scale and translation minimize the squared
// distances of their centers. The scale is 1 if `is_metric` or if all centers
// coincide.
Sim3 AlignToModel(const Scene& scene, const Reconstruction& old_model,
                  const Reconstruction& new_model, bool is_metric);

}  // namespace mgsfm
