// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <utility>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "bundle_adjustment/residual_field.h"
#include "bundle_adjustment/solve.h"
#include "geometry/decompositions.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "rig_solver/pose_covariances.h"

namespace mgsfm {
namespace {

// Expresses priors in units of the observation noise.
void WeighPriors(double sigma_px, BundleProblem* problem) {
  for (RigProblemBase::ParameterPrior& prior : problem->priors) {
    prior.sigma /= sigma_px;
  }
  for (SensorPrior& prior : problem->sensor_priors) {
    prior.sigma_rad /= sigma_px;
    prior.sigma_length /= sigma_px;
  }
  for (PositionPrior& prior : problem->position_priors) {
    prior.sqrt_information *= sigma_px;
  }
  problem->position_loss.scale *= sigma_px;
}

// The problem of a model in units of its observation noise.
BuiltProblem BuildWeighted(const Scene& scene,
                           const Reconstruction& reconstruction,
                           const BundleAdjustmentOptions& options,
                           double sigma_px, const BundlePriors& priors) {
  BundleAdjustmentOptions weighted = options;
  weighted.loss_scale_px = LossScalePx(options, sigma_px);
  BuiltProblem built =
      BuildProblem(scene, reconstruction, weighted, RefinedParts::kAll,
                   {priors.positions, std::nullopt, priors.calibration});
  WeighPriors(sigma_px, &built.problem);
  return built;
}

void DescribeGauge(const BuiltProblem& built, CovarianceResult* result) {
  const BundleProblem& problem = built.problem;
  const auto num_free = [](const PoseMask& mask) { return mask.sum(); };
  for (size_t i = 0; i < problem.frame_masks.size(); ++i) {
    const double free = num_free(problem.frame_masks[i]);
    if (free == 0.0) result->fixed_frame_idx = built.frame_idxs[i];
    result->scale_is_fixed |= free == 5.0;
  }
  for (const PoseMask& mask : problem.sensor_masks) {
    result->scale_is_fixed |= num_free(mask) == 5.0;
  }
}

void ScatterScaled(const std::vector<std::optional<PoseMatrix>>& from,
                   const std::vector<int>& idxs, double factor, size_t size,
                   std::vector<std::optional<PoseMatrix>>* to) {
  to->resize(size);
  for (size_t i = 0; i < from.size(); ++i) {
    if (from[i]) (*to)[idxs[i]] = factor * *from[i];
  }
}

void AddUnobservable(const std::vector<std::optional<PoseMatrix>>& poses,
                     bool are_sensors, double max_sigma_length,
                     std::vector<UnobservableDirection>* directions) {
  for (size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i]) continue;
    for (const bool is_rotation : {true, false}) {
      const int first = is_rotation ? 0 : 3;
      const double most = is_rotation ? kMaxSigmaRad : max_sigma_length;
      const SymmetricEigen<Eigen::Matrix3d> eigen(
          poses[i]->block<3, 3>(first, first));
      for (int k = 0; k < 3; ++k) {
        if (!(eigen.values[k] > most * most)) continue;
        directions->push_back(
            {are_sensors, static_cast<int>(i), is_rotation, eigen.V.col(k)});
      }
    }
  }
}

// The variance of a free parameter, from its variance for independent residuals
// and the factor by which residuals depend on each other. The prior counts as
// exact.
double WithDependence(const BundleProblem& problem, int camera, int param,
                      double variance, double factor) {
  double of_prior = 0.0;
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    if (prior.camera != camera || prior.param != param) continue;
    of_prior = 1.0 / (prior.sigma * prior.sigma);
  }
  const double of_residuals = std::max(0.0, 1.0 / variance - of_prior);
  const double information = of_prior + of_residuals / factor;
  return information > 0.0 ? 1.0 / information : variance;
}

}  // namespace

void ListUnobservable(const Scene& scene, const Reconstruction& reconstruction,
                      const Context& context, CovarianceResult* covariances) {
  const double max_sigma_length =
      std::tan(kMaxSigmaRad) *
      MedianDistance(scene, reconstruction, context.num_threads);
  covariances->unobservable.clear();
  AddUnobservable(covariances->sensors, true, max_sigma_length,
                  &covariances->unobservable);
  AddUnobservable(covariances->frames, false, max_sigma_length,
                  &covariances->unobservable);
}

CovarianceResult ComputeCovariances(const Scene& scene,
                                    const Reconstruction& reconstruction,
                                    const BundleAdjustmentOptions& options,
                                    const Context& context,
                                    const BundlePriors& priors) {
  CovarianceResult result;
  result.sigma_px = NoiseSigmaPx(scene, reconstruction, context.num_threads);
  const double sigma_px = std::max(result.sigma_px, kMinKeypointSigmaPx);
  const BuiltProblem built =
      BuildWeighted(scene, reconstruction, options, sigma_px, priors);
  DescribeGauge(built, &result);
  const std::optional<PoseCovariances> covariances =
      ComputePoseCovariances(built.problem, built.state, context);
  if (!covariances) return result;
  result.is_usable = true;
  const double factor = sigma_px * sigma_px;
  ScatterScaled(covariances->frames, built.frame_idxs, factor,
                scene.frames.size(), &result.frames);
  ScatterScaled(covariances->sensors, built.sensor_idxs, factor,
                scene.sensors.size(), &result.sensors);
  ListUnobservable(scene, reconstruction, context, &result);
  return result;
}

std::optional<std::vector<std::vector<double>>> ComputeIntrinsicSigmas(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors) {
  auto sigmas = ComputeAllIntrinsicSigmas(scene, reconstruction, options,
                                          context, priors);
  if (!sigmas) return std::nullopt;
  return std::move(sigmas->of_residuals);
}

std::optional<IntrinsicSigmas> ComputeAllIntrinsicSigmas(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors) {
  const double sigma_px =
      KeypointSigmaPx(scene, reconstruction, context.num_threads);
  const BuiltProblem built =
      BuildWeighted(scene, reconstruction, options, sigma_px, priors);
  const auto variances =
      ComputeParameterVariances(built.problem, built.state, context);
  if (!variances) return std::nullopt;
  const std::vector<Overdispersion> factors = OverdispersionOfCameras(
      scene, reconstruction, LossScalePx(options, sigma_px));
  IntrinsicSigmas sigmas;
  sigmas.of_residuals.resize(scene.cameras.size());
  for (const int camera_idx : built.camera_idxs) {
    sigmas.of_residuals[camera_idx].resize(
        scene.cameras[camera_idx].params.size(), 0.0);
  }
  sigmas.total = sigmas.of_residuals;
  for (size_t i = 0; i < built.camera_idxs.size(); ++i) {
    const int camera_idx = built.camera_idxs[i];
    const Overdispersion& factor = factors[camera_idx];
    const std::vector<int>& free = built.problem.cameras[i].free_params;
    for (size_t k = 0; k < (*variances)[i].size(); ++k) {
      const double variance = (*variances)[i][k];
      if (!(variance > 0.0)) continue;
      const auto sigma = [&](double of_residuals) {
        return sigma_px *
               std::sqrt(WithDependence(built.problem, static_cast<int>(i),
                                        free[k], variance, of_residuals));
      };
      sigmas.of_residuals[camera_idx][free[k]] = sigma(factor.of_residuals);
      sigmas.total[camera_idx][free[k]] =
          sigma(factor.of_residuals + factor.of_lens);
    }
  }
  return sigmas;
}

}  // namespace mgsfm
