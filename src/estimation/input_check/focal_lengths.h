// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Focal lengths with a prior that the image pairs contradict
// (kWrongFocalLength): they differ from the measured ones
// (mgsfm/view_graph/focal_length_calibration.h) by more than 15 % and by more
// than 2 standard deviations. Smaller differences can be due to distortion.
// `view_graph` has the matches before they were selected with these focal
// lengths.
std::vector<Finding> CheckTrustedFocalLengths(const Scene& scene,
                                              const ViewGraph& view_graph,
                                              const Context& context);

// Names of the sensors that use a camera.
std::vector<std::string> SensorsOfCamera(const Scene& scene, int camera_idx);

// Few pairs, little motion and pairs on vehicles can mislead this check. Keeps
// the doubts that a model confirms: bundle adjustment with free focal lengths
// moves them in the direction of the doubt by more than half of its bound.
// Doubts about cameras without a model remain. Cost: one bundle adjustment if
// there are doubts, otherwise none.
std::vector<Finding> ConfirmedFocalLengthDoubts(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    std::vector<Finding> doubts);

}  // namespace mgsfm
