// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/rigs/rig_config.h"

namespace mgsfm {

// Input of rig inference: the rows of a database or model, images by name.
struct RigInput {
  std::string kind;  // "database" or "model", for messages
  DatabaseContents contents;
  std::vector<int> camera_of_image;  // position in contents.cameras

  const Camera& CameraOf(int image) const {
    return contents.cameras[camera_of_image[image]];
  }
  std::string Name() const { return kind + " '" + contents.path + "'"; }
};

// Sensor and frame of each image, the common result of all sources of rigs.
// Sensors may have no images; a rig may have no reference. Images are positions
// in RigInput.
struct RigAssignment {
  struct Sensor {
    int rig = 0;
    std::string name;
    bool is_reference = false;
    std::optional<Rigid3> sensor_from_rig;
    // Replace the intrinsics of the input.
    std::optional<CameraModelId> camera_model;
    std::vector<double> camera_params;
  };
  struct Frame {
    int rig = 0;
    std::string name;
    std::optional<FrameId> id;
  };
  std::vector<std::optional<RigId>> rig_ids;  // per rig
  std::vector<Sensor> sensors;
  std::vector<Frame> frames;
  std::vector<int> sensor_of_image;
  std::vector<int> frame_of_image;
  std::string source;  // in words
};

// Keys parsed from the name of an image. Images with equal `sensor` belong to
// one sensor, images with equal `frame` to one frame. Sensors with different
// `rig` share no frames.
struct ImageKeys {
  std::string rig;
  std::string sensor;
  std::string frame;
  std::string sensor_name;
  std::string frame_name;
};

struct FrameTimes;  // frames_by_time.h

// The four sources of rigs, see scene_loading.h. Frames are formed by image
// times if given, otherwise by names. AssignByTables returns nullopt if the
// tables have one camera per rig and one image per frame.
RigAssignment AssignByConfig(const RigInput& input,
                             const std::vector<RigConfig>& rigs,
                             const std::string& path, const FrameTimes* times,
                             const Context& context);
RigAssignment AssignByRule(const RigInput& input, const std::string& rule,
                           const FrameTimes* times, const Context& context);
std::optional<RigAssignment> AssignByTables(const RigInput& input);
RigAssignment AssignByFolders(const RigInput& input, const FrameTimes* times,
                              const Context& context);

// Sensors that share frames, directly or through others, form a rig; images of
// sensors that share none are single.
RigAssignment AssignByKeys(const RigInput& input,
                           const std::vector<ImageKeys>& keys);

// Adds the images as single: a rig for each camera, a frame for each image.
void AssignSingleImages(const RigInput& input, const std::vector<int>& images,
                        RigAssignment* assignment);

bool HaveEqualIntrinsics(const Camera& a, const Camera& b);

// Whether a name has a word for a camera, such as "cam", "left" or "front".
bool IsCalledLikeCamera(std::string name);

// "a/b/c.jpg" -> {"a", "b", "c.jpg"}; "c.x.jpg" -> "c.x".
std::vector<std::string> SplitPath(const std::string& name);
std::string WithoutExtension(const std::string& name);

// Returns the position of the folders `sensor_name` in the name of an image, as
// whole components, or 0 if the name starts with that text.
std::optional<size_t> FindSensorName(const std::string& image_name,
                                     const std::string& sensor_name);

// Returns the frame's part of the name of an image, without the name of the
// sensor and the extension.
std::string NameWithoutSensor(const std::string& image_name,
                              const std::string& sensor_name);

}  // namespace mgsfm
