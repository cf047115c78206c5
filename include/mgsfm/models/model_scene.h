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
  // The order is canonical. Intrinsics count as known (has_prior_focal_length),
  // because a model does not store which are. Sensor poses are known only if a
  // rig_config.json provides them; poses in the model are estimates.
  Scene scene;
  Reconstruction reconstruction;  // positions are those of scene
  std::string rig_source;         // description for messages
};

// Finds rigs and frames as the mapper does (see SceneLoadingOptions), using the
// rigs and frames of the model instead of those of the database. Without them
// (COLMAP 3.8), sensor poses are robust averages over frames: the relative
// rotation with the least sum of angles to the others, and the medians of the
// coordinates of the relative translations. The pose of a frame is computed
// from its image of the reference sensor, or else from its first image.
//
// Throws Error if
// - there is no image,
// - the poses of rigs and frames contradict those of the images by more than
//   1e-4 rad or 1e-4 of the extent of the model,
// - images whose names make them a rig do not move like one: the rotations in
//   the rig differ by 5 degrees or more in half of the frames,
// - the pose of a sensor in its rig is unknown,
// - known sensor poses differ from those implied by the images by more than 1
//   degree, or 5 % of the largest distance from the reference,
// and for the same reasons as LoadScene.
[[nodiscard]] ModelScene MakeModelScene(const Model& model,
                                        const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

// Loads the model in a folder; also throws the errors of ReadModel.
[[nodiscard]] ModelScene LoadModelScene(const std::filesystem::path& folder,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

}  // namespace mgsfm
