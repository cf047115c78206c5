// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_checks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "base/format.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "scene/item_lists.h"
#include "scene/typical_pose.h"

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

using SensorPoses = std::map<std::pair<RigId, CameraId>, std::optional<Rigid3>>;

SensorPoses ReadSensorPoses(const std::vector<RigRow>& rigs,
                            const fs::path& folder) {
  SensorPoses sensor_from_rig;
  std::set<CameraId> cameras;
  for (const RigRow& rig : rigs) {
    for (const RigSensorRow& sensor : rig.sensors) {
      sensor_from_rig[{rig.id, sensor.camera_id}] = sensor.sensor_from_rig;
      if (cameras.insert(sensor.camera_id).second) continue;
      ThrowModelError(
          folder, "rig " + std::to_string(rig.id.value()) + " has camera " +
                      std::to_string(sensor.camera_id.value()) +
                      ", which it or another rig has already; write the model "
                      "again with the program that made it");
    }
  }
  return sensor_from_rig;
}

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
  explicit ObservationCheck(const Model& model)
      : model_(model),
        image_idx_of_id_(IndexById(model.poses.images)),
        camera_of_id_(IndexById(model.cameras)) {
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
    const int image_idx = image_idx_of_id_.at(o.image_id);
    const ModelImage& image = model_.poses.images[image_idx];
    const Camera& camera = model_.cameras[camera_of_id_.at(image.camera_id)];
    const auto pixel = ProjectToPixel(
        camera.model, camera.params.data(),
        Reinterpret(image.cam_from_world, convention) * point.point_in_world);
    return pixel &&
           (*pixel - model_.keypoints[image_idx][o.keypoint_idx].position_px)
                   .norm() <=
               kMaxErrorInSides * std::max(camera.width_px, camera.height_px);
  }

  const Model& model_;
  const std::map<ImageId, int> image_idx_of_id_;
  const std::map<CameraId, int> camera_of_id_;
  size_t size_ = 0;
  size_t step_ = 1;
};

// A rigidly mounted camera rotates by noise only, far below this bound.
// Independently moving cameras exceed it in most frames.
constexpr double kMaxRigRotationDeg = 5.0;
// Calibrations of one rig differ less: a camera that rotated by half of this is
// reported as moved. The shift is relative to the size of the rig.
constexpr double kMaxKnownRotationDeg = 1.0;
constexpr double kMaxKnownShift = 0.05;

}  // namespace

void CheckModelTables(const PoseModel& poses, const fs::path& folder) {
  if (poses.rigs.empty()) return;
  const double max_distance = kMaxContradiction * Extent(poses) + 1e-12;
  const SensorPoses sensor_from_rig = ReadSensorPoses(poses.rigs, folder);
  const auto image_of_id = IndexById(poses.images);
  std::set<ImageId> in_frames;
  for (const ModelFrame& frame : poses.frames) {
    for (const ImageId id : frame.image_ids) {
      const auto found = image_of_id.find(id);
      if (found == image_of_id.end()) continue;
      const ModelImage& image = poses.images[found->second];
      const auto fail = [&](const std::string& problem) {
        ThrowModelError(
            folder,
            "image '" + image.name + "' " + problem + " of its frame " +
                std::to_string(frame.id.value()) +
                "; if another program wrote the images, its rigs and frames "
                "are of an earlier model: remove the files rigs and frames, or "
                "set rig_name_rule or rig_config_path");
      };
      if (!in_frames.insert(id).second) fail("is in another frame, too, and");
      const auto sensor = sensor_from_rig.find({frame.rig_id, image.camera_id});
      if (sensor == sensor_from_rig.end()) {
        fail("has the camera " + std::to_string(image.camera_id.value()) +
             ", which is not in the rig");
      }
      if (!sensor->second) continue;
      const Rigid3 expected = *sensor->second * frame.rig_from_world;
      const double angle_rad =
          AngleBetween(expected.rotation, image.cam_from_world.rotation);
      const double distance =
          (expected.Center() - image.cam_from_world.Center()).norm();
      if (angle_rad <= kMaxContradiction && distance <= max_distance) continue;
      fail(Formatted("has a pose that differs by %.3g deg and %.3g from that",
                     RadToDeg(angle_rad), distance));
    }
  }
}

void AddModelTables(const PoseModel& poses, DatabaseContents* contents) {
  const auto image_of_id = IndexById(poses.images);
  for (const ModelFrame& frame : poses.frames) {
    FrameRow row{frame.id, frame.rig_id, {}};
    for (const ImageId id : frame.image_ids) {
      const auto image = image_of_id.find(id);
      if (image == image_of_id.end()) continue;
      row.data.push_back({poses.images[image->second].camera_id, id});
    }
    if (!row.data.empty()) contents->frames.push_back(std::move(row));
  }
  contents->rigs.insert(contents->rigs.end(), poses.rigs.begin(),
                        poses.rigs.end());
}

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

void ThrowModelError(const std::filesystem::path& folder,
                     const std::string& problem) {
  throw Error("model '" + folder.string() + "': " + problem);
}

std::vector<Point3D> PointsOf(const Model& model,
                              const std::vector<int>& image_idxs) {
  const auto image_of_id = IndexById(model.poses.images);
  std::vector<Point3D> points;
  points.reserve(model.points.size());
  for (const ModelPoint& from : model.points) {
    Point3D point{from.point_in_world, from.color, from.error_px, {}};
    for (const ModelObservation& o : from.track) {
      point.track.push_back({image_idxs[image_of_id.at(o.image_id)],
                             static_cast<int>(o.keypoint_idx)});
    }
    std::sort(point.track.begin(), point.track.end());
    points.push_back(std::move(point));
  }
  return points;
}

