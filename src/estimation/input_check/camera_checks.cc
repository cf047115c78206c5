// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/camera_checks.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/format.h"
#include "base/ranges.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {
namespace {

// Half and twice these values, or their distances from the size and the center
// of the image, change no verdict (docs/results/constants.md).
//
// Fewer keypoints do not reveal the size of an image.
constexpr size_t kMinNumKeypoints = 50;
// A few keypoints may be far outside, for example with a broken detector.
constexpr double kQuantile = 0.99;
// The extent of keypoints beyond the camera size on both sides, relative to it.
constexpr double kMaxExtent = 1.02;
// The least difference to the camera size, relative to it, of the longer side:
// width and height can be exchanged, or the images are smaller.
constexpr double kMinDifference = 0.2;
// Single images can have features in only one corner.
constexpr size_t kMinNumImages = 3;
constexpr double kMinShareOfImages = 0.2;

// Quantiles of the keypoints, as fractions of the camera size.
struct Extent {
  double x = 0.0;
  double y = 0.0;
  double min_x = 0.0;
  double min_y = 0.0;

  bool IsTooLarge() const {
    return std::min(x, y) > kMaxExtent || std::max(x, y) > 1.0 + kMinDifference;
  }
  // Keypoints of smaller images end at the same fraction of width and height,
  // and surround the center of the smaller image. Masks and skies cut off
  // features at one side only, and features of a fisheye surround its principal
  // point.
  bool IsTooSmall() const {
    return std::max(x, y) < 1.0 - kMinDifference &&
           std::abs(x - y) < kMinDifference &&
           std::max(min_x + x, min_y + y) < 1.0 - kMinDifference;
  }
};

Extent ExtentOf(const Camera& camera, const Image& image) {
  std::vector<double> x, y;
  for (const Eigen::Vector2f& keypoint : image.keypoints_px) {
    x.push_back(keypoint.x() / camera.width_px);
    y.push_back(keypoint.y() / camera.height_px);
  }
  return {Quantile(x, kQuantile), Quantile(y, kQuantile),
          Quantile(x, 1.0 - kQuantile), Quantile(y, 1.0 - kQuantile)};
}

Finding Describe(const Scene& scene, int sensor_idx,
                 const std::vector<std::pair<int, Extent>>& images) {
  std::vector<double> x, y;
  for (const auto& [image_idx, extent] : images) {
    x.push_back(extent.x);
    y.push_back(extent.y);
  }
  const Extent typical{Median(std::move(x)), Median(std::move(y)), 0.0, 0.0};
  const Sensor& sensor = scene.sensors[sensor_idx];
  const Camera& camera = scene.cameras[sensor.camera_idx];
  // Names may be long, so only the numbers are formatted.
  const std::string numbers =
      Formatted("%d x %d pixels: their keypoints reach %.0f x %.0f",
                camera.width_px, camera.height_px, typical.x * camera.width_px,
                typical.y * camera.height_px);
  const std::string text = std::to_string(images.size()) +
                           " images of camera '" + sensor.name +
                           "' do not have its size of " + numbers;
  return {Cause::kWrongImageSize,
          {sensor.name},
          {scene.frames[scene.images[images.front().first].frame_idx].name,
           scene.frames[scene.images[images.back().first].frame_idx].name},
          {{"num_images", static_cast<double>(images.size())},
           {"extent_x", typical.x},
           {"extent_y", typical.y}},
          text,
          "extract the features of these images with a camera of their size"};
}

}  // namespace

std::vector<Finding> CheckImageSizes(const Scene& scene) {
  std::vector<std::vector<std::pair<int, Extent>>> wrong(scene.sensors.size());
  std::vector<int> num_images(scene.sensors.size(), 0);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    ++num_images[image.sensor_idx];
    const Camera& camera = scene.cameras[image.camera_idx];
    if (image.keypoints_px.size() < kMinNumKeypoints || camera.width_px <= 0 ||
        camera.height_px <= 0) {
      continue;
    }
    const Extent extent = ExtentOf(camera, image);
    if (extent.IsTooLarge() || extent.IsTooSmall()) {
      wrong[image.sensor_idx].push_back({static_cast<int>(i), extent});
    }
  }
  std::vector<Finding> findings;
  for (size_t k = 0; k < wrong.size(); ++k) {
    if (wrong[k].size() < kMinNumImages ||
        static_cast<double>(wrong[k].size()) <
            kMinShareOfImages * num_images[k]) {
      continue;
    }
    findings.push_back(Describe(scene, static_cast<int>(k), wrong[k]));
  }
  return findings;
}

namespace {

// The pairs of a first test; a calibration follows if they contradict a prior.
constexpr int kFewPairs = 40;
// The relative error that all pairs share. It reaches 6 % on correct recordings
// (docs/results/input_check.md).
constexpr double kSharedSigmaOfPairs = 0.036;

double SigmaOf(const FocalLengthMeasurement& m) {
  return std::hypot(m.sigma, kSharedSigmaOfPairs);
}

double FocalLengthPx(const Camera& camera) {
  return camera.params[InfoOf(camera.model).focal_length_idxs.front()];
}

bool IsWrong(const Scene& scene, const FocalLengthMeasurement& m) {
  const double error = std::abs(m.log_factor);
  return scene.cameras[m.camera_idx].has_prior_focal_length &&
         error < kMaxLogFocalFactor && error > kRareErrorInSigmas * SigmaOf(m);
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
