// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/rig_delays.h"
#include "mgsfm/soft_rig/rig_difference.h"

namespace mgsfm {

// The refined pose of a sensor in the rig of an adjusted model.
struct RigSensor {
  Rigid3 sensor_from_rig;
  PoseMatrix covariance = PoseMatrix::Zero();  // as in uncertainty.h
  bool has_length = false;  // chance gives such a length to 1 in 10,000 sensors
};
using RigSensors = std::vector<std::optional<RigSensor>>;  // per sensor

// The calibration that the models of a run share. Each model passes on the
// sensors and cameras that no model before it has, so that the first and
// largest one decides.
//
// The unit of length is that of the first model. If measurements leave it
// arbitrary, the best-determined baseline of a rig counts as exact, since the
// keypoints of another model tell nothing about its length.
class SharedCalibration {
 public:
  // `lenses` is the prior of intrinsics until a model contributes its own.
  SharedCalibration(const Scene& scene, CalibrationPrior lenses)
      : scene_(scene),
        sensors_(scene.sensors.size()),
        cameras_(std::move(lenses)),
        has_lens_(scene.cameras.size(), false) {}

  // `positions` are those that the model was adjusted to. A model that shares
  // no baseline with an earlier one has a unit of its own, and passes on no
  // lengths.
  void Learn(const Reconstruction& model, const PositionPriors& positions,
             const std::optional<RigDelays>& delays,
             const BundleAdjustmentOptions& options, const Context& context);

  // Whether a model with this prior has the unit of length of the first model,
  // or is the first.
  bool SharesUnit(const CalibrationPrior& prior) const;

  // The prior for a model with the sensors of these frames.
  CalibrationPrior PriorFor(const Mask& has_frame) const;

  // The sensors of a model, adjusted without their prior, that differ from the
  // prior more than 1 of 10,000 sensors do by chance, given both covariances.
  // Squared differences follow F with nine degrees of freedom, those of the
  // overdispersion of ten blocks of frames.
  std::vector<RigDifference> FindDifferences(
      const Reconstruction& model, const BundlePriors& priors,
      const BundleAdjustmentOptions& options, const Context& context,
      const std::function<std::optional<RigDelays>()>& estimate_delays) const;

 private:
  const Scene& scene_;
  RigSensors sensors_;
  CalibrationPrior cameras_;  // without sensors
  Mask has_lens_;             // per camera: a model passed on its intrinsics
  bool has_unit_ = false;
};

// Which frames have a pose or a rotation.
template <class Pose>
Mask FramesWith(const std::vector<std::optional<Pose>>& poses) {
  Mask has_frame;
  for (const auto& pose : poses) has_frame.push_back(pose.has_value());
  return has_frame;
}

// The scene with the sensors whose baselines the prior determines as known
// ones, for the estimation of positions. nullopt if it determines none, and so
// no unit of length.
std::optional<Scene> WithKnownSensors(const Scene& scene,
                                      const CalibrationPrior& prior);

// Scales an initial model to the unit of length of the prior, and gives it the
// rig of the prior.
void StartAtPrior(const CalibrationPrior& prior, Reconstruction* model);

}  // namespace mgsfm
