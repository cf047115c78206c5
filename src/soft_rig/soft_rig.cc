// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/soft_rig/soft_rig.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "bundle/image_views.h"
#include "bundle/point_filters.h"
#include "bundle/retriangulation.h"
#include "bundle/solve.h"
#include "geometry/so3.h"
#include "least_squares/pose_covariances.h"
#include "least_squares/rig_solver.h"
#include "soft_rig/common_motion.h"
#include "soft_rig/deviations.h"
#include "soft_rig/soft_rig_problem.h"

namespace mgsfm {
namespace {

constexpr size_t kMaxNumSamples = 200;  // frames of a rig
constexpr int kNumTriangulations = 5;
constexpr double kMinShare = 0.02;      // of a spread that is not zero
constexpr double kMinSigmaPx = 0.05;    // also of keypoints without noise
constexpr double kMinSpreadRad = 1e-7;  // no prior need be narrower

// Sums over the observations in the images of each sensor.
struct ErrorSums {
  double sum_px = 0.0;
  size_t num_observations = 0;

  double Mean() const {
    return num_observations > 0 ? sum_px / static_cast<double>(num_observations)
                                : 0.0;
  }
};

std::vector<ErrorSums> SumErrors(const Scene& scene,
                                 const Reconstruction& reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  std::vector<ErrorSums> sums(scene.sensors.size());
  for (const Point3D& point : reconstruction.points) {
    for (const Observation& o : point.track) {
      if (!views[o.image_idx].is_registered) continue;
      const Image& image = scene.images[o.image_idx];
      const double error_px = views[o.image_idx].ReprojectionError(
          point.point_in_world,
          image.keypoints_px[o.keypoint_idx].cast<double>());
      if (!std::isfinite(error_px)) continue;
      sums[image.sensor_idx].sum_px += error_px;
      ++sums[image.sensor_idx].num_observations;
    }
  }
  return sums;
}

class RigLoosener {
 public:
  RigLoosener(const Scene& scene, const Scene& separate,
              const CandidateSource& candidates, const Reconstruction& initial,
              const SoftRigOptions& options,
              const BundleAdjustmentOptions& bundle_options,
              const Context& context, const BundlePriors& priors)
      : scene_(scene),
        separate_(separate),
        candidates_(candidates),
        initial_(initial),
        options_(options),
        bundle_options_(bundle_options),
        context_(context),
        priors_(priors),
        common_(scene, options, bundle_options) {
    // Poses and points are what this stage is about.
    bundle_options_.refine_rig_from_world = true;
    bundle_options_.refine_points = true;
  }

  SoftRigResult Run() {
    if (initial_.points.empty() || !HasFrameWithSeveralImages()) {
      summary_.message = "no frame has two registered images that see points";
      return Unchanged();
    }
    Start();
    for (int round = 0; round < options_.max_num_rounds; ++round) {
      context_.ReportProgress("loose synchronization", round,
                              options_.max_num_rounds);
      if (!RunRound()) return Unchanged();
      if (round < NumTriangulations()) {
        TriangulateAnew(NumTriangulations() - 1 - round);
      } else if (summary_.has_converged) {
        break;
      }
    }
    if (!FinishModel()) return Unchanged();
    Summarize();
    return {std::move(model_.rig),
            {model_.separate.rig_from_world, std::move(summary_)}};
  }

 private:
  int NumTriangulations() const { return candidates_ ? kNumTriangulations : 0; }

  bool HasFrameWithSeveralImages() const;
  SoftRigResult Unchanged();
  void Start();
  bool RunRound();
  SoftRigProblem BuildProblemOfRound() const;
  bool Solve(SoftRigProblem* loose);
  std::optional<std::vector<FrameDeviations>> SampleDeviations(
      const SoftRigProblem& loose) const;
  bool UpdateCommon(const std::vector<FrameDeviations>& deviations);
  void EstimateNoise();
  double MaxErrorOfRound(int num_rounds_left) const;
  void TriangulateAnew(int num_rounds_left);
  bool FinishModel();
  void Summarize();
  SoftRigSensor SummarizeSensor(int sensor_idx) const;
  void AddDeviations(SoftRigSensor* sensor) const;

