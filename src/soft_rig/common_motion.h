// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/soft_rig.h"
#include "soft_rig/deviations.h"
#include "soft_rig/image_motions.h"

namespace mgsfm {

struct TimeOffset {
  double value_s = 0.0;
  std::optional<double> sigma_s;  // absent where it is not observable
};

// What all images of a sensor have in common, see soft_rig.h: its
// pose in the rig, and how late it is.
class CommonMotion {
 public:
  CommonMotion(const Scene& scene, const SoftRigOptions& options,
               const BundleAdjustmentOptions& bundle_options);

  // Takes the paths of rigs from their frames.
  void SetRig(const Reconstruction& rig) { motions_.SetPaths(rig); }

  // Per image: where its rig has it; nullopt if it is not registered.
  std::vector<std::optional<Rigid3>> ExpectedPoses(
      const Reconstruction& rig) const;

  // Moves sensors and time offsets to where deviations tell. Returns the
  // largest change of a time offset, in seconds.
  double Update(const std::vector<FrameDeviations>& frames,
                const std::vector<Spread>& spreads, Reconstruction* rig);

  const std::vector<TimeOffset>& offsets() const { return offsets_; }

  // The derivative of the expected pose (rig_problem.h) by changes of the
  // sensor's and of its time offset.
  SensorJacobian Jacobian(int image_idx, const Rigid3& sensor_from_rig) const;

 private:
  using Frames = std::vector<const FrameDeviations*>;

  Rigid3 ExpectedPose(int image_idx, const Rigid3& sensor_from_rig,
                      double offset_s) const;
  double UpdateRig(int rig_idx, const Frames& frames,
                   const std::vector<Spread>& spreads, Reconstruction* rig);
  void AddFrame(const FrameDeviations& frame,
                const std::vector<Spread>& spreads, const Reconstruction& rig,
                CommonEquations* equations) const;
  Eigen::VectorXd MaskAndPriors(int rig_idx, const Reconstruction& rig,
                                CommonEquations* equations) const;
  void JudgeOffsets(int rig_idx, const Frames& frames,
                    const CommonEquations& equations, Eigen::VectorXd* mask);
  std::vector<double> NoiseInformation(const Frames& frames) const;
  double ApplyStep(int rig_idx, const Eigen::VectorXd& step,
                   const Eigen::VectorXd& mask, Reconstruction* rig);

  const Scene& scene_;
  const SoftRigOptions& options_;
  const BundleAdjustmentOptions& bundle_options_;
  const bool use_times_;
  std::vector<int> number_of_sensor_;  // in its rig
  ImageMotions motions_;
  std::vector<TimeOffset> offsets_;  // per sensor
};

}  // namespace mgsfm
