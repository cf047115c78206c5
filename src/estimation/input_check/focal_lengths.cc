// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/focal_lengths.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/format.h"
#include "math/robust_scale.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {
namespace {

// First a few pairs; as many as a calibration uses if they raise a suspicion.
constexpr int kFewPairs = 40;
constexpr int kManyPairs = 300;
// Normal errors exceed it in a third of the cases, which costs only the second
// check.
constexpr double kSuspiciousErrorInSigmas = 1.0;
// Healthy cameras: see docs/results/input_check.md. With twice the logarithm,
// an error of 30 % is not noticed (docs/results/constants.md).
const double kMinLogFactor = std::log(1.15);
// Sound cameras reach 1.0, and wrong ones have at least 2.3
// (docs/results/input_check.md).
constexpr double kMinErrorInSigmas = 2.0;
// Share of kMinLogFactor by which a model confirms a doubt. Its points and
// outliers were selected with the known focal lengths, so that it moves them
// too little: by 12 instead of 43 % on KITTI 06.
constexpr double kConfirmingShare = 0.5;
// Farther from the known value the linearization is not valid, and the motion
// does not determine a focal length.
const double kMaxLogFactor = std::log(2.5);
// Half or twice the value changes no verdict (docs/results/constants.md).
constexpr double kMaxSigma = 0.2;

bool IsWrong(const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return error > kMinLogFactor && error < kMaxLogFactor &&
         m.sigma < kMaxSigma && error > kMinErrorInSigmas * m.sigma;
}

bool IsSuspicious(const Scene& scene, const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return scene.cameras[m.camera_idx].has_prior_focal_length &&
         error > kMinLogFactor && error > kSuspiciousErrorInSigmas * m.sigma;
}

Finding Describe(const Scene& scene, const FocalLengthMeasurement& m) {
  const Camera& camera = scene.cameras[m.camera_idx];
  const double prior_px =
      camera.params[FindCameraModel(static_cast<int32_t>(camera.model))
                        ->focal_length_idxs.front()];
  const double measured_px = prior_px * std::exp(m.log_factor);
  const std::vector<std::string> sensors = SensorsOfCamera(scene, m.camera_idx);
  // Names may be long, so only the numbers are formatted.
  const std::string numbers = Formatted(
      "%.0f px, contradicts the image pairs, which suggest "
      "%.0f +- %.0f px",
      prior_px, measured_px, measured_px * m.sigma);
  const std::string text = "the focal length of camera '" +
                           (sensors.empty() ? "" : sensors.front()) + "', " +
                           numbers;
  return {Cause::kWrongFocalLength,
          sensors,
          {},
          {{"prior_px", prior_px},
           {"measured_px", measured_px},
           {"relative_sigma", m.sigma},
           {"num_pairs", static_cast<double>(m.num_pairs)}},
          text,
          "correct it, or mark it as not known (prior_focal_length 0), so that "
          "it is estimated"};
}

// Whether the estimate of a model, as a logarithm of its ratio to the known
// focal length, exceeds half of the bound in the direction of the doubt.
bool ContradictsFocalLength(const Finding& doubt, double log_factor) {
  const double prior_px = doubt.evidence[0].second;
  const double measured_px = doubt.evidence[1].second;
  return std::abs(log_factor) > kConfirmingShare * kMinLogFactor &&
         (log_factor > 0.0) == (measured_px > prior_px);
}

bool Concerns(const Scene& scene, const Finding& doubt, int camera_idx) {
  const std::vector<std::string> names = SensorsOfCamera(scene, camera_idx);
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
    return std::count(doubt.cameras.begin(), doubt.cameras.end(), name) > 0;
  });
}

// Per camera: whether points of the model observe it.
Mask FindObserved(const Scene& scene, const Reconstruction& model) {
  Mask is_observed(scene.cameras.size(), false);
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      is_observed[scene.images[o.image_idx].camera_idx] = true;
    }
  }
  return is_observed;
}

// The focal lengths in doubt, released and adjusted with the model.
std::vector<FocalLengthCheck> Release(const Scene& scene,
                                      const Reconstruction& model,
                                      const std::vector<Finding>& doubts,
                                      BundleAdjustmentOptions options,
                                      const Context& context) {
  // Weak, because the known value is in doubt.
  options.focal_length_start_sigma = 1.0;
  options.refine_focal_length = RefineMode::kAuto;
  options.refine_extra_params = RefineMode::kNo;
  Scene released = scene;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const bool is_doubtful =
        std::any_of(doubts.begin(), doubts.end(), [&](const Finding& doubt) {
          return Concerns(scene, doubt, static_cast<int>(i));
        });
    released.cameras[i].has_prior_focal_length = !is_doubtful;
  }
  return CheckFocalLengths(
      released, AdjustBundle(released, model, options, context).estimate,
      options, context);
}

}  // namespace

std::vector<std::string> SensorsOfCamera(const Scene& scene, int camera_idx) {
  std::vector<std::string> names;
  for (const Sensor& sensor : scene.sensors) {
    if (sensor.camera_idx == camera_idx) names.push_back(sensor.name);
  }
  return names;
}

std::vector<Finding> CheckTrustedFocalLengths(const Scene& scene,
                                              const ViewGraph& view_graph,
                                              const Context& context) {
  std::vector<Finding> findings;
  const bool has_prior =
      std::any_of(scene.cameras.begin(), scene.cameras.end(),
                  [](const Camera& c) { return c.has_prior_focal_length; });
  if (!has_prior) return findings;
  const auto few = MeasureFocalLengths(scene, view_graph, kFewPairs, context);
  if (std::none_of(few.begin(), few.end(),
                   [&](const auto& m) { return IsSuspicious(scene, m); })) {
    return findings;
  }
  for (const FocalLengthMeasurement& m :
       MeasureFocalLengths(scene, view_graph, kManyPairs, context)) {
    if (scene.cameras[m.camera_idx].has_prior_focal_length && IsWrong(m)) {
      findings.push_back(Describe(scene, m));
    }
  }
  return findings;
}

std::vector<Finding> ConfirmedFocalLengthDoubts(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    std::vector<Finding> doubts) {
  if (doubts.empty()) return doubts;
  const Mask is_observed = FindObserved(scene, model);
  const std::vector<FocalLengthCheck> checks =
      Release(scene, model, doubts, options, context);
  const auto is_refuted = [&](const Finding& doubt) {
    return std::any_of(
        checks.begin(), checks.end(), [&](const FocalLengthCheck& check) {
          if (!is_observed[check.camera_idx] ||
              !Concerns(scene, doubt, check.camera_idx)) {
            return false;
          }
          const double change = std::log(check.estimated_px / check.prior_px);
          // On a straight road, the adjustment moves a focal length anywhere,
          // with a large standard deviation.
          return !check.relative_sigma ||
                 std::abs(change) <
                     kRareErrorInSigmas * *check.relative_sigma ||
                 !ContradictsFocalLength(doubt, change);
        });
  };
  doubts.erase(std::remove_if(doubts.begin(), doubts.end(), is_refuted),
               doubts.end());
  return doubts;
}

}  // namespace mgsfm
