// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "incremental/growing_model.h"

namespace mgsfm {

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

}  // namespace mgsfm
