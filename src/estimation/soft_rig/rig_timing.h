// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/soft_rig.h"
#include "soft_rig/rig_trajectory.h"

namespace mgsfm {

// Bundle adjustment of a rig whose cameras trigger and read their rows at
// different times.
//
// Model. The row at height v of image i, from -1/2 to 1/2, is taken at t_i +
// delay_s + v readout_s, at the pose S_s T of sensor s. T is the trajectory of
// the rig (rig_trajectory.h) through the poses of its frames at this time. t_i
// is the time of the image, of its middle row with a readout time.
//
// Objective: that of bundle adjustment, over frames, sensors, points and
// intrinsics, and over the delays and readout times that `method` estimates.
// Delays are relative to the reference sensors; readout times are those of all
// sensors.
//
// Rounds. A round takes a least-squares step of delays, readout times, sensors
// and frames (rig_scores.h). The first rounds then triangulate the points at
// the new times; the third and later ones adjust everything but the times. The
// motions between frames and images, and the displacements of rows, are
// constant in a solve. The fixed point of the rounds is stationary.
//
// Stopping criteria: in a round, no time and no pose of a sensor changes by
// more than a tenth of its standard deviation, and motions change by less than
// a thousandth; or max_num_rounds.
//
// Standard deviations are those of a jackknife over ten blocks of frames.
// Delays and readout times that the motion of the rig does not determine stay
// zero.
//
// Gauge: that of bundle adjustment.
// Cost of a round: a triangulation, a solve, and two passes with a
// factorization.
struct RigTimingInput {
  const Scene& scene;
  const CaptureTimes& times;
  // Groups of keypoints for models of a scene with moved keypoints.
  const std::function<CandidateSource(const Scene& seen)>& candidates;
  const Reconstruction& initial;  // after bundle adjustment
  RefinementConditions conditions = {};
};

[[nodiscard]] SoftRigResult EstimateRigTiming(
    const RigTimingInput& input, const SoftRigOptions& options,
    const BundleAdjustmentOptions& bundle_options, const Context& context);

// Whether the motion between the times of frames and their images moves
// keypoints by more than a tenth of their noise (root mean square), which is 1
// % of the variance of residuals.
bool TimesMatter(const Scene& scene, const CaptureTimes& times,
                 const Reconstruction& model, const Context& context);

// Whether delays of sensors move keypoints by more than a tenth of their noise
// (root mean square).
bool DelaysMatter(const Scene& scene, const CaptureTimes& times,
                  const std::vector<double>& delays,
                  const Reconstruction& model, const Context& context);

// Whether the first of two models of a scene explains more of its keypoints:
// the sum over observations of 1 - (error / bound)^2, with the smaller of the
// bounds of both models.
bool ExplainsMore(const Scene& scene, const Reconstruction& a,
                  const Reconstruction& b,
                  const BundleAdjustmentOptions& options,
                  const Context& context);

}  // namespace mgsfm
