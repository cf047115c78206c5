// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// What points and observations to keep. Observations in images without pose
// are always removed; none of these changes a pose or a point.

size_t NumObservations(const Reconstruction& reconstruction);

// A lower bound of the noise of keypoints. Keypoint detectors do not localise
// better, and the noise of exact (synthetic) keypoints must not become zero.
constexpr double kMinKeypointSigmaPx = 0.05;

// Distances in pixels of all observations of registered images, point by
// point; infinite where the camera cannot see the point.
std::vector<double> ReprojectionErrors(const Scene& scene,
                                       const Reconstruction& reconstruction,
                                       int num_threads);

// Standard deviation of the noise of each coordinate of the keypoints, from the
// median of the errors. A point takes 3 of the 2n residuals of its track, so
// that the errors of a short one are smaller than the noise: they count
// sqrt(2n / (2n - 3)) times. 0 without points of two observations.
double NoiseSigmaPx(const Scene& scene, const Reconstruction& reconstruction,
                    int num_threads);

struct PointFilterOptions {
  double max_error_px = 4.0;
  int min_num_observations = 2;
  double min_angle_rad = 0.0;  // largest angle between any two rays
  double min_two_view_angle_rad = 0.0;
  double min_group_share = 0.0;  // only where points are triangulated anew
  // From the nearest camera that sees the point.
  double max_distance = std::numeric_limits<double>::infinity();
  double min_two_view_distance = 0.0;
};

// Whether a point seen from these centers has enough parallax and is neither
// too far away nor, with two of them, too near.
bool IsWellPlaced(const std::vector<Eigen::Vector3d>& centers,
                  const Eigen::Vector3d& point,
                  const PointFilterOptions& options);

// Removes observations with larger errors, then points with too few
// observations or in a bad place.
void FilterPoints(const Scene& scene, const PointFilterOptions& options,
                  int num_threads, Reconstruction* reconstruction);

// From the point to the nearest of the centers.
double NearestDistance(const std::vector<Eigen::Vector3d>& centers,
                       const Eigen::Vector3d& point);

// The median of NearestDistance over all points, to registered images;
// infinite without points.
double MedianDistance(const Scene& scene, const Reconstruction& reconstruction,
                      int num_threads);

// Sets Point3D::error_px, over the observations that can be computed.
void ComputePointErrors(const Scene& scene, int num_threads,
                        Reconstruction* reconstruction);

}  // namespace mgsfm
