// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/ids.h"
#include "mgsfm/base/options.h"
#include "mgsfm/database/database.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class ModelFormat { kBinary, kText };

template <>
struct EnumTable<ModelFormat> {
  static constexpr std::pair<std::string_view, ModelFormat> kNames[] = {
      {"bin", ModelFormat::kBinary}, {"txt", ModelFormat::kText}};
};

// Writes a COLMAP sparse model into an existing folder: cameras, images,
// points3D, rigs and frames, as .bin or .txt. COLMAP before 3.12 ignores the
// last two files. Only registered images are written, with all their keypoints,
// so that the model fits the database. Ids are those of the scene, points are
// numbered from 1.
//
// COLMAP tells the sensors of a rig apart by camera id. Where several sensors
// share one camera, all but the first get a copy of it under an unused id, and
// their images refer to the copy.
//
// Throws Error, naming the file, if one cannot be written completely; naming
// the element, if a camera, pose or point is not finite or exceeds 1e15, which
// readers reject; and for the reasons of CheckFormat.
void WriteModel(const std::filesystem::path& folder, const Scene& scene,
                const Reconstruction& reconstruction, ModelFormat format,
                const Context& context = {});

// Throws Error, naming the image, if the format cannot represent its name: in
// text, names end at the first blank.
void CheckFormat(const Scene& scene, ModelFormat format);
void CheckFormat(const std::string& image_name, ModelFormat format);

// The poses of a model, without intrinsics, keypoints and points.
struct ModelImage {
  ImageId id;
  std::string name;
  CameraId camera_id;
  Rigid3 cam_from_world;
};

struct ModelFrame {
  FrameId id;
  RigId rig_id;
  Rigid3 rig_from_world;
  std::vector<ImageId> image_ids;
};

// Image poses are those of the images file; the frames and rigs files of all
// writers agree with them.
struct PoseModel {
  std::vector<ModelImage> images;  // sorted by name
  std::vector<RigRow> rigs;        // empty if the model has none (COLMAP 3.8)
  std::vector<ModelFrame> frames;  // likewise
};

// Reads images, rigs and frames of a COLMAP model, text or binary (which is
// preferred if both are there), without keypoints. Throws Error, naming the
// file, if it is missing, truncated or otherwise unreadable.
PoseModel ReadModelPoses(const std::filesystem::path& folder);

struct ModelKeypoint {
  Eigen::Vector2d position_px;
  std::optional<uint64_t> point_id;
};

struct ModelObservation {
  ImageId image_id;
  uint32_t keypoint_idx;
};

struct ModelPoint {
  uint64_t id = 0;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix<uint8_t, 3, 1> color = Eigen::Matrix<uint8_t, 3, 1>::Zero();
  std::optional<double> error_px;  // mean reprojection error
  std::vector<ModelObservation> track;
};

struct Model {
  PoseModel poses;
  std::vector<Camera> cameras;                        // sorted by id
  std::vector<std::vector<ModelKeypoint>> keypoints;  // of poses.images
  std::vector<ModelPoint> points;                     // sorted by id
};

// Reads a whole model. Also throws Error if an image has no camera, or if
// points and keypoints do not refer to each other. All model readers reject
// cameras, poses and points that WriteModel would reject, and names that are
// not UTF-8 or have control characters.
Model ReadModel(const std::filesystem::path& folder);

}  // namespace mgsfm
