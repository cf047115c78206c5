// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/evaluation/evaluation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "evaluation/error_statistics.h"
#include "evaluation/relative_errors.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

std::vector<AreaUnderCurve> ComputeAuc(const std::vector<double>& errors,
                                       int num_images,
                                       const std::vector<double>& thresholds) {
  std::vector<AreaUnderCurve> areas;
  for (const double threshold : thresholds) {
    double area = 0.0;
    for (const double error : errors) {
      area += std::max(0.0, 1.0 - error / threshold);
    }
    areas.push_back({threshold, area / num_images});
  }
  return areas;
}

void EvaluateImages(const std::vector<ImagePoses>& images,
                    const EvaluationOptions& options, Evaluation* evaluation) {
  evaluation->world_from_model = AlignPoses(images, options.alignment);
  if (!evaluation->world_from_model) return;
  std::vector<double> rotation_deg, position_m;
  for (const ImagePoses& image : images) {
    if (!image.cam_from_model) continue;
    const Rigid3 cam_from_world =
        TransformWorld(*evaluation->world_from_model, *image.cam_from_model);
    rotation_deg.push_back(RadToDeg(
        AngleBetween(cam_from_world.rotation, image.cam_from_world.rotation)));
    position_m.push_back(
        (cam_from_world.Center() - image.cam_from_world.Center()).norm());
  }
  evaluation->rotation_deg = SummarizeErrors(rotation_deg);
  evaluation->position_m = SummarizeErrors(position_m);
  evaluation->rotation_auc = ComputeAuc(rotation_deg, evaluation->num_images,
                                        options.rotation_thresholds_deg);
  evaluation->position_auc = ComputeAuc(position_m, evaluation->num_images,
                                        options.position_thresholds_m);
}

// The least-squares scale of the distances between sensors and their reference.
std::optional<Sim3> AlignSensors(const std::vector<SensorPoses>& sensors) {
  double product = 0.0, square = 0.0;
  for (const SensorPoses& sensor : sensors) {
    if (!sensor.sensor_from_ref || !sensor.true_sensor_from_ref) continue;
    const double length = sensor.sensor_from_ref->translation.norm();
    product += length * sensor.true_sensor_from_ref->translation.norm();
    square += length * length;
  }
  if (!(product > 0.0)) return std::nullopt;
  Sim3 world_from_model;
  world_from_model.scale = product / square;
  return world_from_model;
}

std::vector<SensorErrors> EvaluateSensors(
    const std::vector<SensorPoses>& sensors, double scale) {
  // Shorter translations (meters) have no direction.
  constexpr double kNoLength = 1e-9;
  std::vector<SensorErrors> all_errors;
  for (const SensorPoses& sensor : sensors) {
    if (!sensor.sensor_from_ref || !sensor.true_sensor_from_ref) continue;
    const Rigid3& estimate = *sensor.sensor_from_ref;
    const Rigid3& truth = *sensor.true_sensor_from_ref;
    SensorErrors errors;
    errors.name = sensor.name;
    errors.rotation_deg =
        RadToDeg(AngleBetween(estimate.rotation, truth.rotation));
    errors.length_m = scale * estimate.translation.norm();
    errors.true_length_m = truth.translation.norm();
    if (errors.length_m > kNoLength && errors.true_length_m > kNoLength) {
      errors.direction_deg =
          RadToDeg(AngleBetween(estimate.translation, truth.translation));
    }
    all_errors.push_back(errors);
  }
  return all_errors;
}

double PathLength(const std::vector<ImagePoses>& images) {
  double length = 0.0;
  const ImagePoses* last = nullptr;
  for (const ImagePoses& image : images) {
    if (!image.is_reference) continue;
    if (last != nullptr) {
      length += (image.cam_from_world.Center() - last->cam_from_world.Center())
                    .norm();
    }
    last = &image;
  }
  return length;
}

// Quadratic in the number of reference images, at most a few thousand.
double Extent(const std::vector<ImagePoses>& images) {
  std::vector<Eigen::Vector3d> centers;
  for (const ImagePoses& image : images) {
    if (image.is_reference && image.cam_from_model) {
      centers.push_back(image.cam_from_model->Center());
    }
  }
  double extent = 0.0;
  for (size_t i = 0; i < centers.size(); ++i) {
    for (size_t j = i + 1; j < centers.size(); ++j) {
      extent = std::max(extent, (centers[i] - centers[j]).norm());
    }
  }
  return extent;
}

}  // namespace

ErrorStatistics SummarizeErrors(const std::vector<double>& errors) {
  const auto count = static_cast<double>(errors.size());
  const double sum = std::accumulate(errors.begin(), errors.end(), 0.0);
  const double square =
      std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0);
  return {sum / count, Median(errors),
          *std::max_element(errors.begin(), errors.end()),
          std::sqrt(square / count)};
}

Evaluation Evaluate(const std::vector<ImagePoses>& images, bool has_true_poses,
                    const std::vector<SensorPoses>& sensors,
                    const EvaluationOptions& options) {
  Evaluation evaluation;
  evaluation.is_metric = options.is_metric;
  evaluation.num_images = static_cast<int>(images.size());
  evaluation.num_registered = static_cast<int>(
      std::count_if(images.begin(), images.end(), [](const ImagePoses& image) {
        return image.cam_from_model.has_value();
      }));
  if (has_true_poses) {
    EvaluateImages(images, options, &evaluation);
    evaluation.path_m = PathLength(images);
    if (evaluation.world_from_model) {
      const double scale = evaluation.world_from_model->scale;
      evaluation.segments = EvaluateSegments(images, scale);
      evaluation.steps = EvaluateSteps(images, scale);
    }
  } else {
    evaluation.world_from_model = AlignSensors(sensors);
  }
  if (!evaluation.world_from_model) return evaluation;
  const double scale = evaluation.world_from_model->scale;
  evaluation.sensors = EvaluateSensors(sensors, scale);
  evaluation.extent_m = scale * Extent(images);
  return evaluation;
}

}  // namespace mgsfm
