// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/focal_lengths.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "math/robust_scale.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {
namespace {

// A few pairs first; as many as a calibration uses if these contradict the
// prior.
constexpr int kFewPairs = 40;
constexpr int kManyPairs = 300;
// The relative error that all pairs share. It reaches 6 % on correct recordings
// (docs/results/input_check.md).
constexpr double kSharedSigmaOfPairs = 0.036;
// Farther from the known value, the linearization is invalid, and the motion
// does not determine a focal length.
const double kMaxLogFactor = std::log(2.5);

double SigmaOf(const FocalLengthMeasurement& m) {
  return std::hypot(m.sigma, kSharedSigmaOfPairs);
}

bool IsWrong(const Scene& scene, const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return scene.cameras[m.camera_idx].has_prior_focal_length &&
         error < kMaxLogFactor && error > kRareErrorInSigmas * SigmaOf(m);
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
                   [&](const auto& m) { return IsWrong(scene, m); })) {
    return findings;
  }
  for (const FocalLengthMeasurement& m :
       MeasureFocalLengths(scene, view_graph, kManyPairs, context)) {
    if (IsWrong(scene, m)) findings.push_back(Describe(scene, m));
  }
  return findings;
}

}  // namespace mgsfm
