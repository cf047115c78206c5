// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/input_check/finding.h"
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

// Whether the estimate of a model, as a logarithm of its ratio to the known
// focal length, confirms a doubt of the check above: it exceeds half of the
// bound in the same direction.
bool ContradictsFocalLength(const Finding& doubt, double log_factor);

// Names of the sensors that use a camera.
std::vector<std::string> SensorsOfCamera(const Scene& scene, int camera_idx);

}  // namespace mgsfm
