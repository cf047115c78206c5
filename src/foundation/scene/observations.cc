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
    groups.observations.insert(groups.observations.end(), point.track.begin(),
                               point.track.end());
    groups.FinishGroup();
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

RayMatches RaysOf(const Bearings& bearings, const ImagePair& pair) {
  RayMatches rays;
  rays.Reserve(pair.matches.size());
  for (const Match& match : pair.matches) {
    const int keypoint1 = static_cast<int>(match.keypoint_idx1);
    const int keypoint2 = static_cast<int>(match.keypoint_idx2);
    if (!bearings.HasRay(pair.image_idx1, keypoint1) ||
        !bearings.HasRay(pair.image_idx2, keypoint2)) {
      continue;
    }
    rays.Add(bearings.Ray(pair.image_idx1, keypoint1),
             bearings.Ray(pair.image_idx2, keypoint2));
  }
  return rays;
}

}  // namespace mgsfm
