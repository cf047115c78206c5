// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/ids.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// What is given before reconstruction: plain data, filled by io, const to all
// stages. Arrays refer to each other by dense positions (`_idx`); ids are only
// kept to write results under the names that users know.
//
// The order of all arrays is canonical: images by name, everything else by its
// first image in that order. It does not depend on any id, so neither does any
// result.

// Intrinsics, shared by all images that refer to them.
struct Camera {
  CameraId id;
  CameraModelId model;
  int width_px = 0;
  int height_px = 0;
  std::vector<double> params;
  bool has_prior_focal_length = false;
};

// One place in a rig where a camera is mounted. Sensors are what a rig is made
// of; several may share the intrinsics of one camera.
struct Sensor {
  std::string name;  // of its image folder or prefix, "" for a flat folder
  int rig_idx = 0;
  int camera_idx = 0;
  // The pose in the rig when it is known beforehand; identity for the
  // reference sensor; nullopt when it is to be estimated.
  std::optional<Rigid3> sensor_from_rig;
};

// A set of rigidly mounted sensors. One camera is a rig with one sensor.
struct Rig {
  RigId id;
  int ref_sensor_idx = 0;  // its frame is the rig's frame
  std::vector<int> sensor_idxs;
};

// The rig at one instant: a rigid unit. Any subset of the sensors may have
// taken an image.
struct Frame {
  FrameId id;
  std::string name;  // the part of its images' names that they share
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
  // When it was taken, as its camera says.
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

// Throws ContractError unless all positions are in range and agree: images with
// frames, frames with rigs, sensors with rigs, at most one image of a sensor in
// a frame, parameter counts with models, identity for reference sensors.
void CheckConsistent(const Scene& scene);

// The time of a frame: that of its image of the reference sensor, or the mean
// of those of its images if there is none. All images must have one.
double TimeOfFrame(const Scene& scene, int frame_idx);

// The scene without rigs: every sensor is one of its own, and every image is a
// frame of its own with the name of the image. Images, and so the pairs of a
// view graph, keep their positions.
Scene SeparateImages(Scene scene);

// Unit rays in the camera frame of all keypoints; nullopt-like NaN never
// occurs: a keypoint without a ray has a zero vector and HasRay() is false.
struct Bearings {
  std::vector<std::vector<Eigen::Vector3d>> rays;  // [image_idx][keypoint_idx]

  bool HasRay(int image_idx, int keypoint_idx) const {
    return rays[image_idx][keypoint_idx].squaredNorm() > 0.5;
  }
};

// By the given cameras, in place of those of the scene, and by its own.
Bearings ComputeBearings(const Scene& scene, const std::vector<Camera>& cameras,
                         int num_threads);
Bearings ComputeBearings(const Scene& scene, int num_threads);

}  // namespace mgsfm
