// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/soft_rig/soft_rig.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/retriangulation.h"
#include "bundle_adjustment/solve.h"
#include "geometry/so3.h"
#include "rig_solver/pose_covariances.h"
#include "rig_solver/rig_solver.h"
#include "scene/observations.h"
#include "soft_rig/deviations.h"

namespace mgsfm {
namespace {

// Rounds that triangulate points again. By then, the error bound of the points
// has decreased to the noise level. Two rounds increase errors by up to 31 %,
// ten change them by at most 2.4 % (docs/results/constants.md).
constexpr int kNumTriangulations = 5;
// Below this observed fraction, deviations are indistinguishable from zero: the
// relative standard error of a variance from 200 images, each with three
// coordinates, is sqrt(2 / (3 * 200)) / fraction = 2.9.
constexpr double kMinObservedFraction = 0.02;
// Lower bound of the sigmas: 1e-4 px at a focal length of 1000 px.
constexpr double kMinSigmaRad = 1e-7;

struct SoftRigRun : SoftRigInput {
  const SoftRigOptions& options;
  BundleAdjustmentOptions bundle_options;
  const Context& context;
};

struct SoftRigState {
  SoftRigModel model;
  std::vector<std::optional<Rigid3>> expected;  // per image
  std::vector<DeviationSigma> sigmas;           // per sensor
  std::vector<ObservedFraction> fractions;      // per sensor
  double sigma_px = 1.0;                        // noise of the keypoints
};

bool HasFrameWithSeveralImages(const SoftRigRun& input) {
  const Scene& scene = input.scene;
  return AnyOf(scene.frames, [&](const Frame& frame) {
    return CountIf(frame.image_idxs, [&](int image_idx) {
             return input.initial.IsRegistered(scene, image_idx);
           }) > 1;
  });
}

SoftRigResult Unchanged(const SoftRigRun& input, SoftRigSummary summary) {
  summary.is_usable = summary.has_converged = false;
  return {input.initial,
          {ImagePosesOf(input.scene, input.initial), std::move(summary)}};
}

double MedianPointDistance(const SoftRigRun& input, const SoftRigModel& model) {
  return MedianDistance(input.separate, model.separate,
                        input.context.num_threads);
}

double EstimateNoisePx(const SoftRigRun& input, const SoftRigModel& model) {
  return KeypointSigmaPx(input.separate, model.separate,
                         input.context.num_threads);
}

// The initial sigmas would explain the reprojection errors of the rigid model.
SoftRigState InitialState(const SoftRigRun& input) {
  SoftRigState state{
      {input.initial,
       SeparateImages(input.initial, ImagePosesOf(input.scene, input.initial))},
      {},
      {},
      {},
      1.0};
  state.sigma_px = EstimateNoisePx(input, state.model);
  const double distance = MedianPointDistance(input, state.model);
  for (const Sensor& sensor : input.scene.sensors) {
    const Camera& camera = input.initial.cameras[sensor.camera_idx];
    const double angle = state.sigma_px / PixelsPerRadian(camera);
    state.sigmas.push_back({angle, angle * distance});
  }
  state.expected = ExpectedPoses(input.scene, input.initial);
  return state;
}

BuiltProblem BuildProblemOfRound(const SoftRigRun& input,
                                 const SoftRigState& state) {
  BundleAdjustmentOptions options = input.bundle_options;
  options.loss_scale_px = LossScalePx(options, state.sigma_px);
  return BuildSoftRigProblem(input.scene, input.separate, state.model,
                             {state.expected, state.sigmas, state.sigma_px},
                             options, input.priors);
}

// Returns false, with a message in the summary, if the solve fails.
bool SolveImages(const SoftRigRun& input,
                 const std::vector<std::optional<Rigid3>>& expected,
                 BuiltProblem* soft, SoftRigModel* model,
                 SoftRigSummary* summary) {
  RigSolverOptions options;
  options.backend = input.bundle_options.backend;
  options.max_num_iterations = input.bundle_options.max_num_iterations;
  options.function_tolerance = input.bundle_options.function_tolerance;
  summary->solves.push_back(
      SolveRigProblem(soft->problem, options, input.context, &soft->state));
  const SolveSummary& solve = summary->solves.back();
  if (!solve.IsUsable()) {
    summary->message =
        "bundle adjustment of separate images failed: " + solve.message;
    return false;
  }
  WriteBack(*soft, input.scene, expected, model);
  return true;
}

// Lists the images in the problem for each sampled frame with several images.
// Samples are evenly spaced per rig.
std::vector<std::vector<int>> SampleFrames(const Scene& scene,
                                           const BuiltProblem& soft) {
  const BuiltProblem& built = soft;
  std::vector<std::vector<int>> images_of_frame(built.frame_idxs.size());
  for (size_t i = 0; i < soft.image_idxs.size(); ++i) {
    images_of_frame[built.problem.images[i].frame].push_back(
        static_cast<int>(i));
  }
  std::vector<std::vector<std::vector<int>>> frames_of_rig(scene.rigs.size());
  for (size_t f = 0; f < images_of_frame.size(); ++f) {
    if (images_of_frame[f].size() < 2) continue;
    frames_of_rig[scene.frames[built.frame_idxs[f]].rig_idx].push_back(
        std::move(images_of_frame[f]));
  }
  std::vector<std::vector<int>> samples;
  for (const std::vector<std::vector<int>>& frames : frames_of_rig) {
    // Number of frames per rig in the sums of soft_rig.h. The relative standard
    // error of a sigma from 200 frames is at most 1 / sqrt(6 * 200) = 2.9 %,
    // below the default sigma_tolerance.
    const size_t count = std::min(frames.size(), size_t{200});
    for (size_t k = 0; k < count; ++k) {
      samples.push_back(frames[k * frames.size() / count]);
    }
  }
  return samples;
}

// nullopt if the covariances cannot be computed.
std::optional<std::vector<FrameDeviations>> SampleDeviations(
    const SoftRigRun& input, const SoftRigState& state,
    const BuiltProblem& soft) {
  const BuiltProblem& built = soft;
  const std::vector<std::vector<int>> samples = SampleFrames(input.scene, soft);
  const auto covariances = ComputeSensorCovariances(built.problem, built.state,
                                                    samples, input.context);
  if (!covariances) return std::nullopt;
  std::vector<FrameDeviations> frames;
  for (size_t k = 0; k < samples.size(); ++k) {
    FrameDeviations frame;
    frame.covariance = state.sigma_px * state.sigma_px * (*covariances)[k];
    for (const int i : samples[k]) {
      const int image_idx = soft.image_idxs[i];
      frame.images.push_back(
          {image_idx, input.scene.images[image_idx].sensor_idx,
           UpdateBetween(*state.expected[image_idx], built.state.sensors[i])});
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

// Replaces the sigmas by `updated`, with lower bounds. Returns the largest
// relative change of a sigma that the images determine.
double ReplaceSigmas(std::vector<DeviationSigma> updated, double distance,
                     SoftRigState* state) {
  double change = 0.0;
  const auto bound = [&](double fraction, double before, double least,
                         double* after) {
    *after = std::max(*after, least);
    if (fraction >= kMinObservedFraction) {
      change = std::max(change, std::abs(*after / before - 1.0));
    }
  };
  for (size_t s = 0; s < updated.size(); ++s) {
    const ObservedFraction& fraction = state->fractions[s];
    const DeviationSigma& before = state->sigmas[s];
    bound(fraction.rotation, before.rotation_rad, kMinSigmaRad,
          &updated[s].rotation_rad);
    bound(fraction.position, before.position, kMinSigmaRad * distance,
          &updated[s].position);
  }
  state->sigmas = std::move(updated);
  return change;
}

// Updates all hyperparameters. Returns whether they have converged.
bool UpdateHyperparameters(const SoftRigRun& input,
                           const std::vector<FrameDeviations>& deviations,
                           SoftRigState* state) {
  SoftRigModel& model = state->model;
  UpdateExtrinsics(input.scene, deviations, state->sigmas, input.bundle_options,
                   &model.rig);
  state->expected = ExpectedPoses(input.scene, model.rig);
  std::vector<DeviationSigma> updated = UpdateSigmas(
      deviations, Transformed(input.scene.sensors, &Sensor::rig_idx),
      state->sigmas, &state->fractions);
  const double change = ReplaceSigmas(std::move(updated),
                                      MedianPointDistance(input, model), state);
  state->sigma_px = EstimateNoisePx(input, model);
  input.context.Debug(Formatted(
      "soft rig: %zu observations, noise %.3f px, standard "
      "deviations change by %.1f %%",
      NumObservations(model.separate), state->sigma_px, 100.0 * change));
  return change <= input.options.sigma_tolerance;
}

bool RunRound(const SoftRigRun& input, SoftRigState* state,
              SoftRigSummary* summary) {
  BuiltProblem soft = BuildProblemOfRound(input, *state);
  if (!SolveImages(input, state->expected, &soft, &state->model, summary)) {
    return false;
  }
  const auto deviations = SampleDeviations(input, *state, soft);
  if (!deviations) {
    summary->message = "the covariances of the images cannot be computed";
    return false;
  }
  summary->has_converged = UpdateHyperparameters(input, *deviations, state);
  return true;
}

// The rigid model lacks observations that do not fit it, so its points
// underestimate the deviations. Until the last round, the bound therefore
// includes the error that the current sigmas can cause.
double MaxErrorOfRound(const SoftRigRun& input, const SoftRigState& state,
                       int num_rounds_left) {
  if (num_rounds_left == 0) {
    return MaxErrorPx(input.bundle_options, state.sigma_px, 0);
  }
  const double distance = MedianPointDistance(input, state.model);
  double misfit_px = 0.0;
  for (size_t s = 0; s < state.sigmas.size(); ++s) {
    const Camera& camera =
        state.model.rig.cameras[input.scene.sensors[s].camera_idx];
    misfit_px = std::max(misfit_px,
                         PixelsPerRadian(camera) *
                             std::hypot(state.sigmas[s].rotation_rad,
                                        state.sigmas[s].position / distance));
  }
  return MaxErrorPx(input.bundle_options, std::hypot(state.sigma_px, misfit_px),
                    std::min(num_rounds_left, 2));
}

void RetriangulatePoints(const SoftRigRun& input, int num_rounds_left,
                         SoftRigState* state) {
  const double max_error_px = MaxErrorOfRound(input, *state, num_rounds_left);
  Reconstruction& model = state->model.separate;
  Retriangulate(input.separate, *input.candidates.groups(model, max_error_px),
                MakeFilterOptions(input.separate, model, input.bundle_options,
                                  max_error_px, input.context),
                input.context.num_threads, &model);
  state->sigma_px = EstimateNoisePx(input, state->model);
}

// Filters the points and solves (1) a last time.
bool FinishModel(const SoftRigRun& input, SoftRigState* state,
                 SoftRigSummary* summary) {
  const int num_threads = input.context.num_threads;
  SoftRigModel& model = state->model;
  FilterPoints(
      input.separate,
      MakeFilterOptions(input.separate, model.separate, input.bundle_options,
                        MaxErrorPx(input.bundle_options, state->sigma_px, 0),
                        input.context),
      num_threads, &model.separate);
  BuiltProblem soft = BuildProblemOfRound(input, *state);
  if (!SolveImages(input, state->expected, &soft, &model, summary)) {
    return false;
  }
  ComputePointErrors(input.separate, num_threads, &model.separate);
  model.rig.points = model.separate.points;
  return true;
}

// Sets the number, mean and maximum of the final deviations.
void SummarizeDeviations(const SoftRigRun& input, const SoftRigState& state,
                         SoftRigSensor* sensor) {
  double sum_rotation = 0.0, sum_position = 0.0;
  for (size_t i = 0; i < input.scene.images.size(); ++i) {
    const Image& image = input.scene.images[i];
    const auto& pose = state.model.separate.rig_from_world[i];
    if (image.sensor_idx != sensor->sensor_idx || !pose) continue;
    const PoseVector deviation = UpdateBetween(
        *state.expected[i],
        *pose * state.model.rig.rig_from_world[image.frame_idx]->Inverse());
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

SoftRigSensor SummarizeSensor(const SoftRigRun& input,
                              const SoftRigState& state, int sensor_idx) {
  SoftRigSensor sensor;
  sensor.sensor_idx = sensor_idx;
  sensor.sigma_rotation_rad = state.sigmas[sensor_idx].rotation_rad;
  sensor.sigma_position = state.sigmas[sensor_idx].position;
  sensor.is_rigid =
      state.fractions[sensor_idx].rotation < kMinObservedFraction &&
      state.fractions[sensor_idx].position < kMinObservedFraction;
  SummarizeDeviations(input, state, &sensor);
  return sensor;
}

void Summarize(const SoftRigRun& input, const SoftRigState& state,
               SoftRigSummary* summary) {
  summary->is_usable = true;
  summary->sigma_px = state.sigma_px;
  const std::vector<ErrorSums> before = SumErrors(input.scene, input.initial);
  const std::vector<ErrorSums> after =
      SumErrors(input.separate, state.model.separate);
  for (const Rig& rig : input.scene.rigs) {
    if (rig.sensor_idxs.size() < 2) continue;
    for (const int sensor_idx : rig.sensor_idxs) {
      SoftRigSensor sensor = SummarizeSensor(input, state, sensor_idx);
      if (sensor.num_images == 0) continue;
      sensor.mean_error_before_px = before[sensor_idx].Mean();
      sensor.num_observations_before = before[sensor_idx].num_observations;
      sensor.mean_error_after_px = after[sensor_idx].Mean();
      sensor.num_observations_after = after[sensor_idx].num_observations;
      summary->sensors.push_back(std::move(sensor));
    }
  }
}

}  // namespace

SoftRigResult EstimateSoftRig(const SoftRigInput& model_input,
                              const SoftRigOptions& options,
                              const BundleAdjustmentOptions& bundle_options,
                              const Context& context) {
  SoftRigRun input{model_input, options, bundle_options, context};
  // This stage always refines poses and points.
  input.bundle_options.refine_rig_from_world = true;
  input.bundle_options.refine_points = true;
  SoftRigSummary summary;
  if (input.initial.points.empty() || !HasFrameWithSeveralImages(input)) {
    summary.message = "no frame has two registered images that observe points";
    return Unchanged(input, std::move(summary));
  }
  const int num_triangulations =
      input.candidates.groups ? kNumTriangulations : 0;
  SoftRigState state = InitialState(input);
  for (int round = 0; round < options.max_num_rounds; ++round) {
    context.ReportProgress("soft rig", round, options.max_num_rounds);
    if (!RunRound(input, &state, &summary)) {
      return Unchanged(input, std::move(summary));
    }
    if (round < num_triangulations) {
      RetriangulatePoints(input, num_triangulations - 1 - round, &state);
    } else if (summary.has_converged) {
      break;
    }
  }
  if (!FinishModel(input, &state, &summary)) {
    return Unchanged(input, std::move(summary));
  }
  Summarize(input, state, &summary);
  return {std::move(state.model.rig),
          {state.model.separate.rig_from_world, std::move(summary)}};
}

}  // namespace mgsfm
