// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/rigs/rig_config.h"
#include "mgsfm/scene/scene.h"

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

// Numbers distinct keys in the order of their appearance.
template <class Key = std::string>
class Numbering {
 public:
  int operator()(const Key& key) {
    return numbers_.emplace(key, static_cast<int>(numbers_.size()))
        .first->second;
  }
  size_t size() const { return numbers_.size(); }

 private:
  std::map<Key, int> numbers_;
};

// Images that form frames by time: the times of all images, and the maximum
// difference within a frame.
struct TimedImages {
  std::vector<int64_t> times_ns;  // per image
  int64_t max_difference_ns = 0;
};

// The four sources of rigs, see scene_loading.h. Frames are formed by image
// times if given, otherwise by names. AssignByTables returns nullopt if the
// tables have one camera per rig and one image per frame.
RigAssignment AssignByConfig(const RigInput& input,
                             const std::vector<RigConfig>& rigs,
                             const std::string& path, const TimedImages* times,
                             const Context& context);
RigAssignment AssignByRule(const RigInput& input, const std::string& rule,
                           const TimedImages* times, const Context& context);
std::optional<RigAssignment> AssignByTables(const RigInput& input);
RigAssignment AssignByFolders(const RigInput& input, const TimedImages* times,
                              const Context& context);

// Sensors that share frames, directly or through others, form a rig; images of
// sensors that share none are single.
RigAssignment AssignByKeys(const RigInput& input,
                           const std::vector<ImageKeys>& keys);

// Adds the images as single: a rig for each camera, a frame for each image.
void AssignSingleImages(const RigInput& input, const std::vector<int>& images,
                        RigAssignment* assignment);

bool HaveEqualIntrinsics(const Camera& a, const Camera& b);

// ---------------------------------------------------------------- names

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

// -------------------------------------------------------- frames by time

// Pairs the images of the sensors of each rig one to one. The sensors join one
// after the other: the reference, then by descending number of images, then by
// name. An image and a frame are paired if each is the nearest of the other and
// they are at most max_difference_ns apart; of two that are equally near, the
// earlier one counts. Images without a partner become frames. A frame is named
// after the time of its first sensor, with nine decimals. Cost: O(n log n) per
// sensor.
//
// Takes the sensors of the assignment, where images without a sensor have -1 as
// sensor and as frame, and sets its frames.
//
// Logs the pairs, the images without a partner, and the distribution of
// differences of each sensor. Throws Error if there is no pair, or if two
// images of a sensor have one time.
void PairByTime(const RigInput& input, const TimedImages& times,
                const Context& context, RigAssignment* assignment);

// Replaces the frames of the keys by frames according to image times.
void SetFramesByTime(const RigInput& input, const TimedImages& times,
                     const Context& context, std::vector<ImageKeys>* keys);

// ------------------------------------------------------------ suggestions

// A time difference that pairs most images of folders without common names, if
// the names contain times; in words, as a remedy. nullopt if there is none.
// `keys` name the cameras.
std::optional<std::string> SuggestFramesByTime(
    const RigInput& input, const std::vector<ImageKeys>& keys);

// A rule that forms rigs from names that no folder distinguishes, such as
// left_0001.jpg and right_0001.jpg.
struct RigRuleSuggestion {
  std::string text;  // with the rule, ready to paste
  std::string rule;
  std::string cameras;  // in words
  // All rules whose cameras are called so and pair one to one, with one image
  // size each; several if cameras may be told apart at several positions.
  std::vector<std::string> certain_rules;
  // Whether a word of the names means a camera, so that chance is unlikely.
  bool is_likely = false;
};

// The cameras are the texts at one position of the names. Without these texts,
// most names are shared by several images, or the times in the names agree.
// nullopt if there is no such position.
std::optional<RigRuleSuggestion> SuggestRigRule(const RigInput& input);

// ---------------------------------------------------------------- scene

// Builds the scene in canonical order: merges equal cameras of a sensor,
// chooses reference sensors, drops sensors and frames without images. Throws
// Error if a sensor has two images in a frame, or images with different
// intrinsics.
Scene BuildScene(RigInput input, RigAssignment assignment,
                 const Context& context);

}  // namespace mgsfm
