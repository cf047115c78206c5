// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "mapper/model_adjustment.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/mapper/mapper.h"
#include "pair_filtering/frame_pair_index.h"
#include "seams/seams.h"

namespace mgsfm {

// The confidence of an adjusted model, with the standard deviations of its
// seams. Cost: EstimateConfidence(), and ComputeRelativeCovariances() for each
// seam.
Confidence EstimateModelConfidence(const ConfidenceInput& input,
                                   const MapperOptions& options,
                                   const Context& context);

// nullopt for a model without weak seams.
std::optional<Finding> DescribeSeams(const Scene& scene,
                                     const Confidence& confidence);

// The seams at which a model is split: with split_jumps, where frames jump, and
// where loops of one place join the sides, the motion of the rig refutes the
// loops, or the points that cross do not determine the relative pose, so that
// the sides have no relation unless positions place both. If this left fewer
// than half of the frames in sets of at least min_num_frames, the expected
// motion of the rig is in doubt rather than the model, and jumps do not split
// it.
std::vector<Seam> SeamsToSplit(const Scene& scene, const MapperModel& model,
                               const MapperOptions& options);

// The confidence of a model with tracks from the matches of some pairs.
using ConfidenceFunction =
    std::function<Confidence(const Mask& pair_is_used, const MapperModel&)>;

// Finds the weak seams of an adjusted model, moves sides to where more matches
// agree (side_alignment.h), and splits the model at the seams that the options
// select: one model for each set of frames that none of these seams separates.
// Each model is adjusted again, the largest first, without the pairs that cross
// a seam, keeps the summaries of earlier stages, and is split again. Sets of
// fewer than min_num_frames frames, and those that points alone do not hold
// together, are omitted. `pair_on_path` has the motion of the rig from
// moving_objects.h. A model that refutes it is neither realigned nor split.
[[nodiscard]] std::vector<MapperModel> TestSeams(
    const FramePairIndex& index,
    const std::vector<std::optional<Rigid3>>& pair_on_path,
    const MapperOptions& options, const Context& context, AdjustmentInput input,
    MapperModel model);

// Whether a model has points and at least min_num_frames registered frames.
bool IsLargeEnough(const MapperModel& model, const MapperOptions& options);

// Tests a model at its weak seams. Both sides of a seam are rigid, but few
// points tie them, and an object that moves can have decided their relative
// pose. The structure of either side cannot show such an object: two frames of
// the side observe its points.
//
// If another motion explains more matches of neighbors in time
// (registration/side_motion.h; places can look alike), the model is adjusted
// again with all pairs of the neighbors across the seam. It stays if
// significantly more points tie both sides; `input` then uses these pairs.
// Seams are tested by ascending confidence, until none changes.
//
// Cost: linear in the matches across each seam, and a bundle adjustment for
// each motion that explains more.
void RealignSides(const FramePairIndex& index, const MapperOptions& options,
                  const Context& context,
                  const ConfidenceFunction& confidence_of,
                  AdjustmentInput* input, MapperModel* model);

}  // namespace mgsfm
