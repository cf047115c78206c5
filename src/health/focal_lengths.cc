// SPDX-License-Identifier: BSD-3-Clause
#include "health/focal_lengths.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {
namespace {

// A seventh of the pairs of a calibration.
constexpr int kMaxNumPairs = 40;
// Healthy cameras: see docs/results/input_check.md.
const double kMinLogFactor = std::log(1.15);
constexpr double kMinErrorInSigmas = 2.5;
// Farther from the given value the linearisation is not valid, and the motion
// does not determine a focal length.
const double kMaxLogFactor = std::log(2.5);
constexpr double kMaxSigma = 0.2;

bool IsWrong(const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return error > kMinLogFactor && error < kMaxLogFactor &&
         m.sigma < kMaxSigma && error > kMinErrorInSigmas * m.sigma;
}

Finding Describe(const Scene& scene, const FocalLengthMeasurement& m) {
  const Camera& camera = scene.cameras[m.camera_idx];
  const double prior_px =
      camera.params[FindCameraModel(static_cast<int32_t>(camera.model))
                        ->focal_length_idxs.front()];
  const double measured_px = prior_px * std::exp(m.log_factor);
  const std::vector<std::string> sensors = SensorsOfCamera(scene, m.camera_idx);
  // Names may be long, so only the numbers are formatted.
  char numbers[160];
  std::snprintf(numbers, sizeof(numbers),
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
  for (const FocalLengthMeasurement& m :
       MeasureFocalLengths(scene, view_graph, kMaxNumPairs, context)) {
    if (scene.cameras[m.camera_idx].has_prior_focal_length && IsWrong(m)) {
      findings.push_back(Describe(scene, m));
    }
  }
  return findings;
}

}  // namespace mgsfm
