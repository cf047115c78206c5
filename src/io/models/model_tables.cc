// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_tables.h"

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "base/format.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Largest difference of two copies of a pose, in radians and model extents.
// Six-digit text files round by 1e-6; contradictions are far larger.
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

}  // namespace mgsfm
