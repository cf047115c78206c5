// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "scene/observations.h"

namespace mgsfm {

// Projects world points into an image. Refers to the reconstruction from which
// it was made.
struct ImageView {
  bool is_registered = false;
  Eigen::Matrix3d cam_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  CameraModelId model = CameraModelId::kPinhole;
  const double* params = nullptr;  // set if the image is registered

  // nullopt if the camera cannot see the point.
  std::optional<Eigen::Vector2d> Project(
      const Eigen::Vector3d& point,
      Eigen::Matrix<double, 2, 3>* jacobian_point = nullptr) const {
    return ProjectToPixel(model, params, cam_from_world * (point - center),
                          jacobian_point);
  }
  // Distance in pixels; infinite if the camera cannot see the point.
  double ReprojectionError(const Eigen::Vector3d& point,
                           const Eigen::Vector2d& pixel) const;
};

ImageView MakeImageView(const Scene& scene,
                        const Reconstruction& reconstruction, int image_idx);

// Per image of the scene.
std::vector<ImageView> MakeImageViews(const Scene& scene,
                                      const Reconstruction& reconstruction);

// The error of one observation, in pixels; infinite if the camera does not see
// the point. `views` are those of MakeImageViews().
double ReprojectionError(const Scene& scene,
                         const std::vector<ImageView>& views,
                         const Observation& o, const Eigen::Vector3d& point);

// Selection of points and observations. No function changes a pose or moves a
// point. Observations in images without a pose are always removed.

// Reprojection errors in pixels of all observations in registered images, point
// by point; infinite if the camera cannot see the point.
std::vector<double> ReprojectionErrors(const Scene& scene,
                                       const Reconstruction& reconstruction,
                                       int num_threads);

// Standard deviation of each coordinate of the keypoints, from the median of
// the reprojection errors. A point with n observations absorbs 3 of their 2n
// degrees of freedom, so its errors are multiplied by sqrt(2n / (2n - 3)). 0 if
// no point has two observations.
double NoiseSigmaPx(const Scene& scene, const Reconstruction& reconstruction,
                    int num_threads);

// The same, at least kMinKeypointSigmaPx.
inline double KeypointSigmaPx(const Scene& scene,
                              const Reconstruction& reconstruction,
                              int num_threads) {
  return std::max(kMinKeypointSigmaPx,
                  NoiseSigmaPx(scene, reconstruction, num_threads));
}

// NoiseSigmaPx() from the sums of squared errors of points. For n observations,
// the sum is sigma^2 times a chi-square variable with 2n - 3 degrees of
// freedom; sigma^2 is the median of all sums, each divided by the median of its
// distribution. NoiseSigmaPx() is up to 20 % smaller, because the residuals of
// a point in two images have one dimension instead of four.
double UnbiasedNoiseSigmaPx(const Scene& scene,
                            const Reconstruction& reconstruction,
                            int num_threads);

struct PointFilterOptions {
  double max_error_px = 4.0;
  // Bound on the root mean square reprojection error of a point.
  double max_rms_error_px = std::numeric_limits<double>::infinity();
  int min_num_observations = 2;
  double min_angle_rad = 0.0;  // largest angle between any two rays
  double min_two_view_angle_rad = 0.0;
  double min_group_share = 0.0;  // only for retriangulation
  // Distances from the nearest camera that observes the point.
  double max_distance = std::numeric_limits<double>::infinity();
  // The same for points that only one image per frame observes, in sensors that
  // share most distant points with another sensor.
  double max_distance_of_one_image = std::numeric_limits<double>::infinity();
  Mask sensor_measures_distances = {};  // per sensor; empty: none does
  double min_two_view_distance = 0.0;
};

// Whether a point that is observed from these centers has a sufficient
// triangulation angle and an admissible distance.
bool IsWellPlaced(const std::vector<Eigen::Vector3d>& centers,
                  const Eigen::Vector3d& point,
                  const PointFilterOptions& options);

// Whether a frame observes a track with two images.
bool IsSeenTwice(const Scene& scene, const std::vector<Observation>& track);

// Whether a point at this distance from the nearest center is admissible by
// max_distance_of_one_image. To a single camera, a vehicle at a constant
// distance looks like a distant point.
bool IsDistanceMeasured(const Scene& scene,
                        const std::vector<Observation>& track, double distance,
                        const PointFilterOptions& options);

// Per sensor: whether frames observe most of its points beyond a distance with
// two images. `distances` comes from PointDistances().
Mask FindSensorsThatMeasure(const Scene& scene,
                            const Reconstruction& reconstruction,
                            const std::vector<double>& distances,
                            double min_distance);

// Whether n observations of a point with this sum of squared errors satisfy
// max_rms_error_px.
bool IsPrecise(double sum_of_squares_px2, size_t num_observations,
               const PointFilterOptions& options);

// Removes observations with too large errors, then points with too few
// observations, with too large errors overall, or that are not well placed.
void FilterPoints(const Scene& scene, const PointFilterOptions& options,
                  int num_threads, Reconstruction* reconstruction);

// The distance from a point to the nearest center.
double NearestDistance(const std::vector<Eigen::Vector3d>& centers,
                       const Eigen::Vector3d& point);

// Per point: the distance to the nearest registered image that observes it.
std::vector<double> PointDistances(const Scene& scene,
                                   const Reconstruction& reconstruction,
                                   int num_threads);

// The median of these distances; infinite without points.
double MedianDistance(const Scene& scene, const Reconstruction& reconstruction,
                      int num_threads);

// Sets Point3D::error_px to the mean over observations with a finite error.
void ComputePointErrors(const Scene& scene, int num_threads,
                        Reconstruction* reconstruction);

// Removes points that the matches of their own keypoints contradict.
//
// A match of an observation of point X with a keypoint x of another registered
// image contradicts X if |project(X) - x| > max_error_px there. With c such
// matches, the n observations of a point agree in n (n - 1) ordered pairs, and
// the fraction of its matches that agree is
//
//   n (n - 1) / (n (n - 1) + c).
//
// A feature of a vehicle that moves along with the rig is matched in many
// images. Two or three images agree with a static point, by chance or because
// they bend a weakly constrained frame; all others contradict it. Such points
// have small residuals, so no loss identifies them. Wrong matches of correct
// points are independent of each other, and longer tracks outweigh more of
// them.
//
// Cost: one pass over all matches.
void RemoveContradictedPoints(const Scene& scene, const ViewGraph& matches,
                              double max_error_px, double min_match_share,
                              int num_threads, Reconstruction* reconstruction);

}  // namespace mgsfm
