// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/truth_comparison.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The images of a model with their sensors and frames, from its rigs and frames
// or, without them, from image names as in the mapper.
struct PosedScene {
  // Without keypoints. Sensors are posed relative to the reference of their
  // rig.
  Scene scene;
  std::vector<Rigid3> cam_from_world;  // of scene.images
  std::map<std::string, int> sensor_of_folder;

  bool IsReference(int image_idx) const {
    return scene.IsReference(scene.images[image_idx].sensor_idx);
  }
  // The sensor with images in this folder, or with its name.
  std::optional<int> FindSensor(const std::string& folder) const;
};

// Reads the images whose names start with `image_prefix`. `reference`, if not
// empty, is the name of a sensor or of a folder of its images. Throws Error if
// no sensor or no image matches.
PosedScene ReadPosedScene(const std::string& path,
                          const std::string& image_prefix,
                          const std::string& reference,
                          const std::string& rig_name_rule);

// The number that a text consists of.
std::optional<double> ParseNumber(const std::string& text);

// Names of images that the model may lack; nullopt if they are unknown.
using ImageNames = std::optional<std::vector<std::string>>;

// Model and truth, image by image, in the order of the trajectory in the file
// gt_path, which is of KITTI or TUM. Sensors that are not in `sensor_from_ref`
// (per sensor of the model) are skipped. Images that the model lacks are added:
// other_images or, if these are not known, all of frames in gaps of the model,
// which are true poses that lie at its median step between two of its frames.
std::vector<ImagePoses> PairWithTrajectory(
    const PosedScene& model, const std::string& gt_path, TruthFormat format,
    const std::vector<std::optional<Rigid3>>& sensor_from_ref,
    const ImageNames& other_images);

}  // namespace mgsfm
