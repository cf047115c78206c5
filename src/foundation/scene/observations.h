// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/epipolar.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

size_t NumObservations(const std::vector<Point3D>& points);
inline size_t NumObservations(const Reconstruction& reconstruction) {
  return NumObservations(reconstruction.points);
}

// A lower bound on the keypoint noise. Keypoint detectors do not localize
// better, and the noise of exact (synthetic) keypoints must not become zero.
inline constexpr double kMinKeypointSigmaPx = 0.05;

// The observations of each point, as candidates for an adjustment.
ObservationGroups GroupTracks(const std::vector<Point3D>& points);

// The mean over the observations of all points with a known error; nullopt
// without such points.
std::optional<double> MeanReprojectionErrorPx(
    const Reconstruction& reconstruction);

// Whether one sensor took both images of a pair.
inline bool IsOfOneSensor(const Scene& scene, const ImagePair& pair) {
  return scene.images[pair.image_idx1].sensor_idx ==
         scene.images[pair.image_idx2].sensor_idx;
}

// The projection of a point minus the keypoint that observes it; nullopt if the
// image has no pose or does not see the point.
std::optional<Eigen::Vector2d> ResidualPx(
    const Scene& scene, const Reconstruction& reconstruction,
    const Observation& observation, const Eigen::Vector3d& point_in_world);

// Calls function(match, ray1, ray2) for the matches of a pair whose keypoints
// both have a ray.
template <typename Function>
void ForEachRays(const Bearings& bearings, const ImagePair& pair,
                 const Function& function) {
  for (const Match& match : pair.matches) {
    const auto keypoint1 = static_cast<int>(match.keypoint_idx1);
    const auto keypoint2 = static_cast<int>(match.keypoint_idx2);
    if (!bearings.HasRay(pair.image_idx1, keypoint1) ||
        !bearings.HasRay(pair.image_idx2, keypoint2)) {
      continue;
    }
    function(match, bearings.Ray(pair.image_idx1, keypoint1),
             bearings.Ray(pair.image_idx2, keypoint2));
  }
}

// These rays.
RayMatches RaysOf(const Bearings& bearings, const ImagePair& pair);

}  // namespace mgsfm
