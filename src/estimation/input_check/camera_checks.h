// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Images whose keypoints do not fit the size of their camera (kWrongImageSize):
// the largest coordinates of the keypoints of many images are either beyond the
// size, or the same small fraction of width and height.
std::vector<Finding> CheckImageSizes(const Scene& scene);

// Focal lengths with a prior that the image pairs contradict
// (kWrongFocalLength): the log ratio to the measured focal length
// (mgsfm/view_graph/focal_length_calibration.h) is an error that occurs in 1 of
// 10,000 cases. Its standard deviation includes 3.6 % for distortion that the
// trusted lens may lack, so errors below 15 % are not reported. `view_graph`
// has the matches from before these focal lengths selected them.
std::vector<Finding> CheckTrustedFocalLengths(const Scene& scene,
                                              const ViewGraph& view_graph,
                                              const Context& context);

// Names of the sensors that use a camera.
std::vector<std::string> SensorsOfCamera(const Scene& scene, int camera_idx);

}  // namespace mgsfm
