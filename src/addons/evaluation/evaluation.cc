// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/evaluation/evaluation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

// Segments have 100, 200, ..., 800 m, as in the evaluation of KITTI odometry.
constexpr double kUnitLength_m = 100.0;

// There must be an error.
ErrorStatistics SummarizeErrors(const std::vector<double>& errors) {
  const auto count = static_cast<double>(errors.size());
  const double sum = std::accumulate(errors.begin(), errors.end(), 0.0);
  const double square =
      std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0);
  return {sum / count, Median(errors),
          *std::max_element(errors.begin(), errors.end()),
          std::sqrt(square / count)};
}

std::vector<const ImagePoses*> ReferenceImages(
    const std::vector<ImagePoses>& images) {
  std::vector<const ImagePoses*> references;
  for (const ImagePoses& image : images) {
    if (image.is_reference) references.push_back(&image);
  }
  return references;
}

// The error of the relative pose of two images: identity if it is right.
// nullopt unless both are registered.
std::optional<Rigid3> RelativeError(const ImagePoses& from,
                                    const ImagePoses& to, double scale) {
  if (!from.cam_from_model || !to.cam_from_model) return std::nullopt;
  Rigid3 estimate = *from.cam_from_model * to.cam_from_model->Inverse();
  estimate.translation *= scale;
  const Rigid3 truth = from.cam_from_world * to.cam_from_world.Inverse();
  return estimate.Inverse() * truth;
}

double RotationDeg(const Rigid3& error) {
  return RadToDeg(AngleBetween(error.rotation, Eigen::Quaterniond::Identity()));
}

// The length of the true path up to each of the reference images.
std::vector<double> PathLengths(
    const std::vector<const ImagePoses*>& references) {
  std::vector<double> lengths_m(references.size(), 0.0);
  for (size_t i = 1; i < references.size(); ++i) {
    lengths_m[i] =
        lengths_m[i - 1] + (references[i]->cam_from_world.Center() -
                            references[i - 1]->cam_from_world.Center())
                               .norm();
  }
  return lengths_m;
}

// Both compare the relative poses of reference images, in their order, after
// the lengths of the model are multiplied by `scale`. nullopt if there is none
// to compare.
std::optional<SegmentErrors> EvaluateSegments(
    const std::vector<const ImagePoses*>& references,
    const std::vector<double>& distance_m, double scale) {
  constexpr int kStep = 10;  // images between the starts of segments
  constexpr int kNumLengths = 8;
  SegmentErrors sum;
  for (size_t first = 0; first < references.size(); first += kStep) {
    size_t last = first;
    for (int k = 1; k <= kNumLengths; ++k) {
      const double length_m = k * kUnitLength_m;
      while (last < references.size() &&
             distance_m[last] <= distance_m[first] + length_m) {
        ++last;
      }
      if (last == references.size()) break;
      const auto error =
          RelativeError(*references[first], *references[last], scale);
      if (!error) continue;
      ++sum.num_segments;
      sum.translation_percent += 100.0 * error->translation.norm() / length_m;
      sum.rotation_deg_per_100m +=
          kUnitLength_m * RotationDeg(*error) / length_m;
    }
  }
  if (sum.num_segments == 0) return std::nullopt;
  sum.translation_percent /= sum.num_segments;
  sum.rotation_deg_per_100m /= sum.num_segments;
  return sum;
}

std::optional<StepErrors> EvaluateSteps(
    const std::vector<const ImagePoses*>& references, double scale) {
  std::vector<double> rotation_deg, translation_m;
  for (size_t i = 1; i < references.size(); ++i) {
    const auto error = RelativeError(*references[i - 1], *references[i], scale);
    if (!error) continue;
    rotation_deg.push_back(RotationDeg(*error));
    translation_m.push_back(error->translation.norm());
  }
  if (rotation_deg.empty()) return std::nullopt;
  return StepErrors{static_cast<int>(rotation_deg.size()),
                    SummarizeErrors(rotation_deg),
                    SummarizeErrors(translation_m)};
}

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

// Quadratic in the number of reference images, at most a few thousand.
double Extent(const std::vector<const ImagePoses*>& references) {
  std::vector<Eigen::Vector3d> centers;
  for (const ImagePoses* image : references) {
    if (image->cam_from_model) {
      centers.push_back(image->cam_from_model->Center());
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

Evaluation Evaluate(const std::vector<ImagePoses>& images, bool has_true_poses,
                    const std::vector<SensorPoses>& sensors,
                    const EvaluationOptions& options) {
  Evaluation evaluation;
  evaluation.is_metric = options.is_metric;
  evaluation.num_images = static_cast<int>(images.size());
  evaluation.num_registered =
      static_cast<int>(CountIf(images, [](const ImagePoses& image) {
        return image.cam_from_model.has_value();
      }));
  const std::vector<const ImagePoses*> references = ReferenceImages(images);
  if (has_true_poses) {
    EvaluateImages(images, options, &evaluation);
    const std::vector<double> lengths_m = PathLengths(references);
    evaluation.path_m = lengths_m.empty() ? 0.0 : lengths_m.back();
    if (evaluation.world_from_model) {
      const double scale = evaluation.world_from_model->scale;
      evaluation.segments = EvaluateSegments(references, lengths_m, scale);
      evaluation.steps = EvaluateSteps(references, scale);
    }
  } else {
    evaluation.world_from_model = AlignSensors(sensors);
  }
  if (!evaluation.world_from_model) return evaluation;
  const double scale = evaluation.world_from_model->scale;
  evaluation.sensors = EvaluateSensors(sensors, scale);
  evaluation.extent_m = scale * Extent(references);
  return evaluation;
}

}  // namespace mgsfm
