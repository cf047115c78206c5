// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Operations on finished models. They preserve rigs and frames: the pose of an
// image remains the product of sensor and frame pose.

struct SceneModel {
  Scene scene;
  Reconstruction reconstruction;
};

// ------------------------------------------------------------- selection

// Keeps these images, and points that two of them observe. Frames without an
// image disappear; sensors without one keep their pose in the rig. Other items
// keep their order.
void KeepImages(const Mask& keeps_image, SceneModel* model);

// Keeps the points in the box and the frames that observe one of them.
void KeepBox(const Eigen::AlignedBox3d& box, SceneModel* model);

// The box between two quantiles, in [0, 1], of the coordinates of the points
// along each axis. The model must have points.
Eigen::AlignedBox3d BoxOfQuantiles(const SceneModel& model, double lower,
                                   double upper);

// ------------------------------------------------------------- alignment

// Poses of the images that both models have, by name.
std::vector<ImagePoses> PairImages(const SceneModel& model,
                                   const SceneModel& reference);

// Agreement of the images of two models after an alignment.
struct ImageAgreement {
  // The distances between centers of images, in the unit of the reference.
  std::vector<double> distances;
  // Models have any unit of length. A distance of a tenth of the extent of the
  // reference does not count as agreement.
  double max_distance = 0.0;
  // The images within that distance.
  int num_agreeing = 0;
};
ImageAgreement CompareCenters(const std::vector<ImagePoses>& images,
                              const Sim3& reference_from_model,
                              const Reconstruction& reference);
// The minimum fraction of images that must agree. RANSAC finds such a minority.
constexpr double kMinAgreeingShare = 0.25;

// The rigid transform to a world with z up, whose plane z = 0 is that of the
// path: through the mean center of the frames, with x along their principal
// axis. The normal n minimizes
//
//   n^T C n / tr(C) - mu^2 (n . u)^2,
//
// where C is the covariance of the centers, u is the mean upward axis (-y) of
// the reference images, and mu = 0.05. The second term determines n if the path
// is straight. n points to the side of u, or against the mean viewing direction
// if cameras look down. A measured upward direction replaces n. nullopt without
// a frame.
std::optional<Sim3> AlignToGroundPlane(
    const SceneModel& model,
    const std::optional<Eigen::Vector3d>& measured_up = std::nullopt);

// --------------------------------------------------------------- merging

struct MergeOptions {
  int min_common_images = 3;
  // Observations with larger errors are removed from the result.
  double max_reproj_error_px = 64.0;
  // The alignment, if known. Few common images then suffice.
  std::optional<Sim3> first_from_second = {};
};

struct MergeSummary {
  int num_common_frames = 0;
  int num_common_images = 0;  // poses that determine the alignment
  Sim3 first_from_second;
  // Distance of common images after alignment, in the unit of the first model.
  double median_distance = 0.0;
  int num_new_images = 0;
  int num_merged_points = 0;  // with a point of the first model
  // Points that share observations with two points of the first model.
  int num_dropped_points = 0;
};

// Adds the second model to the first; the result is in the world of the first.
// Images are the same if their names are; frames are the same if they share an
// image, or if their rigs have the same sensors and they have the same name.
// Common frames provide the poses for AlignPoses
// (mgsfm/evaluation/evaluation.h), one per common sensor. Poses and intrinsics
// of the first model are kept. Points that share an observation become one.
//
// Throws Error, naming images or cameras, if there are too few common images,
// or if the models contradict each other: in rigs, frames, camera models,
// keypoints, or sensor poses by more than 5 degrees. The first model is
// unchanged in this case.
MergeSummary MergeModels(SceneModel second, const MergeOptions& options,
                         SceneModel* first);

// -------------------------------------------------------------- analysis

struct ModelStatistics {
  size_t num_rigs = 0, num_cameras = 0, num_frames = 0, num_images = 0;
  size_t num_points = 0, num_observations = 0;
  double mean_track_length = 0.0;
  double mean_observations_per_image = 0.0;
  // The mean over the points with a known error.
  std::optional<double> mean_reprojection_error_px;
};

// Statistics of registered images and their frames, rigs and cameras.
ModelStatistics AnalyzeModel(const SceneModel& model);

// Removes observations with a reprojection error above the limit, and points
// with fewer than two observations. Sets the mean error of each other point.
void RemoveLargeErrors(double max_error_px, SceneModel* model);

}  // namespace mgsfm
