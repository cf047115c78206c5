// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/unit_error.h"

#include <algorithm>
#include <cmath>

#include "geometry/so3.h"
#include "soft_rig/score_statistics.h"
#include "soft_rig/soft_rig_problem.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// The root mean square distance of frames from their mean.
double SpreadOf(const Reconstruction& model) {
  Vector3d sum = Vector3d::Zero();
  double squares = 0.0, count = 0.0;
  for (const auto& pose : model.rig_from_world) {
    if (!pose) continue;
    sum += pose->Center();
    squares += pose->Center().squaredNorm();
    count += 1.0;
  }
  if (count == 0.0) return 0.0;
  return std::sqrt(
      std::max(0.0, squares / count - (sum / count).squaredNorm()));
}

// The largest distance of a sensor from the reference of its rig.
double RigSize(const Reconstruction& model) {
  double size = 0.0;
  for (const auto& pose : model.sensor_from_rig) {
    if (pose) size = std::max(size, pose->translation.norm());
  }
  return size;
}

// u with its variance.
struct Stretch {
  double value = 0.0;
  double variance = 0.0;
};

// The columns of scores, preceded by u, with the priors of what is known.
struct KnownLengths {
  RigScores scores;      // of the residuals alone
  VectorXd information;  // of the priors, the diagonal
  VectorXd deviation;    // of the model from the priors
};

// The scores after a step.
MatrixXd ScoresAfter(const RigScores& scores, const VectorXd& step) {
  MatrixXd after = scores.scores;
  for (Eigen::Index b = 0; b < after.cols(); ++b) {
    after.col(b) += scores.efficiency * scores.block_information[b] * step;
  }
  return after;
}

// The variance of the scores of blocks, relative to that of independent
// residuals with the noise of keypoints.
double OverdispersionOf(RigScores scores) {
  scores.scores_of_priors = VectorXd::Zero(scores.scores.rows());
  const MatrixXd after = ScoresAfter(scores, NewtonStep(scores));
  const double sum =
      (InvertInformation(scores.information) * after).cwiseProduct(after).sum();
  return std::max(1.0,
                  sum / (static_cast<double>(after.rows()) * scores.efficiency *
                         scores.sigma_px * scores.sigma_px));
}

std::optional<KnownLengths> FindKnownLengths(
    const Scene& scene, const RigScores& scores, const Reconstruction& model,
    const BundleAdjustmentOptions& options) {
  const Eigen::Index size = scores.scores.rows();
  MatrixXd columns(size, size + 1);
  columns << VectorXd::Zero(size), MatrixXd::Identity(size, size);
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    const auto& known = scene.sensors[scores.sensor_idxs[k]].sensor_from_rig;
    if (!known) continue;
    columns.block<3, 1>(
        static_cast<Eigen::Index>(RigScores::kNumColumns * k) + 3, 0) =
        known->translation;
  }
  if (columns.col(0).isZero(0.0)) return std::nullopt;
  // Residuals that depend on each other tell as little as fewer ones.
  const double overdispersion = OverdispersionOf(scores);
  const auto transform = [&](const MatrixXd& M) -> MatrixXd {
    return columns.transpose() * M * columns / overdispersion;
  };
  KnownLengths known;
  known.scores.efficiency = scores.efficiency;
  known.scores.sigma_px = scores.sigma_px;
  known.scores.information = transform(scores.information);
  for (const MatrixXd& M : scores.block_information) {
    known.scores.block_information.push_back(transform(M));
  }
  known.scores.scores = columns.transpose() * scores.scores / overdispersion;
  const KnownColumns priors = FindKnownColumns(scene, scores, model, options);
  known.information = VectorXd::Zero(size + 1);
  known.information.tail(size) = priors.information;
  known.deviation = VectorXd::Zero(size + 1);
  known.deviation.tail(size) = priors.deviation;
  return known;
}

// With the variances of all priors times a factor.
RigScores WithPriors(const KnownLengths& known, double factor) {
  RigScores joint = known.scores;
  joint.information.diagonal() +=
      known.information / (factor * joint.efficiency);
  joint.scores_of_priors =
      known.information.cwiseProduct(known.deviation) / factor;
  return joint;
}

