// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/models/model_io.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model in the scene of a database with its images, which are matched by
// name; ids may differ.
struct PlacedModel {
  Reconstruction reconstruction;  // positions are those of the scene
  // Whether all images have the pose of their frame and sensor, to 1e-6 rad and
  // 1e-6 of the extent of the model. Otherwise, they were not estimated as
  // rigs, or not as these rigs.
  bool is_rigid = true;
};

// Rigs and frames are those of the scene. Sensor poses come from the rigs of
// the model that have the sensor and the reference, else from the image poses,
// as in MakeModelScene (model_scene.h). Sensors and frames without an image in
// the model have no pose.
//
// Cameras of the scene get the intrinsics of the model, which count as known,
// and its camera models, which the mapper chooses for unknown lenses. A
// reference sensor without an image in the model is replaced by the sensor of
// its rig with the most images there.
//
// Throws Error, naming model, image and remedy, if
// - the scene lacks an image of the model, or all of them,
// - an image has another size there, or another camera model although its lens
//   is known,
// - with `with_points`: the model has no points, or an observation is not the
//   keypoint of the scene that it should be, to one pixel,
// - images of one frame of the model are in several frames of the scene,
// - known sensor poses of the scene differ from those of the model
//   by more than 1 degree, or 5 % of the largest distance from the reference,
// - the pose of a sensor is unknown, or its images do not move rigidly.
[[nodiscard]] PlacedModel PlaceModel(const Model& model,
                                     const std::filesystem::path& folder,
                                     const std::string& database_path,
                                     bool with_points, Scene* scene);

}  // namespace mgsfm
