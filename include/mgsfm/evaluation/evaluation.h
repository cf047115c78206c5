// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Evaluation of a model against ground truth, up to a similarity transform.

struct ImagePoses {
  std::string name;
  bool is_reference = false;  // image of the reference sensor of its rig
  std::optional<Rigid3> cam_from_model;  // nullopt: not registered
  Rigid3 cam_from_world;  // ground truth, in meters if it is metric
};

struct SensorPoses {
  std::string name;
  std::optional<Rigid3> sensor_from_ref;       // in the unit of the model
  std::optional<Rigid3> true_sensor_from_ref;  // in meters if it is metric
};

// The transforms that may align a model with the ground truth.
enum class Alignment {
  kSimilarity,
  kRigid,  // for metric models
  kNone,   // for models in the world frame of the ground truth
};

template <>
struct EnumTable<Alignment> {
  static constexpr std::pair<std::string_view, Alignment> kNames[] = {
      {"similarity", Alignment::kSimilarity},
      {"rigid", Alignment::kRigid},
      {"none", Alignment::kNone}};
};

// The similarity transform world_from_model that minimizes
//
//   sum_i |s R c_i + t - g_i|^2 + mu^2 |R - R_i|^2 / 2,            (1)
//
// where c_i and g_i are the estimated and true centers, R_i is the rotation
// between the worlds implied by the orientation of image i, d is the root mean
// square distance of the g_i from their mean, and mu = 0.05 d. The second term
// is negligible if the centers determine R. For straight paths it determines
// the rotation about the path. If all g_i coincide, orientations determine R,
// and s = 1.
//
// (1) excludes outliers: images with residuals above ten times the median
// residual of an initial fit and above 0.01 d. The initial fit minimizes the
// sum of min(distance, d), starting from the best fit to two images. With
// kRigid, s = 1; with kNone, the transform is the identity. nullopt without
// images.
std::optional<Sim3> AlignPoses(const std::vector<ImagePoses>& images,
                               Alignment alignment = Alignment::kSimilarity);

struct ErrorStatistics {
  double mean = 0.0;
  double median = 0.0;
  double max = 0.0;
  double rms = 0.0;
};

// Relative poses over segments of 100, 200, ..., 800 m of the true path that
// start at every tenth reference image, as in the KITTI odometry benchmark.
// Errors are relative to the segment length.
struct SegmentErrors {
  int num_segments = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
};

// Relative poses of successive reference images, as in the TUM benchmark (RPE).
struct StepErrors {
  int num_steps = 0;
  ErrorStatistics rotation_deg, translation_m;
};

struct AreaUnderCurve {
  double threshold = 0.0;  // degrees, or the unit of the ground truth
  // Area under the recall curve, normalized to [0, 1]: the mean over e in
  // [0, threshold] of the fraction of all images with an error of at most e.
  double area = 0.0;
};

struct SensorErrors {
  std::string name;
  double rotation_deg = 0.0;
  std::optional<double> direction_deg;  // angular error of the translation
  double length_m = 0.0;                // estimated length after alignment
  double true_length_m = 0.0;
};

struct EvaluationOptions {
  std::vector<double> position_thresholds_m = {0.05, 0.1, 0.5, 1.0};
  std::vector<double> rotation_thresholds_deg = {0.5, 1.0, 5.0};
  Alignment alignment = Alignment::kSimilarity;
  // Whether the unit of the ground truth is the meter.
  bool is_metric = true;
};

struct Evaluation {
  // If false, lengths `_m` are in the unit of the ground truth instead.
  bool is_metric = true;
  int num_images = 0;
  int num_registered = 0;
  std::optional<Sim3> world_from_model;
  // Errors of registered images after alignment; nullopt without true poses.
  std::optional<ErrorStatistics> rotation_deg, position_m;
  std::vector<AreaUnderCurve> rotation_auc, position_auc;
  // Errors at the scale of the alignment; nullopt without true poses, or if the
  // path is too short.
  std::optional<SegmentErrors> segments;
  std::optional<StepErrors> steps;
  std::vector<SensorErrors> sensors;
  // The largest distance between two reference images of the aligned model.
  std::optional<double> extent_m;
  // The length of the true path through the reference images in order.
  std::optional<double> path_m;
};

// If has_true_poses is false, cam_from_world of `images` is ignored. The scale
// is then fitted to the true distances between sensors, and image errors are
// not computed.
Evaluation Evaluate(const std::vector<ImagePoses>& images, bool has_true_poses,
                    const std::vector<SensorPoses>& sensors,
                    const EvaluationOptions& options);

// Formats an evaluation as a text table or as indented JSON.
std::string EvaluationToText(const Evaluation& evaluation);
std::string EvaluationToJson(const Evaluation& evaluation);

}  // namespace mgsfm
