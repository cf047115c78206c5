// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_checks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "base/format.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Largest difference between two copies of a pose, in radians and model
// extents. Six-digit text files round by 1e-6; contradictions are far larger.
constexpr double kMaxContradiction = 1e-4;

double Extent(const PoseModel& poses) {
  Eigen::AlignedBox3d box;
  for (const ModelImage& image : poses.images) {
    box.extend(image.cam_from_world.Center());
  }
  return box.diagonal().norm();
}

class TableCheck {
 public:
  TableCheck(const PoseModel& poses, const fs::path& folder)
      : folder_(folder),
        max_distance_(kMaxContradiction * Extent(poses) + 1e-12) {
    std::set<CameraId> cameras;
    for (const ModelRig& rig : poses.rigs) {
      for (const ModelSensor& sensor : rig.sensors) {
        sensor_from_rig_[{rig.id, sensor.camera_id}] = sensor.sensor_from_rig;
        if (cameras.insert(sensor.camera_id).second) continue;
        throw Error("model '" + folder.string() + "': rig " +
                    std::to_string(rig.id.value()) + " has camera " +
                    std::to_string(sensor.camera_id.value()) +
                    ", which it or another rig has already; write the model "
                    "again with the program that made it");
      }
    }
    for (const ModelImage& image : poses.images) {
      image_of_id_.emplace(image.id, &image);
    }
  }

  void Check(const ModelFrame& frame) {
    for (const ImageId id : frame.image_ids) {
      const auto image = image_of_id_.find(id);
      if (image != image_of_id_.end()) CheckImage(frame, *image->second);
    }
  }

 private:
  void CheckImage(const ModelFrame& frame, const ModelImage& image);
  [[noreturn]] void Throw(const ModelFrame& frame, const ModelImage& image,
                          const std::string& problem) const {
    throw Error("model '" + folder_.string() + "': image '" + image.name +
                "' " + problem + " of its frame " +
                std::to_string(frame.id.value()) +
                "; if another program wrote the images, its rigs and frames "
                "are of an earlier model: remove the files rigs and frames, or "
                "set rig_name_rule or rig_config_path");
  }

  const fs::path& folder_;
  const double max_distance_;
  std::map<std::pair<RigId, CameraId>, std::optional<Rigid3>> sensor_from_rig_;
  std::map<ImageId, const ModelImage*> image_of_id_;
  std::set<ImageId> in_frames_;
};

void TableCheck::CheckImage(const ModelFrame& frame, const ModelImage& image) {
  if (!in_frames_.insert(image.id).second) {
    Throw(frame, image, "is in another frame, too, and");
  }
  const auto sensor = sensor_from_rig_.find({frame.rig_id, image.camera_id});
  if (sensor == sensor_from_rig_.end()) {
    Throw(frame, image,
          "has the camera " + std::to_string(image.camera_id.value()) +
              ", which is not in the rig");
  }
  if (!sensor->second) return;
  const Rigid3 expected = *sensor->second * frame.rig_from_world;
  const double angle_rad =
      AngleBetween(expected.rotation, image.cam_from_world.rotation);
  const double distance =
      (expected.Center() - image.cam_from_world.Center()).norm();
  if (angle_rad <= kMaxContradiction && distance <= max_distance_) return;
  const std::string numbers =
      Formatted("has a pose that differs by %.3g deg and %.3g from that",
                RadToDeg(angle_rad), distance);
  Throw(frame, image, numbers);
}

}  // namespace

void CheckModelTables(const PoseModel& poses, const fs::path& folder) {
  if (poses.rigs.empty()) return;
  TableCheck check(poses, folder);
  for (const ModelFrame& frame : poses.frames) check.Check(frame);
}

void AddModelTables(const PoseModel& poses, DatabaseContents* contents) {
  std::map<ImageId, CameraId> camera_of_image;
  for (const ModelImage& image : poses.images) {
    camera_of_image.emplace(image.id, image.camera_id);
  }
  for (const ModelFrame& frame : poses.frames) {
    FrameRow row{frame.id, frame.rig_id, {}};
    for (const ImageId id : frame.image_ids) {
      const auto image = camera_of_image.find(id);
      if (image == camera_of_image.end()) continue;
      row.data.push_back({image->second, id});
    }
    if (!row.data.empty()) contents->frames.push_back(std::move(row));
  }
  for (const ModelRig& rig : poses.rigs) {
    RigRow row{rig.id, {}, {}};
    for (const ModelSensor& sensor : rig.sensors) {
      if (sensor.is_reference) row.ref_camera_id = sensor.camera_id;
      row.sensors.push_back({sensor.camera_id, sensor.sensor_from_rig});
    }
    contents->rigs.push_back(std::move(row));
  }
}

