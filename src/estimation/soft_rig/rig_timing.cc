// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_timing.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/solve.h"
#include "scene/observations.h"
#include "soft_rig/deviations.h"
#include "soft_rig/rig_scores.h"
#include "soft_rig/timed_rig.h"

namespace mgsfm {
namespace {

// Rounds before the first solve. Their bounds on errors are halved in each, as
// in EstimateRigDelays().
constexpr int kNumOpenRounds = 2;

constexpr int kNumTriangulatedRounds = kNumOpenRounds + 1;

// Converged when motions change by at most this fraction. A share of at most
// about a half of their error remains in a round, as the motions of a rig
// during delays are shorter than its baselines.
constexpr double kMotionTolerance = 1e-3;

// The spurious information of one image on a time, due to velocity noise, in
// 1 / interval^2: the velocity between two frames that are as noisy as the
// image has variance 2 sigma^2 / interval^2 in each of six coordinates.
constexpr double kNoiseInformation = 12.0;

struct TimingRun : RigTimingInput {
  const SoftRigOptions& options;
  BundleAdjustmentOptions bundle_options;
  const Context& context;
  std::vector<double> intervals;  // median time between frames, per rig

  double IntervalOf(int sensor_idx) const {
    return intervals[scene.sensors[sensor_idx].rig_idx];
  }
};

// The standard deviations of estimated times; nullopt for the others.
struct TimeSigmas {
  std::vector<std::optional<double>> delays, readouts;  // per sensor
};

std::vector<int> CountImages(const Scene& scene, const Reconstruction& model) {
  std::vector<int> counts(scene.sensors.size(), 0);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    counts[scene.images[i].sensor_idx] +=
        model.IsRegistered(scene, static_cast<int>(i));
  }
  return counts;
}

// The standard deviation of the time in a column; nullopt unless independent
// residuals determine it to the given share of the interval between frames.
std::optional<double> SigmaOfTime(const RigScores& scores, Eigen::Index column,
                                  int num_images, double interval,
                                  const SoftRigOptions& options) {
  const double noise = kNoiseInformation * num_images / (interval * interval);
  const double most = options.max_time_offset_sigma * interval;
  const double information =
      1.0 / CovarianceBy(scores.noise, scores)(column, column) - noise;
  if (!(information * most * most >= 1.0)) return std::nullopt;
  const Eigen::MatrixXd noise_of_priors =
      scores.sigma_px * scores.sigma_px *
      Eigen::MatrixXd(scores.information_of_priors.asDiagonal());
  return std::sqrt(
      std::max(1.0 / information, Jackknife(scores)(column, column)) +
      CovarianceBy(noise_of_priors, scores)(column, column));
}

// Holds the times that the motion of the rig does not determine. Holding them
// improves the others, which are therefore evaluated a second time.
TimeSigmas HoldUnobservable(const TimingRun& run, TimedRig* rig,
                            RigScores* scores) {
  const Scene& scene = run.scene;
  const std::vector<int> num_images = CountImages(scene, rig->model);
  const std::vector<std::optional<double>> none(scene.sensors.size());
  TimeSigmas sigmas{none, none};
  std::vector<bool> is_held(scores->scores.rows(), false);
  for (int pass = 0; pass < 2; ++pass) {
    const RigScores before = *scores;
    const auto judge = [&](int sensor_idx, Eigen::Index column,
                           std::optional<double>* sigma, double* value) {
      if (is_held[column]) return;
      *sigma = SigmaOfTime(before, column, num_images[sensor_idx],
                           run.IntervalOf(sensor_idx), run.options);
      if (*sigma) return;
      is_held[column] = true;
      *value = 0.0;
      HoldColumn(column, scores);
    };
    for (size_t k = 0; k < scores->sensor_idxs.size(); ++k) {
      const int s = scores->sensor_idxs[k];
      if (!rig->estimates_delays) break;
      judge(s, scores->DelayColumn(k), &sigmas.delays[s], &rig->delays[s]);
    }
    for (size_t k = 0; k < scores->readout_sensor_idxs.size(); ++k) {
      const int s = scores->readout_sensor_idxs[k];
      judge(s, scores->ReadoutColumn(k), &sigmas.readouts[s],
            &rig->readouts[s]);
    }
  }
  return sigmas;
}

// Limits the changes of times to half the interval between frames, within which
// the trajectory is known.
void LimitTimes(const TimingRun& run, const RigScores& scores,
                Eigen::VectorXd* step) {
  const auto limit = [&](int sensor_idx, Eigen::Index column) {
    const double most = 0.5 * run.IntervalOf(sensor_idx);
    (*step)[column] = std::clamp((*step)[column], -most, most);
  };
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    limit(scores.sensor_idxs[k], scores.DelayColumn(k));
  }
  for (size_t k = 0; k < scores.readout_sensor_idxs.size(); ++k) {
    limit(scores.readout_sensor_idxs[k], scores.ReadoutColumn(k));
  }
}

