// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model with the sensor and frame of each image, from its rigs and frames or,
// without them, from image names as in the mapper.
struct NamedModel {
  Scene scene;                         // without keypoints
  std::vector<Rigid3> cam_from_world;  // of scene.images
  std::vector<int> ref_sensor;         // of scene.rigs
  // Poses of scene.sensors relative to the reference sensor of their rig.
  std::vector<std::optional<Rigid3>> sensor_from_ref;
  std::map<std::string, int> sensor_of_folder;

  bool IsReference(int image_idx) const;
  // The sensor with images in this folder, or with its name.
  std::optional<int> FindSensor(const std::string& folder) const;
};

// Reads the images whose names start with `image_prefix`. `reference`, if not
// empty, is the name of a sensor or of a folder of its images. Throws Error if
// no sensor or no image matches.
NamedModel ReadNamedModel(const std::string& path,
                          const std::string& image_prefix,
                          const std::string& reference,
                          const SceneLoadingOptions& naming);

// "a/b" and "c" of "a/b/c.jpg".
std::string FolderOfName(const std::string& image_name);
std::string StemOfName(const std::string& image_name);

}  // namespace mgsfm
