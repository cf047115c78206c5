// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_delays.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/retriangulation.h"
#include "bundle_adjustment/solve.h"
#include "geometry/so3.h"
#include "soft_rig/rig_scores.h"
#include "soft_rig/rig_trajectory.h"
#include "soft_rig/score_statistics.h"
#include "soft_rig/unit_error.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kSensorColumns = RigScores::kNumColumns;

void SetMotions(const Scene& scene, const std::vector<double>& times,
                DelayedRig* rig) {
  rig->motions.assign(scene.frames.size(), PoseVector::Zero());
  for (size_t r = 0; r < scene.rigs.size(); ++r) {
    std::vector<std::pair<double, int>> frames;
    for (size_t f = 0; f < scene.frames.size(); ++f) {
      if (scene.frames[f].rig_idx != static_cast<int>(r) ||
          !rig->model.rig.rig_from_world[f]) {
        continue;
      }
      frames.emplace_back(times[f], static_cast<int>(f));
    }
    if (frames.empty()) continue;
    std::sort(frames.begin(), frames.end());
    std::vector<double> ordered;
    std::vector<Rigid3> poses;
    for (const auto& [time, f] : frames) {
      ordered.push_back(time);
      poses.push_back(*rig->model.rig.rig_from_world[f]);
    }
    const RigTrajectory trajectory(ordered, poses);
    for (size_t k = 0; k < frames.size(); ++k) {
      rig->motions[frames[k].second] = trajectory.VelocityAt(k);
      // Ten blocks of frames: Student's t of nine degrees of freedom.
      rig->block_of_frame[frames[k].second] =
          static_cast<int>(k * 10 / frames.size());
    }
  }
}

void SetImagePoses(const Scene& scene, DelayedRig* rig) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto& pose = rig->model.separate.rig_from_world[i];
    if (!pose) continue;
    pose = DelayedPose(scene, *rig, static_cast<int>(i)) *
           *rig->model.rig.rig_from_world[scene.images[i].frame_idx];
  }
}

// The same for the poses alone.
RigScores WithoutDelays(RigScores scores) {
  const auto clear = [](MatrixXd* matrix) {
    for (Eigen::Index k = kSensorColumns - 1; k < matrix->rows();
         k += kSensorColumns) {
      matrix->row(k).setZero();
      if (matrix->rows() == matrix->cols()) matrix->col(k).setZero();
    }
  };
  clear(&scores.information);
  clear(&scores.scores);
  for (MatrixXd& information : scores.block_information) clear(&information);
  return scores;
}

// The factor by which the variance of the pose of a sensor exceeds that of
// independent residuals, in the mean over its coordinates.
double Overdispersion(const MatrixXd& actual, const MatrixXd& independent,
                      Eigen::Index first) {
  return independent.block<6, 6>(first, first)
             .ldlt()
             .solve(actual.block<6, 6>(first, first))
             .trace() /
         6.0;
}

void Step(const RigScores& scores, const VectorXd& x, DelayedRig* rig) {
  Reconstruction& model = rig->model.rig;
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    const auto change = x.segment<kSensorColumns>(
        static_cast<Eigen::Index>(kSensorColumns * k));
    Rigid3& pose = *model.sensor_from_rig[scores.sensor_idxs[k]];
    pose.rotation = (ExpSO3(change.head<3>()) * pose.rotation).normalized();
    pose.translation += change.segment<3>(3);
    rig->delays[scores.sensor_idxs[k]] += change[6];
  }
  VectorXd all(x.size() + 1);
  all << x, 1.0;
  for (size_t f = 0; f < scores.frame_idxs.size(); ++f) {
    const PoseVector change = scores.frame_response[f] * all;
    Rigid3& pose = *model.rig_from_world[scores.frame_idxs[f]];
    pose = Rigid3::FromRotationAndCenter(
        (ExpSO3(change.head<3>()) * pose.rotation).normalized(),
        pose.Center() + change.tail<3>());
  }
}
// Whether independent residuals would show a delay.
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
                                  const RigScores& scores,
                                  const DelayedRig& rig, bool has_converged) {
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
    camera.is_certain = has_converged && IsCertain(camera.delay / camera.sigma,
                                                   scores.scores.cols());
    camera.overdispersion =
        std::max(1.0, Overdispersion(of_poses, independent, first));
    camera.overdispersion_of_points =
        std::max(1.0, Overdispersion(by_points, independent, first));
    cameras.push_back(camera);
  }
  return cameras;
}

