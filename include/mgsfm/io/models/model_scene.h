// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/io/models/model_io.h"
#include "mgsfm/io/models/scene_loading.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model, as the stages take it.
struct ModelScene {
  // In canonical order. Intrinsics count as known (has_prior_focal_length), as
  // a model does not say which are. Poses of sensors are known only where a
  // rig_config.json gives them; those of the model are estimates.
  Scene scene;
  Reconstruction reconstruction;  // positions are those of scene
  std::string rig_source;         // in words
};

// Finds rigs and frames as the mapper does (see SceneLoadingOptions), with the
// model's tables of rigs and frames in place of the database's. Without them
// (COLMAP 3.8) the poses in the rig are those that most frames agree with: the
// relative rotation with the least sum of angles to the others, and the medians
// of the coordinates of the relative translations. The pose of a frame follows
// from its image of the reference sensor, else from its first image.
//
// Throws Error if
// - there is no image,
// - the poses of rigs and frames contradict those of the images by more than
//   1e-4 rad or 1e-4 of the extent of the model,
// - images whose names make them a rig do not move like one: the rotations in
//   the rig differ by 5 degrees or more in half of the frames,
// - nothing tells the pose of a sensor in its rig,
// and what LoadScene throws.
[[nodiscard]] ModelScene MakeModelScene(const Model& model,
                                        const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

// The same of the model in a folder; also throws what ReadModel throws.
[[nodiscard]] ModelScene LoadModelScene(const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

}  // namespace mgsfm
