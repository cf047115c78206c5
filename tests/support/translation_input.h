// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <vector>

#include "base/random.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/simulator/simulation.h"
#include "mgsfm/translation_averaging/translation_averaging.h"

namespace mgsfm {

// A simulation with the results of the stages before translation averaging.
struct TranslationInput {
  Simulation simulation;
  Bearings bearings;
  RotationEstimate rotations;
  ObservationGroups tracks;
};

// True rotations and tracks; exact rays if there is no pixel noise, free of the
// rounding of keypoints to floats.
inline TranslationInput MakeTranslationInput(const SimulationOptions& options) {
  TranslationInput input;
  input.simulation = Simulate(options);
  const Scene& scene = input.simulation.scene;
  const Reconstruction& truth = input.simulation.ground_truth;
  input.bearings = ComputeBearings(scene, 1);
  for (const Point3D& point : truth.points) {
    for (const Observation& o : point.track) {
      if (options.pixel_noise_px == 0.0) {
        input.bearings.images[o.image_idx].rays[o.keypoint_idx] =
            (*truth.CamFromWorld(scene, o.image_idx) * point.point_in_world)
                .normalized();
      }
      input.tracks.observations.push_back(o);
    }
    input.tracks.FinishGroup();
  }
  for (const auto& pose : truth.sensor_from_rig) {
    input.rotations.sensor_from_rig.emplace_back(pose->rotation);
  }
  for (const auto& pose : truth.rig_from_world) {
    input.rotations.rig_from_world.emplace_back(pose->rotation);
    input.rotations.component.emplace_back(0);
  }
  input.rotations.pair_is_inlier.assign(
      input.simulation.view_graph.pairs.size(), true);
  return input;
}

// Largest error of the centers of all cameras (or of the frames only) after the
// best scale and shift, relative to their true extent; infinite if any is
// missing. `scale` is that of the truth in units of the estimate.
struct CenterError {
  double max_relative = 0.0;
  double scale = 0.0;
};

inline CenterError MeasureCenters(const TranslationInput& input,
                                  const PositionEstimate& estimate,
                                  bool frames_only = false) {
  const Scene& scene = input.simulation.scene;
  const Reconstruction& truth = input.simulation.ground_truth;
  std::vector<Eigen::Vector3d> expected, actual;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    if (frames_only && !scene.IsReference(image.sensor_idx)) continue;
    const auto& center = estimate.frame_center_in_world[image.frame_idx];
    const auto& t = estimate.sensor_from_rig_translation[image.sensor_idx];
    if (!center || !t || !center->allFinite() || !t->allFinite()) {
      return {std::numeric_limits<double>::infinity(), 0.0};
    }
    const int image_idx = static_cast<int>(i);
    expected.push_back(truth.CamFromWorld(scene, image_idx)->Center());
    actual.push_back(
        *center -
        input.rotations.CamFromWorld(scene, image_idx)->conjugate() * *t);
  }
  Eigen::Vector3d mean_expected = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_actual = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < actual.size(); ++i) {
    mean_expected += expected[i] / actual.size();
    mean_actual += actual[i] / actual.size();
  }
  double dot = 0.0, norm = 0.0, extent = 0.0;
  for (size_t i = 0; i < actual.size(); ++i) {
    dot += (expected[i] - mean_expected).dot(actual[i] - mean_actual);
    norm += (actual[i] - mean_actual).squaredNorm();
    extent = std::max(extent, (expected[i] - mean_expected).norm());
  }
  CenterError error;
  error.scale = norm > 0.0 ? dot / norm : 0.0;
  for (size_t i = 0; i < actual.size(); ++i) {
    const Eigen::Vector3d difference =
        error.scale * (actual[i] - mean_actual) - (expected[i] - mean_expected);
    error.max_relative =
        std::max(error.max_relative, difference.norm() / extent);
  }
  return error;
}

// A short drive with few points.
inline SimulationOptions SmallDrive(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = path == PathPreset::kLoop ? 24 : 12;
  options.num_points_per_frame = 150;
  options.max_num_features_per_image = 250;
  return options;
}

// All solves are usable, and all positions and sensors are determined and true.
inline void ExpectTruth(const TranslationInput& input,
                        const PositionEstimate& estimate,
                        const TranslationSummary& summary) {
  EXPECT_TRUE(summary.initialization.IsUsable());
  EXPECT_TRUE(summary.camera_refinement.IsUsable());
  EXPECT_TRUE(summary.joint_refinement.IsUsable());
  for (const SensorTranslationSummary& sensor : summary.sensors) {
    EXPECT_TRUE(sensor.is_observable);
  }
  EXPECT_LT(MeasureCenters(input, estimate).max_relative, 1e-6);
  EXPECT_GT(summary.num_points, 0.7 * input.tracks.size());
}

}  // namespace mgsfm