// The root mean square change of the shifts of motions, divided by their root
// mean square.
double ChangeOf(const std::vector<RigMotion>& after,
                const std::vector<RigMotion>& before) {
  double change = 0.0, squares = 0.0;
  for (size_t i = 0; i < after.size(); ++i) {
    change +=
        (after[i].shift_in_world - before[i].shift_in_world).squaredNorm();
    squares += after[i].shift_in_world.squaredNorm();
  }
  return squares > 0.0 ? std::sqrt(change / squares) : 0.0;
}

// Bundle adjustment at the current times.
bool SolveAtTimes(const TimingRun& run, const Scene& seen, TimedRig* rig,
                  SoftRigSummary* summary) {
  const auto noise_px = [&] {
    return KeypointSigmaPx(seen, rig->model, run.context.num_threads);
  };
  // Later, points lag behind the step before the solve.
  if (summary->solves.empty()) summary->sigma_px = noise_px();
  BundleAdjustmentOptions options = run.bundle_options;
  options.loss_scale_px = LossScalePx(options, summary->sigma_px);
  BundleResult result;
  result.estimate = std::move(rig->model);
  const bool is_solved =
      SolveOnce(seen, run.conditions, options, {}, run.context, &result);
  rig->model = std::move(result.estimate);
  summary->solves.push_back(result.summary.solves.back());
  if (!is_solved) {
    summary->message = "bundle adjustment of late images failed: " +
                       summary->solves.back().message;
    return false;
  }
  summary->sigma_px = noise_px();
  UpdateMotions(run.scene, run.times, rig);
  // Positions define the unit of length, too.
  if (run.conditions.priors.positions.IsEmpty()) {
    ScaleToKnownRig(run.scene, &rig->model);
  }
  return true;
}

bool HasMotions(const TimedRig& rig) {
  return AnyOf(rig.model.motions, [](const RigMotion& motion) {
    return !motion.shift_in_world.isZero(0.0);
  });
}

// One round. Returns false, with a message in the summary, on failure.
bool RunRound(const TimingRun& run, int round, TimedRig* rig,
              TimeSigmas* sigmas, SoftRigSummary* summary) {
  const std::optional<Scene> moved = WithoutReadouts(run.scene, *rig);
  const Scene& seen = moved ? *moved : run.scene;
  const std::vector<RigMotion> before = rig->model.motions;
  // The points of the initial model suit the times of frames.
  const bool has_points = round == 0 && !HasMotions(*rig);
  if (!has_points && round <= kNumTriangulatedRounds) {
    TriangulateAgain(seen, run.candidates(seen), run.bundle_options,
                     std::max(0, kNumOpenRounds - round), run.context,
                     &rig->model);
  }
  if (round >= kNumOpenRounds && !SolveAtTimes(run, seen, rig, summary)) {
    return false;
  }
  auto scores = ComputeRigScores(seen, *rig, run.bundle_options, run.context,
                                 RigGauge::kKnownShape);
  if (!scores) {
    summary->message = "the equations of the rig cannot be factorized";
    return false;
  }
  *sigmas = HoldUnobservable(run, rig, &*scores);
  Eigen::VectorXd step = NewtonStep(*scores);
  summary->has_converged =
      summary->solves.size() >= 2 &&
      ChangeOf(rig->model.motions, before) <= kMotionTolerance &&
      IsInsignificant(*scores, step, StepPart::kAll);
  const bool is_last = round + 1 == run.options.max_num_rounds;
  if (summary->has_converged || is_last) return true;
  LimitTimes(run, *scores, &step);
  ApplyStep(run.scene, run.times, *scores, step, rig);
  std::string times;
  for (const double delay : rig->delays) times += Formatted(" %.5f", delay);
  for (const double t : rig->readouts) times += Formatted(" %.5f", t);
  run.context.Debug(
      Formatted("times of the rig: %zu observations, noise %.3f px,",
                NumObservations(rig->model), summary->sigma_px) +
      times);
  return true;
}

void Summarize(const TimingRun& run, const Scene& seen, const TimedRig& rig,
               const TimeSigmas& sigmas, SoftRigSummary* summary) {
  const Scene& scene = run.scene;
  summary->is_usable = true;
  const std::vector<ErrorSums> before = SumErrors(scene, run.initial);
  const std::vector<ErrorSums> after = SumErrors(seen, rig.model);
  const std::vector<int> num_images = CountImages(scene, rig.model);
  for (size_t s = 0; s < scene.sensors.size(); ++s) {
    SoftRigSensor sensor;
    sensor.sensor_idx = static_cast<int>(s);
    sensor.num_images = num_images[s];
    sensor.is_rigid = true;
    if (sensor.num_images == 0) continue;
    const bool has_delay =
        rig.estimates_delays && !scene.IsReference(sensor.sensor_idx);
    sensor.time_offset_sigma_s = sigmas.delays[s];
    if (sigmas.delays[s]) sensor.time_offset_s = rig.delays[s];
    sensor.readout_sigma_s = sigmas.readouts[s];
    if (sigmas.readouts[s]) sensor.readout_s = rig.readouts[s];
    if ((has_delay && !sigmas.delays[s]) ||
        (rig.estimates_readouts && !sigmas.readouts[s])) {
      sensor.message =
          "its times are not observable: the rig stands still, or moves so "
          "uniformly that different extrinsics explain the images equally well";
    }
    sensor.mean_error_before_px = before[s].Mean();
    sensor.num_observations_before = before[s].num_observations;
    sensor.mean_error_after_px = after[s].Mean();
    sensor.num_observations_after = after[s].num_observations;
    summary->sensors.push_back(std::move(sensor));
  }
}

