// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "mgsfm/database/database.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {

// The tables of rigs and frames of a model. Frames lose images that the model
// lacks.
void AddModelTables(const PoseModel& poses, DatabaseContents* contents);

// Throws Error, naming `folder` and the image, unless the poses of images are
// those of their frames and sensors, and each image is in one frame, of a rig
// with its camera. Programs that know no rigs write images beside rigs and
// frames of an earlier model.
void CheckModelTables(const PoseModel& poses,
                      const std::filesystem::path& folder);

}  // namespace mgsfm
