// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_delays.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "soft_rig/deviations.h"
#include "soft_rig/rig_scores.h"
#include "soft_rig/rig_timing.h"
#include "soft_rig/timed_rig.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kSensorColumns = RigScores::kNumColumns;

// The root mean square distance of frames from their mean position.
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

// The estimate of u and its variance.
struct Stretch {
  double value = 0.0;
  double variance = 0.0;
};

// The scores of u and of all columns, with priors on known quantities.
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

// The variance of the scores of blocks, divided by the variance for independent
// residuals with the keypoint noise.
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
  // Correlated residuals carry as much information as fewer independent ones.
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

// The scores with all prior variances multiplied by `factor`.
RigScores WithPriors(const KnownLengths& known, double factor) {
  RigScores joint = known.scores;
  joint.information.diagonal() +=
      known.information / (factor * joint.efficiency);
  joint.scores_of_priors =
      known.information.cwiseProduct(known.deviation) / factor;
  return joint;
}

// The factor of the prior variances, at least 1, by restricted maximum
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

// The error of the unit of length of `model`, which is defined by known sensor
// poses or known distances between sensors. `scores` have a fixed scale
// (RigGauge::kFixedScale) and are those of `rig`, which starts at `model` and
// may have delays.
//
// At a fixed scale of the world, the baselines of known poses are exp(u) times
// the known ones. u is estimated jointly with the delays and with the poses,
// which have priors. nullopt if no length is known, or if the frames are closer
// together than the sensors: the rig itself is then the largest length.
std::optional<UnitError> EstimateUnitError(
    const Scene& scene, const RigScores& scores, const TimedRig& rig,
    const Reconstruction& model,
    const std::vector<std::pair<int, int>>& known_distances,
    const BundleAdjustmentOptions& options) {
  const Reconstruction& delayed = rig.model;
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

// The same with pose columns only.
RigScores WithoutDelays(RigScores scores) {
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    HoldColumn(scores.DelayColumn(k), &scores);
  }
  return scores;
}

// The factor by which the variance of a sensor pose exceeds that of independent
// residuals, averaged over its coordinates.
double Overdispersion(const MatrixXd& actual, const MatrixXd& independent,
                      Eigen::Index first) {
  return independent.block<6, 6>(first, first)
             .ldlt()
             .solve(actual.block<6, 6>(first, first))
             .trace() /
         6.0;
}

// Whether a delay is significant for independent residuals.
bool MayBeDelayed(const RigScores& scores) {
  const VectorXd step = NewtonStep(scores);
  const MatrixXd covariance = CovarianceBy(scores.noise, scores);
  for (Eigen::Index k = kSensorColumns - 1; k < step.size();
       k += kSensorColumns) {
    // Independent normal residuals exceed this in 1 of 16,000 cameras.
    if (std::abs(step[k]) > 4.0 * std::sqrt(covariance(k, k))) {
      return true;
    }
  }
  return false;
}

std::vector<CameraDelay> Describe(const RigScores& rigid,
                                  const RigScores& scores, const TimedRig& rig,
                                  bool may_be_certain) {
  const MatrixXd covariance = Jackknife(scores);
  const RigScores poses = WithoutDelays(rigid);
  const MatrixXd of_poses = Jackknife(poses);
  const MatrixXd by_points = CovarianceBy(poses.noise_of_points, poses);
  const MatrixXd independent = CovarianceBy(poses.noise, poses);
  const VectorXd step = NewtonStep(scores);
  std::vector<CameraDelay> cameras;
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    const auto first = static_cast<Eigen::Index>(kSensorColumns * k);
    const Eigen::Index column = first + kSensorColumns - 1;
    CameraDelay camera{scores.sensor_idxs[k]};
    camera.delay = rig.delays[camera.sensor_idx] + step[column];
    camera.sigma = std::sqrt(covariance(column, column));
    camera.is_certain = may_be_certain && IsCertain(camera.delay / camera.sigma,
                                                    scores.scores.cols());
    camera.overdispersion =
        std::max(1.0, Overdispersion(of_poses, independent, first));
    camera.overdispersion_of_points =
        std::max(1.0, Overdispersion(by_points, independent, first));
    cameras.push_back(camera);
  }
  return cameras;
}

