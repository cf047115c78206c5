// SPDX-License-Identifier: BSD-3-Clause
#include "models/observation_check.h"

#include <algorithm>
#include <map>
#include <string>

#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Enough for a share within 1 %, and a constant cost.
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

// The observations of a model, or an even selection of them.
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
    // Far beyond the errors of models before bundle adjustment.
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
  // Wrong matches of sound models are fewer.
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
