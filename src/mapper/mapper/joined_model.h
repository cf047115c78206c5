// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model that was joined from models of parts of its scene.
struct JoinedModel {
  const Scene& scene;
  const PositionPriors& positions;
  const GravityPriors& gravity;
  // The poses of the parts if they have one world, otherwise null. They
  // determine the world of the result unless position priors do.
  const Reconstruction* parts = nullptr;
  bool is_refined = true;  // by bundle adjustment
  // If it has more observations, bundle adjustment selects tracks
  // (bundle_adjustment/solve.h).
  std::optional<size_t> max_num_observations = {};
  // The frames of a finished map. The model has the world and the calibration
  // of the map, and `parts` if this is the world of the positions. Empty: there
  // is no finished map.
  Mask existing_frames = {};
};

// Adjusts a joined model as the mapper adjusts its models: registration and
// deformation to the positions, bundle adjustment with positions and gravity,
// the world frame, the covariances if requested, and the confidence of the
// frames. Tracks of the points replace the matches, so that the memory is that
// of bundle adjustment. For lack of matches, the confidence counts nothing
// against a cut, and delays of cameras are not estimated.
//
// The existing frames, their calibration and the points that only they observe
// stay as they are in bundle adjustment, unless they contradict the new frames.
// Let E be the cost of the keypoints of the new frames alone, with the best
// points. E is higher at the poses beside the map than at its own optimum. If
// the map is right, 2 E rises by at most a chi-square variable, in units of the
// variance of the keypoints, with six degrees of freedom for each new frame but
// one that shares points with the map. If 2 E rises by more than the mean of
// such a variable and kRareErrorInSigmas of its standard deviations, or if a
// solve fails, everything is adjusted, as it is if the map is not in the world
// of given positions. Positions and gravity of the existing frames have no
// effect, as the map follows theirs.
//
// Points keep their colors. The result has one model, findings about it, the
// sensors of the rotation summary, and the frames without a pose.
[[nodiscard]] MapperResult AdjustJoinedModel(const JoinedModel& input,
                                             const MapperOptions& options,
                                             const Context& context,
                                             Reconstruction joined);

}  // namespace mgsfm