bool HasKnownLength(const Scene& scene, const RigMeasurements& measured) {
  return !measured.known_distances.empty() ||
         AnyOf(scene.sensors, [](const Sensor& sensor) {
           return sensor.sensor_from_rig &&
                  !sensor.sensor_from_rig->translation.isZero(0.0);
         });
}

}  // namespace

std::optional<RigDelays> EstimateRigDelays(
    const Scene& scene, const RigMeasurements& measured,
    const CandidateSource& candidates, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context) {
  TimedRig rig = StartTimedRig(scene, measured.times, model);
  const auto rigid = ComputeRigScores(scene, rig, options, context);
  if (!rigid || rigid->sensor_idxs.empty()) return std::nullopt;
  std::optional<RigScores> scores = rigid;
  bool has_converged = false;
  if (MayBeDelayed(*rigid)) {
    for (int round = 1; round <= 12 && !has_converged; ++round) {
      ApplyStep(scene, measured.times, *scores, NewtonStep(*scores), &rig);
      // The first rounds have wide error bounds, halved in each round.
      const int num_left = std::max(0, 3 - round);
      TriangulateAgain(scene, candidates, options, num_left, context,
                       &rig.model);
      scores = ComputeRigScores(scene, rig, options, context);
      if (!scores) return std::nullopt;
      has_converged =
          num_left == 0 &&
          IsInsignificant(*scores, NewtonStep(*scores), StepPart::kTimes);
    }
  }
  RigDelays result;
  result.is_in_seconds = measured.times.are_seconds;
  result.cameras =
      Describe(*rigid, *scores, rig,
               has_converged && DelaysMatter(scene, measured.times, rig.delays,
                                             rig.model, context));
  if (HasKnownLength(scene, measured)) {
    const auto fixed =
        ComputeRigScores(scene, rig, options, context, RigGauge::kFixedScale);
    if (fixed) {
      result.unit = EstimateUnitError(scene, *fixed, rig, model,
                                      measured.known_distances, options);
    }
  }
  result.delayed = std::move(rig.model);
  result.delayed.points.clear();
  return result;
}

void AddRigErrors(const Scene& scene, const Reconstruction& model,
                  const RigDelays& delays, CovarianceResult* covariances) {
  const bool are_certain = delays.AreCertain();
  std::vector<double> factor_of_rig(scene.rigs.size(), 0.0);
  const auto add = [&](const PoseVector& error,
                       std::optional<PoseMatrix>* covariance, double factor) {
    if (!*covariance || (*covariance)->isZero(0.0)) return;
    **covariance *= factor;
    if (are_certain) **covariance += error * error.transpose();
  };
  for (const CameraDelay& camera : delays.cameras) {
    const int i = camera.sensor_idx;
    double& factor = factor_of_rig[scene.sensors[i].rig_idx];
    factor = std::max(factor, camera.overdispersion);
    add(UpdateBetween(*model.sensor_from_rig[i],
                      *delays.delayed.sensor_from_rig[i]),
        &covariances->sensors[i],
        std::max(camera.overdispersion, camera.overdispersion_of_points));
  }
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    const double factor = factor_of_rig[scene.frames[f].rig_idx];
    const auto& after = delays.delayed.rig_from_world[f];
    const auto& before = model.rig_from_world[f];
    if (factor == 0.0 || !after || !before) continue;
    PoseVector error;
    error << LogSO3(after->rotation * before->rotation.conjugate()),
        after->Center() - before->Center();
    add(error, &covariances->frames[f], factor);
  }
}

}  // namespace mgsfm
