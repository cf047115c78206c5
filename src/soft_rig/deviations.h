// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "least_squares/pose_covariances.h"
#include "least_squares/rig_problem.h"
#include "soft_rig/soft_rig_problem.h"

namespace mgsfm {

// What deviations of images tell of what they have in common; the updates of
// soft_rig.h.

struct ImageDeviation {
  int image_idx = 0;
  int sensor_idx = 0;
  PoseVector value = PoseVector::Zero();
};

// The deviations of the images of a frame, at least two, and their posterior
// covariance: 6 rows and columns for each image.
struct FrameDeviations {
  std::vector<ImageDeviation> images;
  Eigen::MatrixXd covariance;
};

// tr C / 3, the mean over images: what share of a spread they determine.
struct SpreadShare {
  double rotation = 0.0;
  double position = 0.0;
};

// One step for the spreads of all sensors. Sensors with fewer than 10 images
// take that of their rig.
std::vector<Spread> UpdateSpreads(const std::vector<FrameDeviations>& frames,
                                  const std::vector<int>& rig_of_sensor,
                                  const std::vector<Spread>& spreads,
                                  std::vector<SpreadShare>* shares);

// Of a deviation before anything is seen of it.
PoseVector PriorVariances(const Spread& spread);

// Changes of the poses (6 coordinates) and time offsets (1) of the sensors of a
// rig, one after the other.
using SensorJacobian = Eigen::Matrix<double, 6, 7>;

// The normal equations of the mean rig and its time offsets.
class CommonEquations {
 public:
  explicit CommonEquations(int num_sensors);

  // Deviations as measurements of changes; per image, the sensor's number, its
  // prior variances, and the derivative of where it is expected.
  void AddFrame(const FrameDeviations& frame, const std::vector<int>& sensors,
                const std::vector<PoseVector>& prior_variances,
                const std::vector<SensorJacobian>& jacobians);
  // A change of a pose that is known to be `change`.
  void AddPrior(int sensor, const PoseVector& change,
                const PoseVector& variances);

  // Over the coordinates for which the mask is 1.
  Eigen::VectorXd Solve(const Eigen::VectorXd& mask) const;
  Eigen::VectorXd Variances(const Eigen::VectorXd& mask) const;

 private:
  Eigen::MatrixXd Masked(const Eigen::VectorXd& mask) const;

  Eigen::MatrixXd matrix_;
  Eigen::VectorXd vector_;
};

}  // namespace mgsfm