  const Scene& scene_;
  const Scene& separate_;
  const CandidateSource& candidates_;
  const Reconstruction& initial_;
  const SoftRigOptions& options_;
  BundleAdjustmentOptions bundle_options_;
  const Context& context_;
  const BundlePriors& priors_;

  LooseModel model_;
  CommonMotion common_;
  std::vector<std::optional<Rigid3>> expected_;  // per image
  std::vector<Spread> spreads_;                  // per sensor
  std::vector<SpreadShare> shares_;
  double sigma_px_ = 1.0;  // noise of keypoints
  SoftRigSummary summary_;
};

bool RigLoosener::HasFrameWithSeveralImages() const {
  return std::any_of(
      scene_.frames.begin(), scene_.frames.end(), [&](const Frame& frame) {
        return std::count_if(frame.image_idxs.begin(), frame.image_idxs.end(),
                             [&](int image_idx) {
                               return initial_.IsRegistered(scene_, image_idx);
                             }) > 1;
      });
}

SoftRigResult RigLoosener::Unchanged() {
  summary_.is_usable = summary_.has_converged = false;
  SoftRigResult result{initial_, {{}, std::move(summary_)}};
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    result.images.cam_from_world.push_back(
        initial_.CamFromWorld(scene_, static_cast<int>(i)));
  }
  return result;
}

// The spreads to begin with are what would explain the errors in the rig.
void RigLoosener::Start() {
  model_.rig = initial_;
  std::vector<std::optional<Rigid3>> cam_from_world;
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    cam_from_world.push_back(
        initial_.CamFromWorld(scene_, static_cast<int>(i)));
  }
  model_.separate = SeparateImages(initial_, std::move(cam_from_world));
  EstimateNoise();
  const double distance =
      MedianDistance(separate_, model_.separate, context_.num_threads);
  for (const Sensor& sensor : scene_.sensors) {
    const Camera& camera = initial_.cameras[sensor.camera_idx];
    const double angle =
        sigma_px_ / PixelsPerRadian(camera.model, camera.params.data());
    spreads_.push_back({angle, angle * distance});
  }
  common_.SetRig(model_.rig);
  expected_ = common_.ExpectedPoses(initial_);
}

bool RigLoosener::RunRound() {
  SoftRigProblem loose = BuildProblemOfRound();
  if (!Solve(&loose)) return false;
  const auto deviations = SampleDeviations(loose);
  if (!deviations) {
    summary_.message = "the covariances of images cannot be computed";
    return false;
  }
  summary_.has_converged = UpdateCommon(*deviations);
  return true;
}

SoftRigProblem RigLoosener::BuildProblemOfRound() const {
  BundleAdjustmentOptions options = bundle_options_;
  options.loss_scale_px = LossScalePx(options, sigma_px_);
  return BuildLooseProblem(scene_, separate_, model_, expected_, spreads_,
                           sigma_px_, options, priors_);
}

bool RigLoosener::Solve(SoftRigProblem* loose) {
  RigSolverOptions options;
  options.backend = bundle_options_.backend;
  options.max_num_iterations = bundle_options_.max_num_iterations;
  options.function_tolerance = bundle_options_.function_tolerance;
  summary_.solves.push_back(SolveRigProblem(loose->built.problem, options,
                                            context_, &loose->built.state));
  const SolveSummary& solve = summary_.solves.back();
  if (!solve.IsUsable()) {
    summary_.message = "the images cannot be adjusted: " + solve.message;
    return false;
  }
  WriteBack(*loose, scene_, expected_, &model_);
  return true;
}

