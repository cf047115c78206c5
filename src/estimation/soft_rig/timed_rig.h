// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "soft_rig/rig_scores.h"
#include "soft_rig/rig_trajectory.h"

namespace mgsfm {

// The steps of estimating when the images and rows of a rig are taken; see
// rig_timing.h.

// The model at the times of its images, without delays and readout times. The
// mean poses of images in their frames do not change, except with known
// sensors.
TimedRig StartTimedRig(const Scene& scene, const CaptureTimes& times,
                       const Reconstruction& model);

// Changes sensors, frames, delays and readout times by a least-squares step.
// Images move with the trajectory of the new frames.
void ApplyStep(const Scene& scene, const CaptureTimes& times,
               const RigScores& scores, const Eigen::VectorXd& step,
               TimedRig* rig);

// Sets the motions and rates of the images from the frames of the model.
void UpdateMotions(const Scene& scene, const CaptureTimes& times,
                   TimedRig* rig);

// Scales a model about its center to the known poses of sensors. Residuals of
// keypoints do not change, because motions scale, too; solves, in which motions
// are constant, would take many rounds.
void ScaleToKnownRig(const Scene& scene, Reconstruction* model);

// The scene with the keypoints that images without readout times would have:
// moved by the displacement that the motion of the rig causes between the times
// of the image and of the row. Keypoints of points are as far away as these,
// others at the median distance of their image. nullopt if no readout times are
// estimated.
std::optional<Scene> WithoutReadouts(const Scene& scene, const TimedRig& rig);

// Triangulates the points again. With `num_rounds_left`, errors may be as large
// as unknown delays could cause.
void TriangulateAgain(const Scene& scene, const CandidateSource& candidates,
                      const BundleAdjustmentOptions& options,
                      int num_rounds_left, const Context& context,
                      Reconstruction* model);

// Whether a step changes the columns by less than a tenth of their standard
// deviations: those of times, or all.
enum class StepPart { kTimes, kAll };
bool IsInsignificant(const RigScores& scores, const Eigen::VectorXd& step,
                     StepPart part);

}  // namespace mgsfm
