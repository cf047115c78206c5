// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/focal_lengths.h"

#include <cmath>

#include "base/format.h"
#include "base/ranges.h"
#include "math/robust_scale.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {
namespace {

// The pairs of a first test; a calibration follows if they contradict a prior.
constexpr int kFewPairs = 40;
// The relative error that all pairs share. It reaches 6 % on correct recordings
// (docs/results/input_check.md).
constexpr double kSharedSigmaOfPairs = 0.036;
// Farther from the known value, the linearization is invalid, and the motion
// does not determine a focal length.
const double kMaxLogFactor = std::log(2.5);

double SigmaOf(const FocalLengthMeasurement& m) {
  return std::hypot(m.sigma, kSharedSigmaOfPairs);
}

double FocalLengthPx(const Camera& camera) {
  return camera.params[InfoOf(camera.model).focal_length_idxs.front()];
}

bool IsWrong(const Scene& scene, const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return scene.cameras[m.camera_idx].has_prior_focal_length &&
         error < kMaxLogFactor && error > kRareErrorInSigmas * SigmaOf(m);
}

Finding Describe(const Scene& scene, const FocalLengthMeasurement& m) {
  const Camera& camera = scene.cameras[m.camera_idx];
  const double prior_px = FocalLengthPx(camera);
  const double measured_px = prior_px * std::exp(m.log_factor);
  const std::vector<std::string> sensors = SensorsOfCamera(scene, m.camera_idx);
  // Names may be long, so only the numbers are formatted.
  const std::string numbers = Formatted(
      "%.0f px, contradicts the image pairs, which suggest "
      "%.0f +- %.0f px",
      prior_px, measured_px, measured_px * SigmaOf(m));
  const std::string text = "the focal length of camera '" +
                           (sensors.empty() ? "" : sensors.front()) + "', " +
                           numbers;
  return {Cause::kWrongFocalLength,
          sensors,
          {},
          {{"prior_px", prior_px},
           {"measured_px", measured_px},
           {"relative_sigma", SigmaOf(m)},
           {"num_pairs", static_cast<double>(m.num_pairs)}},
          text,
          "correct it, or mark it as unknown (prior_focal_length 0), so that "
          "it is estimated"};
}

// Calibrates the cameras of wrong focal lengths: a linearization at these
// values would be biased toward them.
std::vector<FocalLengthMeasurement> CalibrateWrong(
    Scene scene, const ViewGraph& view_graph,
    const std::vector<FocalLengthMeasurement>& measured,
    const Context& context) {
  for (const FocalLengthMeasurement& m : measured) {
    if (IsWrong(scene, m)) {
      scene.cameras[m.camera_idx].has_prior_focal_length = false;
    }
  }
  const FocalLengthResult calibrated =
      CalibrateFocalLengths(scene, view_graph, {}, context);
  std::vector<FocalLengthMeasurement> result;
  for (const FocalLengthEstimate& estimate : calibrated.estimates) {
    if (!estimate.sigma) continue;
    const int idx = estimate.camera_idx;
    result.push_back({idx,
                      std::log(FocalLengthPx(calibrated.cameras[idx]) /
                               FocalLengthPx(scene.cameras[idx])),
                      *estimate.sigma, estimate.num_pairs});
  }
  return result;
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
  const bool has_prior = AnyOf(
      scene.cameras, [](const Camera& c) { return c.has_prior_focal_length; });
  if (!has_prior) return findings;
  const auto few = MeasureFocalLengths(scene, view_graph, kFewPairs, context);
  if (NoneOf(few, [&](const auto& m) { return IsWrong(scene, m); })) {
    return findings;
  }
  for (const FocalLengthMeasurement& m :
       CalibrateWrong(scene, view_graph, few, context)) {
    if (IsWrong(scene, m)) findings.push_back(Describe(scene, m));
  }
  return findings;
}

}  // namespace mgsfm
