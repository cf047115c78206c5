// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The main facts about a run: `summary` of the report, and the last lines on
// the terminal.

struct SensorAccuracy {
  std::string name;
  // Largest standard deviations about and along the axes of the camera.
  double sigma_rotation_deg = 0.0;
  double sigma_translation = 0.0;
  bool place_is_determined = true;  // see IsPlaceDetermined

  auto Fields() const {
    return Named("name", name, "sigma_rotation_deg", sigma_rotation_deg,
                 "sigma_translation", sigma_translation, "place_is_determined",
                 place_is_determined);
  }
};

// The lens of a camera of a model. Of two focal lengths, it has the first.
struct LensValue {
  int camera_idx = 0;
  std::string label;
  CameraModelId model = CameraModelId::kSimpleRadial;
  double prior_px = 0.0;  // of the input
  double focal_length_px = 0.0;
  std::optional<double> relative_sigma;  // if it was estimated
  LensSource source = LensSource::kGiven;
  std::string message;  // why the images do not determine it; empty if they do

  bool IsGuess() const {
    return source != LensSource::kGiven && source != LensSource::kAdjustment;
  }

  auto Fields() const {
    return Named("camera_id", As<Item::kCameraId>(camera_idx), "model", model,
                 "prior_px", prior_px, "focal_length_px", focal_length_px,
                 "relative_sigma", relative_sigma, "source", source, "message",
                 message);
  }
};

struct ModelSummary {
  int num_frames = 0;
  int num_images = 0;
  // Images whose poses come from other images of their frame.
  int num_images_without_points = 0;
  size_t num_points = 0;
  size_t num_observations = 0;
  std::optional<double> mean_reprojection_error_px;
  std::optional<double> kept_share;  // of the verified matches, if counted
  double share_at_rest = 0.0;        // see input_check/kept_matches.h
  std::string unit_of_length;        // in words
  int num_calibrated_sensors = 0;    // other than reference and known ones
  std::vector<LensValue> lenses;     // of the cameras with registered images
  // The calibrated sensor with the fewest observations that support its pose.
  std::string weakest_sensor;
  size_t min_num_sensor_observations = 0;
  // One per calibrated sensor, if covariances were computed.
  std::vector<SensorAccuracy> accuracies;

  auto Fields() const {
    return Named("num_frames", num_frames, "num_images", num_images,
                 "num_points", num_points, "mean_reprojection_error_px",
                 mean_reprojection_error_px, "kept_share", kept_share,
                 "share_at_rest", share_at_rest, "unit_of_length",
                 unit_of_length, "rig_accuracy", accuracies);
  }
};

struct MissingFrames {
  size_t num_frames = 0;
  std::string reason;

  auto Fields() const {
    return Named("num_frames", num_frames, "reason", reason);
  }
};

struct RunSummary {
  size_t num_images = 0;
  size_t num_registered_images = 0;
  // Frames that are in no model, by reason; most first.
  std::vector<MissingFrames> missing_frames;
  std::vector<ModelSummary> models;

  auto Fields() const {
    return Named("num_images", num_images, "num_registered_images",
                 num_registered_images, "missing_frames", missing_frames,
                 "models", models);
  }
};

// Images that at least one model has.
size_t NumRegisteredImages(const Scene& scene, const MapperResult& result);

RunSummary SummarizeRun(const Scene& scene, const MapperResult& result);

// One line per fact: images, missing frames, and for each model its size,
// error, whether it stands still, lenses, rig, and unit of length.
std::vector<std::string> DescribeRun(const RunSummary& summary);

}  // namespace mgsfm
