// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/ids.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The input of a reconstruction: plain data that io creates and stages do not
// modify. Arrays refer to each other by dense indices (`_idx`). Ids identify
// items in input and output files only.
//
// All arrays are in canonical order: images by name, frames as in
// OrderOfFrames, everything else by its first image. Results therefore do not
// depend on ids.

// Intrinsics, shared by all images that refer to them.
struct Camera {
  CameraId id;
  CameraModelId model;
  int width_px = 0;
  int height_px = 0;
  std::vector<double> params;
  bool has_prior_focal_length = false;
};

// A camera mounted in a rig. Several sensors may share the intrinsics of one
// Camera.
struct Sensor {
  std::string name;  // image folder or prefix; "" for a flat folder
  int rig_idx = 0;
  int camera_idx = 0;
  // The known pose in the rig, identity for the reference sensor; nullopt if it
  // is estimated.
  std::optional<Rigid3> sensor_from_rig;
};

// A set of rigidly mounted sensors. A single camera is a rig with one sensor.
struct Rig {
  RigId id;
  int ref_sensor_idx = 0;  // its camera frame is the frame of the rig
  std::vector<int> sensor_idxs;
};

// A rig at one instant. Any subset of its sensors may have an image.
struct Frame {
  FrameId id;
  std::string name;  // common part of the names of its images
  int rig_idx = 0;
  std::vector<int> image_idxs;
};

struct Image {
  ImageId id;
  std::string name;
  int camera_idx = 0;
  int sensor_idx = 0;
  int frame_idx = 0;
  std::vector<Eigen::Vector2f> keypoints_px;
  // Capture time on the clock of the camera.
  std::optional<double> timestamp_s = std::nullopt;
};

struct Scene {
  std::vector<Camera> cameras;
  std::vector<Rig> rigs;
  std::vector<Sensor> sensors;
  std::vector<Frame> frames;
  std::vector<Image> images;

  bool IsReference(int sensor_idx) const {
    return rigs[sensors[sensor_idx].rig_idx].ref_sensor_idx == sensor_idx;
  }
};

// Throws ContractError unless all indices are in range and consistent, each
// frame has at most one image per sensor, the number of parameters matches the
// camera model, and the poses of reference sensors are the identity.
void CheckConsistent(const Scene& scene);

// The capture time of a frame: the time of the image of the reference sensor,
// or the mean over its images if there is none. All images must have a
// timestamp.
double TimeOfFrame(const Scene& scene, int frame_idx);

// The frames, sequence by sequence. A sequence is a rig of several sensors, or
// the single images of a folder. Sequences are ordered by the name of their
// first image; frames of a sequence by time if all images have one, otherwise
// by name in natural order ("9" before "10").
std::vector<int> OrderOfFrames(const Scene& scene);

// Sorts the frames in that order. Returns the previous index of each.
std::vector<int> SortFrames(Scene* scene);

// The id of a camera and the sensors that use it, for messages.
std::string CameraLabel(const Scene& scene, int camera_idx);

// The scene without rigs: every sensor becomes a rig, and every image a frame
// with the name of the image. Indices of images do not change, so view graphs
// remain valid.
Scene SeparateImages(Scene scene);

// For rigs that changed during a drive: moves `frame_name` and all frames after
// it, by name, to rigs of their own with unknown sensor poses. Indices of
// images and frames do not change. Throws Error unless the frame exists and its
// rig has frames before it.
Scene SplitRig(Scene scene, const std::string& frame_name);

// Unit rays of the keypoints of one image, in the camera frame. A keypoint
// outside the domain of the camera model has no ray.
struct KeypointRays {
  std::vector<Eigen::Vector3d> rays;  // zero where is_valid is false
  Mask is_valid;

  size_t size() const { return rays.size(); }
  void Append(const std::optional<Eigen::Vector3d>& ray) {
    rays.push_back(ray.value_or(Eigen::Vector3d::Zero()));
    is_valid.push_back(ray.has_value());
  }
};

KeypointRays ComputeKeypointRays(
    const Camera& camera, const std::vector<Eigen::Vector2f>& keypoints_px);

// The rays of all keypoints of a scene.
struct Bearings {
  std::vector<KeypointRays> images;

  bool HasRay(int image_idx, int keypoint_idx) const {
    return images[image_idx].is_valid[keypoint_idx];
  }
  // Unit length if HasRay(), zero otherwise.
  const Eigen::Vector3d& Ray(int image_idx, int keypoint_idx) const {
    return images[image_idx].rays[keypoint_idx];
  }
};

// `cameras` replaces scene.cameras. Parallel over images.
Bearings ComputeBearings(const Scene& scene, const std::vector<Camera>& cameras,
                         int num_threads);
Bearings ComputeBearings(const Scene& scene, int num_threads);

}  // namespace mgsfm
