// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/io/database/scene_loading.h"
#include "mgsfm/io/models/model_io.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model whose images are told apart by sensor and frame: as its own rigs and
// frames say or, if they say nothing, by image names as the mapper does.
struct NamedModel {
  Scene scene;                         // without keypoints
  std::vector<Rigid3> cam_from_world;  // of scene.images
  std::vector<int> ref_sensor;         // of scene.rigs
  // Of scene.sensors, relative to that of their rig.
  std::vector<std::optional<Rigid3>> sensor_from_ref;
  std::map<std::string, int> sensor_of_folder;

  bool IsReference(int image_idx) const;
  // The sensor that has images in this folder, or is called like it.
  std::optional<int> FindSensor(const std::string& folder) const;
};

// Images whose names start otherwise are left out. `reference`, if not empty,
// is the name of a sensor or of a folder of its images. Throws Error if there
// is none, or no image is left.
NamedModel ReadNamedModel(const std::string& path,
                          const std::string& image_prefix,
                          const std::string& reference,
                          const SceneLoadingOptions& naming);

// "a/b" and "c" of "a/b/c.jpg".
std::string FolderOfName(const std::string& image_name);
std::string StemOfName(const std::string& image_name);

}  // namespace mgsfm
