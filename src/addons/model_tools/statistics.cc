// SPDX-License-Identifier: BSD-3-Clause
#include <optional>
#include <set>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/model_tools/model_tools.h"
#include "model_tools/point_removal.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// nullopt if the point does not project into the image.
std::optional<double> ReprojectionErrorPx(const SceneModel& model,
                                          const Eigen::Vector3d& point_in_world,
                                          const Observation& o) {
  const Image& image = model.scene.images[o.image_idx];
  const Camera& camera =
      model.reconstruction
          .cameras[model.scene.sensors[image.sensor_idx].camera_idx];
  const auto pose = model.reconstruction.CamFromWorld(model.scene, o.image_idx);
  if (!pose) return std::nullopt;
  const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                    *pose * point_in_world);
  if (!pixel) return std::nullopt;
  return (*pixel - image.keypoints_px[o.keypoint_idx].cast<double>()).norm();
}

}  // namespace

void RemoveLargeErrors(double max_error_px, SceneModel* model) {
  std::vector<Point3D>& points = model->reconstruction.points;
  for (Point3D& point : points) {
    double sum_px = 0.0;
    size_t num_kept = 0;
    for (const Observation& o : point.track) {
      const auto error_px =
          ReprojectionErrorPx(*model, point.point_in_world, o);
      if (!error_px || *error_px > max_error_px) continue;
      point.track[num_kept++] = o;
      sum_px += *error_px;
    }
    point.track.resize(num_kept);
    point.track.shrink_to_fit();
    if (num_kept > 0) point.error_px = sum_px / static_cast<double>(num_kept);
  }
  RemovePointsOfShortTracks(&points);
}

ModelStatistics AnalyzeModel(const SceneModel& model) {
  const Scene& scene = model.scene;
  std::set<int> rig_idxs, camera_idxs, frame_idxs;
  ModelStatistics statistics;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (!model.reconstruction.IsRegistered(scene, static_cast<int>(i))) {
      continue;
    }
    const Sensor& sensor = scene.sensors[scene.images[i].sensor_idx];
    rig_idxs.insert(sensor.rig_idx);
    camera_idxs.insert(sensor.camera_idx);
    frame_idxs.insert(scene.images[i].frame_idx);
    ++statistics.num_images;
  }
  statistics.num_rigs = rig_idxs.size();
  statistics.num_cameras = camera_idxs.size();
  statistics.num_frames = frame_idxs.size();
  statistics.num_points = model.reconstruction.points.size();
  statistics.num_observations = NumObservations(model.reconstruction);
  const auto mean = [](size_t sum, size_t count) {
    return count == 0 ? 0.0
                      : static_cast<double>(sum) / static_cast<double>(count);
  };
  statistics.mean_track_length =
      mean(statistics.num_observations, statistics.num_points);
  statistics.mean_observations_per_image =
      mean(statistics.num_observations, statistics.num_images);
  statistics.mean_reprojection_error_px =
      MeanReprojectionErrorPx(model.reconstruction);
  return statistics;
}

}  // namespace mgsfm
