// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/soft_rig.h"
#include "soft_rig/deviations.h"
#include "soft_rig/rig_trajectory.h"

namespace mgsfm {

struct TimeOffset {
  double value_s = 0.0;
  std::optional<double> sigma_s;  // nullopt if it is not observable
};

// The extrinsics and time offsets of all rigs: the quantities of soft_rig.h
// that the images of a sensor share.
class RigCalibration {
 public:
  RigCalibration(const Scene& scene, const SoftRigOptions& options,
                 const BundleAdjustmentOptions& bundle_options);

  // Sets the trajectories of the rigs from their frames.
  void SetRig(const Reconstruction& rig) { motions_.SetTrajectories(rig); }

  // The expected pose S_s D_i per image; nullopt for unregistered images.
  std::vector<std::optional<Rigid3>> ExpectedPoses(
      const Reconstruction& rig) const;

  // One generalized least squares step of extrinsics and time offsets. Returns
  // the largest change of a time offset, in seconds.
  double Update(const std::vector<FrameDeviations>& frames,
                const std::vector<DeviationSigma>& sigmas, Reconstruction* rig);

  const std::vector<TimeOffset>& offsets() const { return offsets_; }

  // The derivative of the expected pose with respect to the pose of the sensor
  // (coordinates of rig_problem.h) and its time offset.
  SensorJacobian Jacobian(int image_idx, const Rigid3& sensor_from_rig) const;

 private:
  using Frames = std::vector<const FrameDeviations*>;

  Rigid3 ExpectedPose(int image_idx, const Rigid3& sensor_from_rig,
                      double offset_s) const;
  double UpdateRig(int rig_idx, const Frames& frames,
                   const std::vector<DeviationSigma>& sigmas,
                   Reconstruction* rig);
  void AddFrame(const FrameDeviations& frame,
                const std::vector<DeviationSigma>& sigmas,
                const Reconstruction& rig,
                CalibrationEquations* equations) const;
  Eigen::VectorXd MaskAndPriors(int rig_idx, const Reconstruction& rig,
                                CalibrationEquations* equations) const;
  void SelectObservableOffsets(int rig_idx, const Frames& frames,
                               const CalibrationEquations& equations,
                               Eigen::VectorXd* mask);
  std::vector<double> InformationOfNoise(const Frames& frames) const;
  double ApplyStep(int rig_idx, const Eigen::VectorXd& step,
                   const Eigen::VectorXd& mask, Reconstruction* rig);

  const Scene& scene_;
  const SoftRigOptions& options_;
  const BundleAdjustmentOptions& bundle_options_;
  const bool use_times_;
  std::vector<int> slot_of_sensor_;  // its position in its rig
  ImageMotions motions_;
  std::vector<TimeOffset> offsets_;  // per sensor
};

}  // namespace mgsfm
