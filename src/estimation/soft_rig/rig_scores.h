// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// How the residuals of an adjusted model constrain changes of its rig.
//
// Columns: seven per sensor that is not the reference of its rig: the six
// coordinates of its pose (rig_problem.h), and its delay. A delay moves image i
// with the velocity `rates[i]` of the rig. Further columns are the logarithms
// of focal lengths, unless RigGauge excludes them, and the readout times of the
// sensors if they are estimated: a row at the height v of the image, from -1/2
// to 1/2, is taken v times the readout time after the image. Let e_k be the
// derivatives of the weighted residuals r with respect to column k, minus the
// part that frames and points absorb. Then
//
//   information  M_kl = e_k . e_l         scores  s_kb = sum over block b of
//   e_k . r
//
// so that x = -M^-1 sum_b s_b / efficiency is the change of all columns in a
// least-squares step. The scores of consecutive frames (blocks) vary as the
// residuals do, correlated or not.
struct RigScores {
  static constexpr int kNumColumns = 7;  // per sensor
  std::vector<int> sensor_idxs;
  std::vector<int> camera_idxs;
  std::vector<int> readout_sensor_idxs;
  std::vector<int> frame_idxs;
  Eigen::MatrixXd information;  // with that of priors
  std::vector<Eigen::MatrixXd> block_information;
  Eigen::MatrixXd scores;  // columns x blocks
  Eigen::VectorXd scores_of_priors, information_of_priors;
  // The sum over observations of what s_b s_b^T is for a block: the covariance
  // of the scores if observations are independent.
  Eigen::MatrixXd noise;
  // The same with the scores of each point summed first: all observations of a
  // point may err alike, as in a standing rig.
  Eigen::MatrixXd noise_of_points;
  // Per frame, the change of its pose in a least-squares step: the last column,
  // minus the other columns times the changes of the columns above.
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> frame_response;
  // The mean derivative of the weighted residual, divided by its weight: a
  // robust loss reacts less than its weights suggest.
  double efficiency = 1.0;
  double sigma_px = 0.0;  // noise of the keypoints

  // The column of the delay of sensor_idxs[k], or of the readout time of
  // readout_sensor_idxs[k].
  Eigen::Index DelayColumn(size_t k) const {
    return static_cast<Eigen::Index>(kNumColumns * (k + 1)) - 1;
  }
  Eigen::Index ReadoutColumn(size_t k) const {
    return static_cast<Eigen::Index>(kNumColumns * sensor_idxs.size() +
                                     camera_idxs.size() + k);
  }
};

// What known sensor poses determine.
enum class RigGauge {
  kKnownPoses,  // the scale, and with their priors the poses of sensors
  // The poses of sensors and the focal lengths that bundle adjustment refines,
  // with their priors; scale is fixed.
  kKnownShape,
  kFixedScale,  // nothing: sensors and focal lengths are free, scale is fixed
};

// An adjusted model whose cameras trigger late and read their rows in turn.
struct TimedRig {
  Reconstruction model;           // its motions include the delays
  std::vector<PoseVector> rates;  // per image; see ImageMotions
  std::vector<int> block_of_frame;
  std::vector<double> delays, readouts;  // per sensor
  bool estimates_delays = true;
  bool estimates_readouts = false;
};

// Prior knowledge of the columns, without errors of other columns.
struct KnownColumns {
  Eigen::VectorXd information;  // the diagonal, in units of the keypoint noise
  Eigen::VectorXd deviation;    // of the model from what is known
};
KnownColumns FindKnownColumns(const Scene& scene, const RigScores& scores,
                              const Reconstruction& model,
                              const BundleAdjustmentOptions& options);

// The keypoints of `scene` are those that images without readout times would
// have. nullopt if there are no columns, or if the equations cannot be
// factorized. Masked coordinates of poses have neither information nor scores.
// Cost: two passes over the observations, a factorization, and seven solves per
// sensor.
[[nodiscard]] std::optional<RigScores> ComputeRigScores(
    const Scene& scene, const TimedRig& rig,
    const BundleAdjustmentOptions& options, const Context& context,
    RigGauge gauge = RigGauge::kKnownPoses);

// The inverse of an information matrix; huge for uninformative directions.
Eigen::MatrixXd InvertInformation(Eigen::MatrixXd information);

// The change of the columns in a least-squares step.
Eigen::VectorXd NewtonStep(const RigScores& scores);

// The covariance of the columns by a jackknife that leaves out one block of
// frames at a time, so that blocks with great influence also count.
Eigen::MatrixXd Jackknife(const RigScores& scores);

// The covariance of the columns, from the covariance of the sum of all scores.
Eigen::MatrixXd CovarianceBy(const Eigen::MatrixXd& noise,
                             const RigScores& scores);

// Whether the two-sided probability of Student's t is below 1 in 10,000, with
// num_blocks - 1 degrees of freedom.
bool IsCertain(double t, Eigen::Index num_blocks);

// Clears a column, which is then constant.
void HoldColumn(Eigen::Index column, RigScores* scores);

}  // namespace mgsfm
