// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "input_check/rig_samples.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/input_check/kept_matches.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/rig_delays.h"
#include "mgsfm/soft_rig/rig_difference.h"

namespace mgsfm {

// Tests whether a rig stays the same and agrees with the user's calibration.
// All checks use the samples of image pairs (rig_samples.h).

// The largest step of the relative rotation of two sensors: the split of the
// frames into two segments whose mean rotations differ most, in standard
// deviations. Each segment has at least 5 samples and 5 % of all.
struct RigStep {
  int first_frame_idx = 0;  // of the second stretch
  double step_rad = 0.0;    // angle between the medians of both stretches
  double sigma_rad = 0.0;   // per axis, of one sample; of the noisier stretch
};
// nullopt with fewer samples. Cost: linear in the samples.
std::optional<RigStep> FindLargestStep(const std::vector<RigSample>& samples);

// kUnsynchronized: the delays of all cameras of rigs with a significant delay.
std::vector<Finding> DescribeDelays(const Scene& scene,
                                    const RigDelays& delays);

// Rotates the samples to the time of their frames by the motions of a model, so
// that the checks below see only what its times do not explain.
void RemoveMotions(const Scene& scene, const Reconstruction& model,
                   std::vector<SensorPairSamples>* pairs);

// A sensor that moved relative to most others of its rig (kRigMoved). The step
// must exceed 0.5 degrees and six standard deviations of one sample: neither
// vibration nor location-dependent pair errors may count as a move.
std::vector<Finding> FindRigMoves(const Scene& scene,
                                  const std::vector<SensorPairSamples>& pairs);

// Known rotations that contradict the samples (kWrongKnownRotation). In a
// narrow overlap, matches determine only combinations of the rotation and the
// direction of the baseline, and all samples can have the same error. A
// rotation is therefore accepted if a model with the known rig explains most
// matches of both cameras with other cameras (`kept_between`, per sensor; empty
// without a model).
std::vector<Finding> CheckKnownRotations(
    const Scene& scene, const std::vector<SensorPairSamples>& pairs,
    const std::vector<KeptCount>& kept_between);

// Segments of frames in which two sensors have exchanged their images
// (kSwappedCameras): their samples agree with the inverse of the typical pose.
std::vector<Finding> FindSwappedCameras(
    const Scene& scene, const std::vector<SensorPairSamples>& pairs);

// Sensors whose poses in a model contradict the rig of a larger one
// (kRigDiffers).
std::vector<Finding> DescribeRigDifferences(
    const Scene& scene, size_t model_idx, const Reconstruction& model,
    const std::vector<RigDifference>& differences);

}  // namespace mgsfm