// The displacement of keypoints that counts, in deviations of their noise: 1 %
// of the variance of residuals.
constexpr double kMinDisplacement = 0.1;

// Whether two motions of the images move keypoints apart by more than this
// (root mean square).
bool AreVisiblyDifferent(const Scene& scene, const Reconstruction& model,
                         const std::vector<RigMotion>& motions1,
                         const std::vector<RigMotion>& motions2,
                         const Context& context) {
  Reconstruction moved = model;
  const auto views_with = [&](const std::vector<RigMotion>& motions) {
    moved.motions = motions;
    return MakeImageViews(scene, moved);
  };
  const std::vector<ImageView> views1 = views_with(motions1);
  const std::vector<ImageView> views2 = views_with(motions2);
  double squares = 0.0, count = 0.0;
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      const auto pixel1 = views1[o.image_idx].Project(point.point_in_world);
      const auto pixel2 = views2[o.image_idx].Project(point.point_in_world);
      if (!pixel1 || !pixel2) continue;
      squares += (*pixel2 - *pixel1).squaredNorm();
      count += 1.0;
    }
  }
  const double least_px =
      kMinDisplacement * KeypointSigmaPx(scene, model, context.num_threads);
  return squares > count * least_px * least_px;
}

}  // namespace

SoftRigResult EstimateRigTiming(const RigTimingInput& timing_input,
                                const SoftRigOptions& options,
                                const BundleAdjustmentOptions& bundle_options,
                                const Context& context) {
  TimedRig rig = StartTimedRig(timing_input.scene, timing_input.times,
                               timing_input.initial);
  const TimingRun run{timing_input, options, bundle_options, context,
                      FindImageMotions(timing_input.scene, timing_input.times,
                                       rig.delays, rig.model)
                          .median_intervals};
  const SoftRig method = options.method;
  rig.estimates_delays =
      method == SoftRig::kTimeOffset || method == SoftRig::kBoth;
  rig.estimates_readouts =
      method == SoftRig::kReadout || method == SoftRig::kBoth;
  SoftRigSummary summary;
  TimeSigmas sigmas;
  for (int round = 0; round < options.max_num_rounds && !summary.has_converged;
       ++round) {
    context.ReportProgress("soft rig", round, options.max_num_rounds);
    if (!RunRound(run, round, &rig, &sigmas, &summary)) {
      return {run.initial, {ImagePosesOf(run.scene, run.initial), summary}};
    }
  }
  const std::optional<Scene> moved = WithoutReadouts(run.scene, rig);
  const Scene& seen = moved ? *moved : run.scene;
  Summarize(run, seen, rig, sigmas, &summary);
  ComputePointErrors(seen, context.num_threads, &rig.model);
  SoftRigImages images{ImagePosesOf(run.scene, rig.model), std::move(summary)};
  return {std::move(rig.model), std::move(images)};
}

bool TimesMatter(const Scene& scene, const CaptureTimes& times,
                 const Reconstruction& model, const Context& context) {
  const std::vector<double> no_delays(scene.sensors.size(), 0.0);
  return AreVisiblyDifferent(
      scene, model, model.motions,
      FindImageMotions(scene, times, no_delays, model).since_frame, context);
}

bool DelaysMatter(const Scene& scene, const CaptureTimes& times,
                  const std::vector<double>& delays,
                  const Reconstruction& model, const Context& context) {
  const std::vector<double> no_delays(scene.sensors.size(), 0.0);
  return AreVisiblyDifferent(
      scene, model,
      FindImageMotions(scene, times, no_delays, model).since_frame,
      FindImageMotions(scene, times, delays, model).since_frame, context);
}

bool ExplainsMore(const Scene& scene, const Reconstruction& a,
                  const Reconstruction& b,
                  const BundleAdjustmentOptions& options,
                  const Context& context) {
  const auto bound_of = [&](const Reconstruction& model) {
    return MaxErrorPx(options, NoiseSigmaPx(scene, model, context.num_threads),
                      0);
  };
  const double bound_px = std::min(bound_of(a), bound_of(b));
  const auto explained = [&](const Reconstruction& model) {
    const std::vector<ImageView> views = MakeImageViews(scene, model);
    double sum = 0.0;
    for (const Point3D& point : model.points) {
      for (const Observation& o : point.track) {
        const double ratio =
            ReprojectionError(scene, views, o, point.point_in_world) / bound_px;
        if (ratio < 1.0) sum += 1.0 - ratio * ratio;
      }
    }
    return sum;
  };
  return explained(a) > explained(b);
}

}  // namespace mgsfm