bool HasConverged(const RigScores& scores) {
  const VectorXd step = NewtonStep(scores);
  const MatrixXd covariance = Jackknife(scores);
  for (Eigen::Index k = kSensorColumns - 1; k < step.size();
       k += kSensorColumns) {
    // Smaller changes matter less than chance does.
    if (std::abs(step[k]) > 0.1 * std::sqrt(covariance(k, k))) {
      return false;
    }
  }
  return true;
}

void Triangulate(const Scene& separate, const CandidateSource& candidates,
                 const BundleAdjustmentOptions& options, int num_rounds_left,
                 const Context& context, Reconstruction* model) {
  // The misfit of delays is unknown at first: any error up to the largest one.
  const double sigma_px =
      num_rounds_left > 0 ? std::numeric_limits<double>::infinity()
                          : NoiseSigmaPx(separate, *model, context.num_threads);
  const double max_error_px = MaxErrorPx(options, sigma_px, num_rounds_left);
  Retriangulate(
      separate, *candidates.groups(*model, max_error_px),
      MakeFilterOptions(separate, *model, options, max_error_px, context),
      context.num_threads, model);
}

bool HasKnownLength(const Scene& scene, const RigMeasurements& measured) {
  return !measured.known_distances.empty() ||
         std::any_of(scene.sensors.begin(), scene.sensors.end(),
                     [](const Sensor& sensor) {
                       return sensor.sensor_from_rig &&
                              !sensor.sensor_from_rig->translation.isZero(0.0);
                     });
}

}  // namespace

std::optional<RigDelays> EstimateRigDelays(
    const Scene& scene, const RigMeasurements& measured,
    const std::function<CandidateSource(const Scene& separate)>& candidates,
    const Reconstruction& model, const BundleAdjustmentOptions& options,
    const Context& context) {
  std::vector<std::optional<Rigid3>> poses;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    poses.push_back(model.CamFromWorld(scene, static_cast<int>(i)));
  }
  const Scene separate = SeparateImages(scene);
  DelayedRig rig{{model, SeparateImages(model, poses)},
                 {},
                 std::vector<int>(scene.frames.size(), 0),
                 std::vector<double>(scene.sensors.size(), 0.0)};
  SetMotions(scene, measured.times.times, &rig);
  const auto rigid = ComputeRigScores(scene, separate, rig, options, context);
  if (!rigid) return std::nullopt;
  std::optional<RigScores> scores = rigid;
  bool has_converged = false;
  if (MayBeDelayed(*rigid)) {
    const CandidateSource source = candidates(separate);
    for (int round = 1; round <= 12 && !has_converged; ++round) {
      Step(*scores, NewtonStep(*scores), &rig);
      SetMotions(scene, measured.times.times, &rig);
      SetImagePoses(scene, &rig);
      // The first rounds have wide bounds on errors, each half as wide as the
      // bound before.
      const int num_left = std::max(0, 3 - round);
      Triangulate(separate, source, options, num_left, context,
                  &rig.model.separate);
      scores = ComputeRigScores(scene, separate, rig, options, context);
      if (!scores) return std::nullopt;
      has_converged = num_left == 0 && HasConverged(*scores);
    }
  }
  RigDelays result;
  result.is_in_seconds = measured.times.are_seconds;
  result.cameras = Describe(*rigid, *scores, rig, has_converged);
  if (HasKnownLength(scene, measured)) {
    const auto fixed = ComputeRigScores(scene, separate, rig, options, context,
                                        RigGauge::kFixedScale);
    if (fixed) {
      result.unit = EstimateUnitError(scene, *fixed, rig, model,
                                      measured.known_distances, options);
    }
  }
  for (const PoseVector& motion : rig.motions) {
    result.angular_velocities.emplace_back(motion.head<3>());
  }
  result.delayed = std::move(rig.model.rig);
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
    add(DeviationOf(*delays.delayed.sensor_from_rig[i],
                    *model.sensor_from_rig[i]),
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
