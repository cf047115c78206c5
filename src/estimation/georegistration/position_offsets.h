// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The time by which the clock of measured positions is ahead of the clock of
// the images.
struct ClockOffset {
  double offset_s = 0.0;
  double sigma_s = 0.0;
  // Larger by chance in 1 of 10,000 recordings.
  bool is_significant = false;
};

// The position of the antenna relative to cam_from_antenna of the positions.
struct LeverOffset {
  // The axes are those of the antenna. The offset is zero along those of three
  // independent directions in which chance exceeds it in 1 of 10,000
  // recordings.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  // The standard deviation of the length of the offset. If the offset is zero,
  // the largest one of a direction.
  double sigma = 0.0;

  bool IsSignificant() const { return !offset.isZero(0.0); }
};

// nullopt: the motion does not tell.
struct PositionOffsets {
  std::optional<ClockOffset> clock;
  std::optional<LeverOffset> lever;
  // Each explains the positions if the other one is zero, and the motion does
  // not tell which is.
  bool are_alternatives = false;
};

// Estimates the offsets from a model that is registered to the positions but
// not yet adjusted to them:
//
//   min sum_i rho(|g_i - p_i - a - w x d_i - s d_i + v_i o - A_i l|^2
//                 / sigma_i^2)
//
// over the clock offset o, the offset l of the antenna and a small similarity
// (a, w, s), for images with a position g_i, an antenna p_i at d_i from the
// mean antenna with axes A_i in the world, and a velocity v_i by central
// differences. s is 0 if the model is metric. rho is Huber's; images beyond
// OutlierBound of the current fit do not count, so that a large offset does not
// look like outliers. A clock that is ahead assigns to an image where the rig
// was before.
//
// The standard deviations are the larger ones of noise (sigma_i) and of a
// jackknife over 16 stretches of frames, which knows the drift of the model and
// of the positions. Both offsets are estimated together. If each of them leaves
// no information on the other (an antenna ahead of the camera at constant
// speed), or none is significant, each is estimated with the other one zero.
// The similarity explains both on a line or a circle at constant speed, and the
// antenna along directions that do not turn: the vertical one of a car. The
// clock needs the times of all images.
//
// Cost: three fits with 10 + 16 x 4 passes over the positions.
PositionOffsets EstimatePositionOffsets(const Scene& scene,
                                        const PositionPriors& priors,
                                        const Reconstruction& reconstruction,
                                        bool is_metric);

// The significant offsets and their remedies; empty if there is none.
std::string DescribeOffsets(const PositionOffsets& offsets);

}  // namespace mgsfm
