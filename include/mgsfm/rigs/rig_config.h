// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// COLMAP's rig_config.json: an array of rigs, each {"cameras": [camera, ...]}.
//
// Keys of a camera: "image_prefix" (required): the images whose names start
// with it are the camera's, and what follows the last occurrence of the prefix
// in the name is the same for the images of one frame; "ref_sensor": true for
// exactly one camera of a rig; "cam_from_rig_rotation" [w, x, y, z] with
// "cam_from_rig_translation" [x, y, z]: the pose where it is known;
// "camera_model_name" with "camera_params": intrinsics.
//
// A rig with "ref_camera_id" is one of COLMAP's rig_bundle_adjuster before
// 3.12: its cameras have "camera_id", "image_prefix" and, if known,
// "cam_from_rig_*" or "rel_qvec" and "rel_tvec" with the same meaning. The
// reference may have a pose, too.
//
// "image_pattern", which COLMAP does not know, replaces the prefix if only a
// later part of the names distinguishes the cameras: "IMG_*_cam1.jpg". The
// stars stand for the same text in all images of a frame.
struct RigConfigCamera {
  std::string image_prefix;
  bool is_reference = false;
  // Identity for the reference; nullopt if it is to be estimated.
  std::optional<Rigid3> cam_from_rig;
  std::optional<CameraModelId> camera_model;
  std::vector<double> camera_params;  // of camera_model
  std::string image_pattern = {};     // if not empty, replaces the prefix

  // Prefix or pattern, for messages.
  const std::string& NameRule() const {
    return image_pattern.empty() ? image_prefix : image_pattern;
  }
};

// The part of an image name that all images of its frame share; nullopt if the
// image belongs to another camera.
std::optional<std::string> FrameKeyOf(const RigConfigCamera& camera,
                                      const std::string& image_name);

struct RigConfig {
  std::vector<RigConfigCamera> cameras;
};

// Throws Error, naming file, rig and camera, for any deviation from the format
// above, including unknown keys, a second reference and an incomplete pose.
[[nodiscard]] std::vector<RigConfig> ReadRigConfig(const std::string& path);

// The content of such a file.
[[nodiscard]] std::string RigConfigsToJson(const std::vector<RigConfig>& rigs);

void WriteRigConfig(const std::string& path,
                    const std::vector<RigConfig>& rigs);

// The calibrated rigs of a model: estimated poses and intrinsics. The format
// identifies the images of a camera by a prefix of their names, so a rig whose
// cameras have images in several folders (seq1/cam0, seq2/cam0) becomes one rig
// with the same poses per outer folder. Cameras that no prefix distinguishes
// get patterns. Sensors without images, and rigs whose cameras have
// indistinguishable names, are skipped.
[[nodiscard]] std::vector<RigConfig> MakeRigConfigs(
    const Scene& scene, const Reconstruction& reconstruction);

// Writes the result of MakeRigConfigs.
void WriteRigConfig(const std::string& path, const Scene& scene,
                    const Reconstruction& reconstruction);

}  // namespace mgsfm
