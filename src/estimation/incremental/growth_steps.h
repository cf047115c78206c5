// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "incremental/growing_model.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// Starts models, as mgsfm/incremental/incremental_mapping.h describes.
class StartFinder {
 public:
  // Weighs all pairs. Cost: linear in the matches.
  explicit StartFinder(const GrowthInput& input);

  // A model of the heaviest candidate that has enough points, without frames of
  // the mask; null if there is none. Frames of candidates that fail, and those
  // of the model, never start a model again.
  std::unique_ptr<GrowingModel> Start(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Mask& frame_is_taken);

 private:
  // A pair of frames, or two images of one frame.
  struct Candidate {
    int frame_idx1 = 0;
    int frame_idx2 = 0;
    double weight = 0.0;
    std::vector<size_t> pair_idxs;  // the heaviest first
  };
  std::vector<Candidate> ListCandidates(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Mask& frame_is_taken) const;
  std::unique_ptr<GrowingModel> Try(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Candidate& candidate) const;
  std::optional<Rigid3> PoseOf(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Candidate& candidate) const;

  const GrowthInput& input_;
  std::vector<double> weights_;  // per pair
  Mask frame_is_tried_;
};

// The calibration of an unknown rig on the way, as
// mgsfm/incremental/incremental_mapping.h describes. The errors of the poses of
// frames are not in the covariances of samples; their scatter shows them.
class SensorPlacement {
 public:
  explicit SensorPlacement(const GrowthInput& input);

  // Registers single images of sensors without pose in the frames of the model,
  // where they see half as many points again as in the last attempt. Places the
  // sensors that their samples determine; with `is_last_resort`, otherwise the
  // one with the most samples. Returns the placed sensors.
  std::vector<PlacedSensor> Place(bool is_last_resort, GrowingModel* model);

  // Discards the samples of poses before an adjustment of everything.
  void Restart();

 private:
  struct Sample {
    Rigid3 sensor_from_rig;
    PoseMatrix information = PoseMatrix::Zero();  // of Exp(w) R, t + d
  };
  void AddSamples(const GrowingModel& model);

  const GrowthInput& input_;
  std::vector<std::vector<Sample>> samples_;  // per sensor
  std::vector<int> num_tried_;                // visible points, per image
};

// The pose of a new frame, and what contradicts it.
struct FrameRegistration {
  std::optional<Rigid3> rig_from_world;
  int num_keypoints = 0;
  int num_inliers = 0;
  // Another pose on which the outliers agree, if other frames observe their
  // points: the model has drifted between these frames.
  struct Loop {
    Rigid3 rig_from_world;
    int num_inliers = 0;
    std::vector<int> frame_idxs;        // observe the points of this pose
    std::vector<int> other_frame_idxs;  // observe those of the other
  };
  std::optional<Loop> loop;
};

[[nodiscard]] FrameRegistration RegisterFrame(const GrowthInput& input,
                                              const GrowingModel& model,
                                              int frame_idx);

// Moves the frames of the loop by the motion between both poses of the frame.
// Returns whether the model now agrees with both poses; otherwise it has the
// poses from before.
bool CloseLoop(const GrowthInput& input, int frame_idx,
               const FrameRegistration& registration, GrowingModel* model);

}  // namespace mgsfm