// Of frames at equal distances in the order of those with several images.
std::optional<std::vector<FrameDeviations>> RigLoosener::SampleDeviations(
    const SoftRigProblem& loose) const {
  const BuiltProblem& built = loose.built;
  std::vector<std::vector<int>> images_of_frame(built.frame_idxs.size());
  for (size_t i = 0; i < loose.image_idxs.size(); ++i) {
    images_of_frame[built.problem.images[i].frame].push_back(
        static_cast<int>(i));
  }
  std::vector<std::vector<std::vector<int>>> of_rig(scene_.rigs.size());
  for (size_t f = 0; f < images_of_frame.size(); ++f) {
    if (images_of_frame[f].size() < 2) continue;
    of_rig[scene_.frames[built.frame_idxs[f]].rig_idx].push_back(
        std::move(images_of_frame[f]));
  }
  std::vector<std::vector<int>> samples;
  for (const std::vector<std::vector<int>>& frames : of_rig) {
    const size_t count = std::min(frames.size(), kMaxNumSamples);
    for (size_t k = 0; k < count; ++k) {
      samples.push_back(frames[k * frames.size() / count]);
    }
  }
  const auto covariances =
      ComputeSensorCovariances(built.problem, built.state, samples, context_);
  if (!covariances) return std::nullopt;
  std::vector<FrameDeviations> frames;
  for (size_t k = 0; k < samples.size(); ++k) {
    FrameDeviations frame;
    frame.covariance = sigma_px_ * sigma_px_ * (*covariances)[k];
    for (const int i : samples[k]) {
      const int image_idx = loose.image_idxs[i];
      frame.images.push_back(
          {image_idx, scene_.images[image_idx].sensor_idx,
           DeviationOf(built.state.sensors[i], *expected_[image_idx])});
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

// Whether nothing changes any more.
bool RigLoosener::UpdateCommon(const std::vector<FrameDeviations>& deviations) {
  common_.SetRig(model_.rig);
  const double offset_change_s =
      common_.Update(deviations, spreads_, &model_.rig);
  expected_ = common_.ExpectedPoses(model_.rig);
  std::vector<int> rig_of_sensor;
  for (const Sensor& sensor : scene_.sensors) {
    rig_of_sensor.push_back(sensor.rig_idx);
  }
  std::vector<Spread> updated =
      UpdateSpreads(deviations, rig_of_sensor, spreads_, &shares_);
  const double distance =
      MedianDistance(separate_, model_.separate, context_.num_threads);
  double change = 0.0;
  const auto judge = [&](double share, double before, double least,
                         double* after) {
    *after = std::max(*after, least);
    if (share >= kMinShare) {
      change = std::max(change, std::abs(*after / before - 1.0));
    }
  };
  for (size_t s = 0; s < updated.size(); ++s) {
    judge(shares_[s].rotation, spreads_[s].rotation_rad, kMinSpreadRad,
          &updated[s].rotation_rad);
    judge(shares_[s].position, spreads_[s].position, kMinSpreadRad * distance,
          &updated[s].position);
  }
  spreads_ = std::move(updated);
  EstimateNoise();
  char line[160];
  std::snprintf(line, sizeof(line),
                "loose synchronization: %zu observations, noise %.3f px, "
                "spreads change by %.1f %%, time offsets by %.3g s",
                NumObservations(model_.separate), sigma_px_, 100.0 * change,
                offset_change_s);
  context_.Debug(line);
  return change <= options_.sigma_tolerance &&
         offset_change_s <= options_.time_offset_tolerance_s;
}

void RigLoosener::EstimateNoise() {
  sigma_px_ = std::max(kMinSigmaPx, NoiseSigmaPx(separate_, model_.separate,
                                                 context_.num_threads));
}

// The rigid model had to drop what did not fit it, so its points say that
// images are nearer to the rig than they are. Before the last round, poses may
// be wrong by as much as the spreads.
double RigLoosener::MaxErrorOfRound(int num_rounds_left) const {
  if (num_rounds_left == 0) {
    return MaxErrorPx(bundle_options_, sigma_px_, 0);
  }
  const double distance =
      MedianDistance(separate_, model_.separate, context_.num_threads);
  double misfit_px = 0.0;
  for (size_t s = 0; s < spreads_.size(); ++s) {
    const Camera& camera = model_.rig.cameras[scene_.sensors[s].camera_idx];
    misfit_px = std::max(misfit_px,
                         PixelsPerRadian(camera.model, camera.params.data()) *
                             std::hypot(spreads_[s].rotation_rad,
                                        spreads_[s].position / distance));
  }
  return MaxErrorPx(bundle_options_, std::hypot(sigma_px_, misfit_px),
                    std::min(num_rounds_left, 2));
}

void RigLoosener::TriangulateAnew(int num_rounds_left) {
  const double max_error_px = MaxErrorOfRound(num_rounds_left);
  Retriangulate(separate_, candidates_(model_.separate, max_error_px),
                MakeFilterOptions(separate_, model_.separate, bundle_options_,
                                  max_error_px, context_),
                context_.num_threads, &model_.separate);
  EstimateNoise();
}

bool RigLoosener::FinishModel() {
  FilterPoints(
      separate_,
      MakeFilterOptions(separate_, model_.separate, bundle_options_,
                        MaxErrorPx(bundle_options_, sigma_px_, 0), context_),
      context_.num_threads, &model_.separate);
  SoftRigProblem loose = BuildProblemOfRound();
  if (!Solve(&loose)) return false;
  ComputePointErrors(separate_, context_.num_threads, &model_.separate);
  model_.rig.points = model_.separate.points;
  return true;
}

void RigLoosener::Summarize() {
  summary_.is_usable = true;
  summary_.sigma_px = sigma_px_;
  const std::vector<ErrorSums> before = SumErrors(scene_, initial_);
  const std::vector<ErrorSums> after = SumErrors(separate_, model_.separate);
  for (const Rig& rig : scene_.rigs) {
    if (rig.sensor_idxs.size() < 2) continue;
    for (const int sensor_idx : rig.sensor_idxs) {
      SoftRigSensor sensor = SummarizeSensor(sensor_idx);
      if (sensor.num_images == 0) continue;
      sensor.mean_error_before_px = before[sensor_idx].Mean();
      sensor.num_observations_before = before[sensor_idx].num_observations;
      sensor.mean_error_after_px = after[sensor_idx].Mean();
      sensor.num_observations_after = after[sensor_idx].num_observations;
      summary_.sensors.push_back(std::move(sensor));
    }
  }
}

SoftRigSensor RigLoosener::SummarizeSensor(int sensor_idx) const {
  SoftRigSensor sensor;
  sensor.sensor_idx = sensor_idx;
  sensor.sigma_rotation_rad = spreads_[sensor_idx].rotation_rad;
  sensor.sigma_position = spreads_[sensor_idx].position;
  sensor.is_rigid = shares_[sensor_idx].rotation < kMinShare &&
                    shares_[sensor_idx].position < kMinShare;
  if (options_.method == SoftRig::kTimeOffset &&
      !scene_.IsReference(sensor_idx)) {
    const TimeOffset& offset = common_.offsets()[sensor_idx];
    if (offset.sigma_s) {
      sensor.time_offset_s = offset.value_s;
      sensor.time_offset_sigma_s = offset.sigma_s;
    } else {
      sensor.message =
          "its time offset is not observable: the rig stands, or moves so "
          "evenly that another place in the rig explains it as well";
    }
  }
  AddDeviations(&sensor);
  return sensor;
}

void RigLoosener::AddDeviations(SoftRigSensor* sensor) const {
  double sum_rotation = 0.0, sum_position = 0.0;
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    const Image& image = scene_.images[i];
    const auto& pose = model_.separate.rig_from_world[i];
    if (image.sensor_idx != sensor->sensor_idx || !pose) continue;
    const PoseVector deviation = DeviationOf(
        *pose * model_.rig.rig_from_world[image.frame_idx]->Inverse(),
        *expected_[i]);
    const double rotation = deviation.head<3>().norm();
    const double position = deviation.tail<3>().norm();
    ++sensor->num_images;
    sum_rotation += rotation * rotation;
    sum_position += position * position;
    sensor->max_rotation_rad = std::max(sensor->max_rotation_rad, rotation);
    sensor->max_position = std::max(sensor->max_position, position);
  }
  const double count = std::max(1, sensor->num_images);
  sensor->rms_rotation_rad = std::sqrt(sum_rotation / count);
  sensor->rms_position = std::sqrt(sum_position / count);
}

}  // namespace

SoftRigResult EstimateSoftRig(const Scene& scene, const Scene& separate,
                              const CandidateSource& candidates,
                              const Reconstruction& initial,
                              const SoftRigOptions& options,
                              const BundleAdjustmentOptions& bundle_options,
                              const Context& context,
                              const BundlePriors& priors) {
  return RigLoosener(scene, separate, candidates, initial, options,
                     bundle_options, context, priors)
      .Run();
}

}  // namespace mgsfm
