// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {

// Adds the rigs and frames of a model. Frames lose images that the model lacks.
void AddModelTables(const PoseModel& poses, DatabaseContents* contents);

// Throws Error, naming `folder` and the image, unless image poses agree with
// those of their frames and sensors, and each image is in one frame of a rig
// with its camera. Programs without rigs write images beside the rigs and
// frames of an earlier model.
void CheckModelTables(const PoseModel& poses,
                      const std::filesystem::path& folder);

// Compares poses, cameras and points of a model with its keypoints. Throws
// Error if more than a tenth of the points do not project to their keypoints,
// and less than half as many fail with poses in another convention: quaternions
// x, y, z, w, or poses world_from_cam. Warns if most points fail.
void CheckObservations(const Model& model, const std::filesystem::path& folder,
                       const Context& context);

}  // namespace mgsfm
