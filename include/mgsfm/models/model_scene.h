// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model in the types of the stages.
struct ModelScene {
  // Its order is canonical. Intrinsics count as known (has_prior_focal_length),
  // as a model does not store which are. Sensor poses are known only if a
  // rig_config.json gives them; those of the model are estimates.
  Scene scene;
  Reconstruction reconstruction;  // positions are those of scene
  std::string rig_source;         // in words
};

// Finds rigs and frames as the mapper does (see SceneLoadingOptions), using the
// rigs and frames of the model instead of those of the database. Without them
// (COLMAP 3.8), sensor poses are robust averages over frames: the
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
// - the pose of a sensor in its rig is unknown,
// - known poses of sensors differ from those of the images by more than 1
//   degree, or 5 % of the largest distance from the reference,
// and for the same reasons as LoadScene.
[[nodiscard]] ModelScene MakeModelScene(const Model& model,
                                        const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

// Loads the model of a folder; also throws what ReadModel throws.
[[nodiscard]] ModelScene LoadModelScene(const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

}  // namespace mgsfm
