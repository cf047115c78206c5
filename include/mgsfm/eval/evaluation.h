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

// How far a model is from the truth, whatever the worlds and the unit it is in.

struct ImagePoses {
  std::string name;
  bool is_reference = false;             // of the reference sensor of its rig
  std::optional<Rigid3> cam_from_model;  // nullopt: not registered
  Rigid3 cam_from_world;                 // true, in metres
};

struct SensorPoses {
  std::string name;
  std::optional<Rigid3> sensor_from_ref;       // in the unit of the model
  std::optional<Rigid3> true_sensor_from_ref;  // in metres
};

// What may move a model onto the truth.
enum class Alignment {
  kSimilarity,
  kRigid,  // the unit of the model is the metre
  kNone,   // its world is the true one, too
};

template <>
struct EnumTable<Alignment> {
  static constexpr std::pair<std::string_view, Alignment> kNames[] = {
      {"similarity", Alignment::kSimilarity},
      {"rigid", Alignment::kRigid},
      {"none", Alignment::kNone}};
};

// The similarity world_from_model that fits the poses:
//
//   min sum_i |s R c_i + t - g_i|^2 + mu^2 |R - R_i|^2 / 2,        (1)
//
// c_i, g_i: centres in the model and the true ones; R_i: the rotation between
// the worlds that the orientations of image i imply; mu: 0.05 times the root
// mean square distance of the g_i from their mean. Where centres determine R,
// its second term weighs nothing beside the first; on a straight path it gives
// the turn about the path. If all g_i agree, R comes from orientations and the
// scale is 1. Images that disagree with most others (by more than ten times the
// median residual of a first fit, and 0.01 d) have no part in (1). The first
// fit minimises the sum of distances, each at most d, starting with the best of
// fits to two images; d: the root mean square above. nullopt if there is no
// image. With kRigid, s is 1; with kNone, nothing is moved.
std::optional<Sim3> AlignPoses(const std::vector<ImagePoses>& images,
                               Alignment alignment = Alignment::kSimilarity);

struct ErrorStatistics {
  double mean = 0.0;
  double median = 0.0;
  double max = 0.0;
};

struct AreaUnderCurve {
  double threshold = 0.0;
  // Mean over [0, threshold] of the share of all images, registered or not,
  // whose error is at most that: 1 is best.
  double area = 0.0;
};

struct SensorErrors {
  std::string name;
  double rotation_deg = 0.0;
  std::optional<double> direction_deg;  // of the translation
  double length_m = 0.0;                // estimated, after alignment
  double true_length_m = 0.0;
};

struct EvaluationOptions {
  std::vector<double> position_thresholds_m = {0.05, 0.1, 0.5, 1.0};
  std::vector<double> rotation_thresholds_deg = {0.5, 1.0, 5.0};
  Alignment alignment = Alignment::kSimilarity;
};

struct Evaluation {
  int num_images = 0;
  int num_registered = 0;
  std::optional<Sim3> world_from_model;
  // Over registered images, after alignment; absent without true poses.
  std::optional<ErrorStatistics> rotation_deg, position_m;
  std::vector<AreaUnderCurve> rotation_auc, position_auc;
  std::vector<SensorErrors> sensors;
  // Largest distance between two reference images of the model, in metres.
  std::optional<double> extent_m;
  // Length of the true path of the reference images, in their order.
  std::optional<double> path_m;
};

// Without true image poses, `images` holds those of the model with any
// cam_from_world and `has_true_poses` is false: then the scale is the one that
// fits the true distances of the sensors, and there are no image errors.
Evaluation Evaluate(const std::vector<ImagePoses>& images, bool has_true_poses,
                    const std::vector<SensorPoses>& sensors,
                    const EvaluationOptions& options);

// A table to read, and the same as indented JSON.
std::string EvaluationToText(const Evaluation& evaluation);
std::string EvaluationToJson(const Evaluation& evaluation);

}  // namespace mgsfm