// The factor of the variances of priors, at least 1, of maximum restricted
// likelihood: the mean square of deviations is what their posterior implies.
double VarianceOfPriors(const KnownLengths& known) {
  double factor = 1.0;
  for (int i = 0; i < 50; ++i) {
    const RigScores joint = WithPriors(known, factor);
    const VectorXd deviation = known.deviation + NewtonStep(joint);
    const VectorXd posterior =
        InvertInformation(joint.information).diagonal() / joint.efficiency;
    const double squares = known.information.dot(deviation.cwiseAbs2()) /
                           (joint.sigma_px * joint.sigma_px);
    const double determined =
        static_cast<double>((known.information.array() > 0.0).count()) -
        known.information.dot(posterior) / factor;
    if (!(determined > 0.0)) break;
    const double next = std::max(1.0, squares / determined);
    const double change = std::abs(std::log(next / factor));
    factor = next;
    if (change < 1e-3) break;
  }
  return factor;
}

std::optional<Stretch> StretchOfKnownPoses(
    const Scene& scene, const RigScores& scores, const Reconstruction& model,
    const BundleAdjustmentOptions& options) {
  const auto known = FindKnownLengths(scene, scores, model, options);
  if (!known) return std::nullopt;
  const double factor = VarianceOfPriors(*known);
  RigScores joint = WithPriors(*known, factor);
  const VectorXd step = NewtonStep(joint);
  joint.scores = ScoresAfter(joint, step);
  const MatrixXd noise_of_priors = MatrixXd(known->information.asDiagonal()) *
                                   (joint.sigma_px * joint.sigma_px / factor);
  return Stretch{step[0], Jackknife(joint)(0, 0) +
                              CovarianceBy(noise_of_priors, joint)(0, 0)};
}

// The derivative of the center of a sensor in its rig.
Eigen::Matrix<double, 3, 6> CenterDerivative(const Rigid3& sensor_from_rig) {
  const Eigen::Matrix3d R =
      sensor_from_rig.rotation.toRotationMatrix().transpose();
  Eigen::Matrix<double, 3, 6> derivative;
  derivative << -R * CrossMatrix(sensor_from_rig.translation), -R;
  return derivative;
}

std::optional<Stretch> StretchOfDistances(
    const RigScores& scores, const Reconstruction& before,
    const Reconstruction& after,
    const std::vector<std::pair<int, int>>& known_distances) {
  VectorXd gradient = VectorXd::Zero(scores.scores.rows());
  double sum_before = 0.0, sum_after = 0.0;
  const auto add = [&](int sensor_idx, const Vector3d& direction) {
    const auto found = std::find(scores.sensor_idxs.begin(),
                                 scores.sensor_idxs.end(), sensor_idx);
    if (found == scores.sensor_idxs.end()) return;  // a reference
    gradient.segment<6>(RigScores::kNumColumns *
                        (found - scores.sensor_idxs.begin())) +=
        CenterDerivative(*after.sensor_from_rig[sensor_idx]).transpose() *
        direction;
  };
  for (const auto& [sensor1, sensor2] : known_distances) {
    const auto& pose1 = after.sensor_from_rig[sensor1];
    const auto& pose2 = after.sensor_from_rig[sensor2];
    if (!pose1 || !pose2) continue;
    const Vector3d distance = pose2->Center() - pose1->Center();
    add(sensor1, -distance.normalized());
    add(sensor2, distance.normalized());
    sum_after += distance.norm();
    sum_before += (before.sensor_from_rig[sensor2]->Center() -
                   before.sensor_from_rig[sensor1]->Center())
                      .norm();
  }
  if (!(sum_before > 0.0) || !(sum_after > 0.0)) return std::nullopt;
  gradient /= sum_after;
  return Stretch{
      std::log(sum_after / sum_before) + gradient.dot(NewtonStep(scores)),
      gradient.dot(Jackknife(scores) * gradient)};
}

}  // namespace

std::optional<UnitError> EstimateUnitError(
    const Scene& scene, const RigScores& scores, const DelayedRig& rig,
    const Reconstruction& model,
    const std::vector<std::pair<int, int>>& known_distances,
    const BundleAdjustmentOptions& options) {
  const Reconstruction& delayed = rig.model.rig;
  const double before = SpreadOf(model), after = SpreadOf(delayed);
  const double rig_size = RigSize(model);
  if (before <= rig_size || after <= rig_size) return std::nullopt;
  auto stretch = StretchOfKnownPoses(scene, scores, delayed, options);
  if (!stretch) {
    stretch = StretchOfDistances(scores, model, delayed, known_distances);
  }
  if (!stretch) return std::nullopt;
  UnitError error;
  error.log_factor = std::log(after / before) - stretch->value;
  error.sigma = std::sqrt(stretch->variance);
  error.is_certain =
      IsCertain(error.log_factor / error.sigma, scores.scores.cols());
  return error;
}

}  // namespace mgsfm