namespace {

// Determines a fraction within 1 % at constant cost.
constexpr size_t kMaxNumChecked = 10000;

struct PoseConvention {
  const char* remedy;
  bool is_xyzw;
  bool is_world_from_cam;
};

constexpr PoseConvention kPoseConventions[] = {
    {"", false, false},
    {"quaternions in the order x y z w; write them as w x y z", true, false},
    {"poses world_from_cam; write their inverses, cam_from_world", false, true},
    {"poses world_from_cam with quaternions in the order x y z w; write their "
     "inverses, cam_from_world, with w x y z",
     true, true}};

Rigid3 Reinterpret(Rigid3 pose, const PoseConvention& convention) {
  if (convention.is_xyzw) pose.rotation = FromOrderXyzw(pose.rotation);
  return convention.is_world_from_cam ? pose.Inverse() : pose;
}

// The observations of a model, or an evenly spaced selection.
class ObservationCheck {
 public:
  explicit ObservationCheck(const Model& model) : model_(model) {
    for (size_t i = 0; i < model.poses.images.size(); ++i) {
      image_idx_of_id_.emplace(model.poses.images[i].id, i);
    }
    for (const Camera& camera : model.cameras) {
      camera_of_id_.emplace(camera.id, &camera);
    }
    for (const ModelPoint& point : model.points) size_ += point.track.size();
    step_ = std::max<size_t>(1, size_ / kMaxNumChecked);
  }

  size_t NumChecked() const { return (size_ + step_ - 1) / step_; }

  // Number of checked observations near the projections of their points.
  size_t CountFitting(const PoseConvention& convention) const {
    size_t count = 0, number = 0;
    for (const ModelPoint& point : model_.points) {
      for (const ModelObservation& o : point.track) {
        if (number++ % step_ == 0) count += Fits(point, o, convention);
      }
    }
    return count;
  }

 private:
  bool Fits(const ModelPoint& point, const ModelObservation& o,
            const PoseConvention& convention) const {
    // Far above the errors of models before bundle adjustment.
    constexpr double kMaxErrorInSides = 0.05;
    const size_t image_idx = image_idx_of_id_.at(o.image_id);
    const ModelImage& image = model_.poses.images[image_idx];
    const Camera& camera = *camera_of_id_.at(image.camera_id);
    const auto pixel = ProjectToPixel(
        camera.model, camera.params.data(),
        Reinterpret(image.cam_from_world, convention) * point.point_in_world);
    return pixel &&
           (*pixel - model_.keypoints[image_idx][o.keypoint_idx].position_px)
                   .norm() <=
               kMaxErrorInSides * std::max(camera.width_px, camera.height_px);
  }

  const Model& model_;
  std::map<ImageId, size_t> image_idx_of_id_;
  std::map<CameraId, const Camera*> camera_of_id_;
  size_t size_ = 0;
  size_t step_ = 1;
};

}  // namespace

void CheckObservations(const Model& model, const std::filesystem::path& folder,
                       const Context& context) {
  constexpr size_t kMinNumChecked = 20;  // chance explains few
  const ObservationCheck check(model);
  const size_t num_checked = check.NumChecked();
  if (num_checked < kMinNumChecked) return;
  const size_t num_fitting = check.CountFitting(kPoseConventions[0]);
  const size_t num_misfits = num_checked - num_fitting;
  // Correct models have fewer wrong matches.
  if (10 * num_misfits <= num_checked) return;
  const std::string problem =
      "model '" + folder.string() + "': only " + std::to_string(num_fitting) +
      " of " + std::to_string(num_checked) +
      " checked keypoints are within 5 % of the image of the projections of "
      "their points";
  for (const PoseConvention& convention : kPoseConventions) {
    const size_t num = check.CountFitting(convention);
    if (2 * (num_checked - num) >= num_misfits) continue;
    throw Error(problem + ", but " + std::to_string(num) + " if images have " +
                convention.remedy);
  }
  if (2 * num_misfits <= num_checked) return;
  context.Warning(problem +
                  "; the files images, cameras and points3D are "
                  "probably not of one model");
}

}  // namespace mgsfm
