// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/relative_errors.h"

#include "evaluation/error_statistics.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Segments have 100, 200, ..., 800 m, as in the evaluation of KITTI odometry.
constexpr double kUnitLength_m = 100.0;

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

}  // namespace

std::optional<SegmentErrors> EvaluateSegments(
    const std::vector<ImagePoses>& images, double scale) {
  constexpr int kStep = 10;  // images between the starts of segments
  constexpr int kNumLengths = 8;
  const std::vector<const ImagePoses*> references = ReferenceImages(images);
  std::vector<double> distance_m(references.size(), 0.0);
  for (size_t i = 1; i < references.size(); ++i) {
    distance_m[i] =
        distance_m[i - 1] + (references[i]->cam_from_world.Center() -
                             references[i - 1]->cam_from_world.Center())
                                .norm();
  }
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

std::optional<StepErrors> EvaluateSteps(const std::vector<ImagePoses>& images,
                                        double scale) {
  const std::vector<const ImagePoses*> references = ReferenceImages(images);
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

}  // namespace mgsfm
