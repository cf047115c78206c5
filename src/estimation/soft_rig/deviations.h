// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "bundle_adjustment/problem_builder.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "rig_solver/pose_covariances.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The standard deviation of each coordinate of the deviations of a sensor.
struct DeviationSigma {
  double rotation_rad = 0.0;
  double position = 0.0;
};

// A model with one pose per image.
struct SoftRigModel {
  Reconstruction rig;       // of the scene; its points are not used
  Reconstruction separate;  // of SeparateImages(scene)
};

// `expected` is S_s per image, nullopt for unregistered images; `sigmas`
// are per sensor of the scene.
struct DeviationPrior {
  const std::vector<std::optional<Rigid3>>& expected;
  const std::vector<DeviationSigma>& sigmas;
  double sigma_px = 1.0;
};

// Problem (1) of soft_rig.h as a rig problem in which every image is a sensor
// with a prior at its expected pose. The images of a frame therefore move with
// it even if the priors are tight. Frames are those of the scene.
BuiltProblem BuildSoftRigProblem(const Scene& scene, const Scene& separate,
                                 const SoftRigModel& model,
                                 const DeviationPrior& deviations,
                                 const BundleAdjustmentOptions& options,
                                 const BundlePriors& priors);

// Writes back frames, images, points and cameras. Images that are not in the
// problem get their expected pose.
void WriteBack(const BuiltProblem& soft, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               SoftRigModel* model);

// The sum of reprojection errors over the images of a sensor.
struct ErrorSums {
  double sum_px = 0.0;
  size_t num_observations = 0;

  double Mean() const {
    return num_observations > 0 ? sum_px / static_cast<double>(num_observations)
                                : 0.0;
  }
};

// Per sensor.
std::vector<ErrorSums> SumErrors(const Scene& scene,
                                 const Reconstruction& reconstruction);

// The pose of each image; nullopt if it is not registered.
std::vector<std::optional<Rigid3>> ImagePosesOf(const Scene& scene,
                                                const Reconstruction& model);

// The updates of the hyperparameters in soft_rig.h from the deviations of
// images.

struct ImageDeviation {
  int image_idx = 0;
  int sensor_idx = 0;
  PoseVector value = PoseVector::Zero();
};

// The deviations of the images of a frame (at least two) and their joint
// posterior covariance: 6 rows and columns per image.
struct FrameDeviations {
  std::vector<ImageDeviation> images;
  Eigen::MatrixXd covariance;
};

// The mean of tr C_i / 3 over images: 0 if the images determine nothing about
// the deviations, 1 if they determine them completely.
struct ObservedFraction {
  double rotation = 0.0;
  double position = 0.0;
};

// One step of Fisher scoring for the standard deviations of all sensors.
// Sensors with fewer than 10 images share the estimate of their rig.
std::vector<DeviationSigma> UpdateSigmas(
    const std::vector<FrameDeviations>& frames,
    const std::vector<int>& rig_of_sensor,
    const std::vector<DeviationSigma>& sigmas,
    std::vector<ObservedFraction>* fractions);

// The prior variances of a deviation.
PoseVector PriorVariances(const DeviationSigma& sigma);

// The normal equations of the extrinsics of a rig. Unknowns: 6 per sensor, in
// the order of the sensors of the rig ("slots").
class CalibrationEquations {
 public:
  explicit CalibrationEquations(int num_sensors);

  // Adds the deviations of a frame as measurements. Per image: the slot of its
  // sensor, its prior variances, and the derivative of its expected pose.
  void AddFrame(const FrameDeviations& frame, const std::vector<int>& slots,
                const std::vector<PoseVector>& prior_variances,
                const std::vector<PoseMatrix>& jacobians);
  // Adds a prior on the change of a pose.
  void AddPrior(int slot, const PoseVector& change,
                const PoseVector& variances);

  // Treats coordinates with a mask of 0 as fixed and returns 0 for them.
  Eigen::VectorXd Solve(const Eigen::VectorXd& mask) const;

 private:
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd vector_;
};

// The expected pose S_s D_i of soft_rig.h per image; nullopt for unregistered
// images.
std::vector<std::optional<Rigid3>> ExpectedPoses(const Scene& scene,
                                                 const Reconstruction& rig);

// The derivative of the expected pose with respect to the pose of the sensor,
// in the coordinates of rig_problem.h.
PoseMatrix ExpectedPoseJacobian(const Scene& scene, const Reconstruction& rig,
                                int image_idx);

// One generalized least squares step of the extrinsics of all rigs: the
// quantities of soft_rig.h that the images of a sensor share.
void UpdateExtrinsics(const Scene& scene,
                      const std::vector<FrameDeviations>& frames,
                      const std::vector<DeviationSigma>& sigmas,
                      const BundleAdjustmentOptions& options,
                      Reconstruction* rig);

}  // namespace mgsfm
