// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {

// The convention of the rotations in a file of poses.
struct PoseConvention {
  bool is_world_from_cam = true;
  enum { kMatrix, kWxyz, kXyzw } order = kXyzw;
};

// The rotation from one image to another, by a model or by matches, and the
// rotations cam_from_world of both as they were read from a file.
struct RotationEvidence {
  Eigen::Quaterniond second_from_first;
  Eigen::Quaterniond first, second;
};

// The convention by which a file agrees with the rotations of `source`, if it
// does not as it was read: another order of quaternions, and inverse poses.
// nullopt if there is none.
std::optional<std::string> FindOtherConvention(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, const std::string& source);

enum class TruthFormat { kColmap, kKitti, kTum, kRig };

template <>
struct EnumTable<TruthFormat> {
  static constexpr std::pair<std::string_view, TruthFormat> kNames[] = {
      {"colmap", TruthFormat::kColmap},
      {"kitti", TruthFormat::kKitti},
      {"tum", TruthFormat::kTum},
      {"rig", TruthFormat::kRig}};
};

// A model and its ground truth on disk.
struct TruthSource {
  std::string model_path;
  std::string gt_path;  // empty with kRig
  TruthFormat gt_format = TruthFormat::kColmap;
  std::string calib_path = {};     // comma-separated; may be empty
  std::string database_path = {};  // lists all images; may be empty
  std::string image_prefix = {};
  std::string reference = {};
  std::string rig_name_rule = "auto";
};

// The input of Evaluate.
struct TruthComparison {
  // Whether the truth is in meters: trajectories of KITTI and TUM, calibrations
  // of KITTI and EuRoC, and georeferenced models. Other models and rigs do not
  // state their unit.
  bool is_metric = false;
  // Registered images without a true pose; they are not compared.
  std::vector<std::string> unpaired_images;
  std::vector<ImagePoses> images;
  std::vector<SensorPoses> sensors;
  bool has_true_poses = true;
};

// Pairs the images and sensors of a model with their true poses. Throws Error
// for bad input.
TruthComparison CompareWithTruth(const TruthSource& source);

// Warns of images without a true pose, and if so few have one that the
// alignment makes their errors 0.
void WarnOfFewPoses(const TruthComparison& comparison,
                    const Evaluation& evaluation, Alignment alignment,
                    const Context& context);

}  // namespace mgsfm
