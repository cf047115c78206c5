// SPDX-License-Identifier: BSD-3-Clause
#include "scene/observations.h"

namespace mgsfm {

size_t NumObservations(const std::vector<Point3D>& points) {
  size_t num_observations = 0;
  for (const Point3D& point : points) num_observations += point.track.size();
  return num_observations;
}

ObservationGroups GroupTracks(const std::vector<Point3D>& points) {
  ObservationGroups groups;
  groups.observations.reserve(NumObservations(points));
  groups.offsets.reserve(points.size() + 1);
  for (const Point3D& point : points) {
    groups.AddGroup(point.track.data(),
                    point.track.data() + point.track.size());
  }
  return groups;
}

std::optional<double> MeanReprojectionErrorPx(
    const Reconstruction& reconstruction) {
  size_t num_errors = 0;
  double sum_px = 0.0;
  for (const Point3D& point : reconstruction.points) {
    if (!point.error_px) continue;
    num_errors += point.track.size();
    sum_px += *point.error_px * static_cast<double>(point.track.size());
  }
  if (num_errors == 0) return std::nullopt;
  return sum_px / static_cast<double>(num_errors);
}

std::optional<Eigen::Vector2d> ResidualPx(
    const Scene& scene, const Reconstruction& reconstruction,
    const Observation& observation, const Eigen::Vector3d& point_in_world) {
  const auto pose = reconstruction.CamFromWorld(scene, observation.image_idx);
  if (!pose) return std::nullopt;
  const Image& image = scene.images[observation.image_idx];
  const Camera& camera = reconstruction.cameras[image.camera_idx];
  const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                    *pose * point_in_world);
  if (!pixel) return std::nullopt;
  return *pixel - image.keypoints_px[observation.keypoint_idx].cast<double>();
}

RayMatches RaysOf(const Bearings& bearings, const ImagePair& pair) {
  RayMatches rays;
  rays.Reserve(pair.matches.size());
  ForEachRays(bearings, pair,
              [&](const Match&, const auto& ray1, const auto& ray2) {
                rays.Add(ray1, ray2);
              });
  return rays;
}

}  // namespace mgsfm
