// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Files for other programs beside images/ and masks/ of an undistorted model,
// whose cameras are all PINHOLE. All functions throw Error if a file cannot be
// written.

// transforms.json of nerfstudio: per image its intrinsics, its mask, and
// transform_matrix, world_from_cam with the axes of OpenGL: x right, y up, z
// backward. The world is that of the model.
std::string NerfstudioTransforms(const Scene& scene,
                                 const Reconstruction& reconstruction,
                                 bool has_masks);

// The folder `stereo` of COLMAP's dense workspace: patch-match.cfg, in which
// each image is matched with the 20 best other images, fusion.cfg, and folders
// for the results.
void WriteStereoFolder(const std::filesystem::path& folder, const Scene& scene);

}  // namespace mgsfm