void RigPoses::EstimateSensors(OptionalPoses* poses) const {
  FillMissing(poses);
  CheckAllAreKnown(*poses);
}

void RigPoses::CheckKnownSensors() const {
  OptionalPoses poses(scene_.sensors.size());
  for (const Rig& rig : scene_.rigs) poses[rig.ref_sensor_idx] = Rigid3();
  FillMissing(&poses);
  CheckKnownSensors(poses);
}

void RigPoses::CheckKnownSensors(const OptionalPoses& poses) const {
  std::vector<double> size(scene_.rigs.size(), 0.0);
  for (const Sensor& sensor : scene_.sensors) {
    if (!sensor.sensor_from_rig) continue;
    size[sensor.rig_idx] = std::max(size[sensor.rig_idx],
                                    sensor.sensor_from_rig->translation.norm());
  }
  for (size_t i = 0; i < scene_.sensors.size(); ++i) {
    const Sensor& sensor = scene_.sensors[i];
    if (!sensor.sensor_from_rig || !poses[i]) continue;
    const double turn_deg = RadToDeg(
        AngleBetween(poses[i]->rotation, sensor.sensor_from_rig->rotation));
    const double shift =
        (poses[i]->translation - sensor.sensor_from_rig->translation).norm();
    if (turn_deg <= kMaxKnownRotationDeg &&
        shift <= kMaxKnownShift * size[sensor.rig_idx]) {
      continue;
    }
    const std::string numbers = Formatted(
        "%.2f deg and a shift of %.4g (known: %.4g, in the model: %.4g)",
        turn_deg, shift, sensor.sensor_from_rig->translation.norm(),
        poses[i]->translation.norm());
    ThrowModelError(folder_,
                    "the known pose of camera '" + sensor.name +
                        "' in its rig differs from that of the model by " +
                        numbers +
                        "; make the model again with the known rig, or omit "
                        "the pose");
  }
}

void RigPoses::FillMissing(OptionalPoses* poses) const {
  for (size_t num_left = scene_.sensors.size(); num_left > 0; --num_left) {
    for (size_t i = 0; i < scene_.sensors.size(); ++i) {
      if ((*poses)[i]) continue;
      const int sensor_idx = static_cast<int>(i);
      const std::vector<Rigid3> candidates = Candidates(sensor_idx, *poses);
      if (candidates.empty()) continue;
      (*poses)[i] = TypicalPose(candidates);
      CheckMovesLikeRig(sensor_idx, candidates, *(*poses)[i]);
    }
  }
}

void RigPoses::CheckAllAreKnown(const OptionalPoses& poses) const {
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    const int sensor_idx = scene_.images[i].sensor_idx;
    if (!cam_from_world_[i] || poses[sensor_idx]) continue;
    ThrowModelError(folder_,
                    "the pose of sensor '" + scene_.sensors[sensor_idx].name +
                        "' in its rig is unknown, as no frame has images of it "
                        "and of another sensor; give it with rig_config_path, "
                        "or treat images as single with rig_name_rule none");
  }
}

std::vector<Rigid3> RigPoses::Candidates(int sensor_idx,
                                         const OptionalPoses& poses) const {
  std::vector<Rigid3> candidates;
  for (const Frame& frame : scene_.frames) {
    std::optional<Rigid3> pose;
    std::optional<Rigid3> rig_from_world;
    for (const int image_idx : frame.image_idxs) {
      const int other_idx = scene_.images[image_idx].sensor_idx;
      const std::optional<Rigid3>& cam_from_world = cam_from_world_[image_idx];
      if (!cam_from_world) continue;
      if (other_idx == sensor_idx) {
        pose = cam_from_world;
      } else if (poses[other_idx] && !rig_from_world) {
        rig_from_world = poses[other_idx]->Inverse() * *cam_from_world;
      }
    }
    if (!pose || !rig_from_world) continue;
    candidates.push_back(*pose * rig_from_world->Inverse());
  }
  return candidates;
}

void RigPoses::CheckMovesLikeRig(int sensor_idx,
                                 const std::vector<Rigid3>& candidates,
                                 const Rigid3& pose) const {
  std::vector<double> angles_deg;
  for (const Rigid3& candidate : candidates) {
    angles_deg.push_back(
        RadToDeg(AngleBetween(candidate.rotation, pose.rotation)));
  }
  if (Median(angles_deg) < kMaxRigRotationDeg) return;
  ThrowModelError(
      folder_, "images of '" + scene_.sensors[sensor_idx].name +
                   "' rotate relative to the other images of their frames, so "
                   "the cameras are not rigid or the frames are wrong; define "
                   "the frames with rig_name_rule, or treat images as "
                   "single with rig_name_rule none");
}

OptionalPoses RigPoses::PlaceFrames(
    const OptionalPoses& sensor_from_rig) const {
  OptionalPoses rig_from_world;
  for (const Frame& frame : scene_.frames) {
    std::optional<int> best;
    for (const int image_idx : frame.image_idxs) {
      if (!cam_from_world_[image_idx]) continue;
      if (!best || scene_.IsReference(scene_.images[image_idx].sensor_idx)) {
        best = image_idx;
      }
    }
    rig_from_world.emplace_back();
    if (!best) continue;
    const Rigid3& sensor = *sensor_from_rig[scene_.images[*best].sensor_idx];
    rig_from_world.back() = sensor.Inverse() * *cam_from_world_[*best];
  }
  return rig_from_world;
}

}  // namespace mgsfm
