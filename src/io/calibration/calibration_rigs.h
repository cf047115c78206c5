// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/rigs/rig_config.h"
#include "rigs/rig_inference.h"

namespace mgsfm {

// The rigs of the images according to a calibration in one of the formats of
// calibration.h, or in COLMAP's rig_config.json, which is used unchanged.
//
// A camera is matched with the folder of its images, at any level, by the first
// of these that fits: the last part of its topic, its name, both ignoring case,
// or the number at the end of its name (cam0, image_00). Names of files may
// start with the name of the camera, too (left_0001.png). Each outer folder
// (seq1/cam0, seq2/cam0) gets a separate rig with the same poses. The first
// matched camera of the calibration is the reference.
//
// Intrinsics are scaled to images of another size with the same aspect ratio.
// Logs which cameras have which images. Throws Error if no camera has images, a
// folder fits two cameras, no camera model describes a camera that has images,
// or the aspect ratios differ.
std::vector<RigConfig> ReadCalibrationRigs(const RigInput& input,
                                           const std::string& paths,
                                           const Context& context);

// The rig of OpenSfM's rig_cameras.json, or of its folder, with the frames of
// rig_assignments.json beside it; images that it lacks are alone in a frame, of
// the camera that fits their names as above. nullopt without this file, for
// another calibration and, with a warning, if it names no image. Throws Error,
// naming file and line, for malformed pairs, unknown cameras and repeated
// images.
std::optional<RigAssignment> AssignByInstances(const RigInput& input,
                                               const std::string& path,
                                               const Context& context);

// The number at the end of a name that consists of letters and this number.
std::optional<int> NumberAtEnd(const std::string& name);

}  // namespace mgsfm
