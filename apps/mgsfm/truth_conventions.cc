// SPDX-License-Identifier: BSD-3-Clause
#include "truth_conventions.h"

#include <vector>

#include "base/text.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// The rotation cam_from_world if the file is meant differently. Trajectories
// have poses world_from_cam, quaternions x y z w; models the opposite of both.
Quaterniond Reread(const Quaterniond& cam_from_world, bool is_trajectory,
                   bool is_reordered, bool is_inverse) {
  Quaterniond in_file =
      is_trajectory ? cam_from_world.conjugate() : cam_from_world;
  if (is_reordered && is_trajectory) {
    in_file = Quaterniond(in_file.x(), in_file.y(), in_file.z(), in_file.w());
  } else if (is_reordered) {
    in_file = FromOrderXyzw(in_file);
  }
  return is_trajectory != is_inverse ? in_file.conjugate() : in_file;
}

// Median difference of the rotations between consecutive images.
double MedianDifference(const std::vector<const ImagePoses*>& images,
                        bool is_trajectory, bool is_reordered,
                        bool is_inverse) {
  std::vector<double> differences_rad;
  for (size_t i = 1; i < images.size(); ++i) {
    const auto relative = [](const Quaterniond& a, const Quaterniond& b) {
      return Quaterniond(b * a.conjugate());
    };
    const auto truth = [&](const ImagePoses& image) {
      return Reread(image.cam_from_world.rotation, is_trajectory, is_reordered,
                    is_inverse);
    };
    differences_rad.push_back(
        AngleBetween(relative(images[i - 1]->cam_from_model->rotation,
                              images[i]->cam_from_model->rotation),
                     relative(truth(*images[i - 1]), truth(*images[i]))));
  }
  return Median(std::move(differences_rad));
}

}  // namespace

std::optional<std::string> FindOtherConvention(
    const TruthComparison& comparison, TruthFormat format) {
  constexpr size_t kMinNumImages = 10;
  // Errors of a sound model shrink by no other convention.
  constexpr double kMaxRatio = 0.2;
  const bool is_trajectory = format == TruthFormat::kTum;
  if (!is_trajectory && format != TruthFormat::kColmap) return std::nullopt;
  std::vector<const ImagePoses*> images;
  for (const ImagePoses& image : comparison.images) {
    if (image.is_reference && image.cam_from_model) images.push_back(&image);
  }
  if (images.size() < kMinNumImages) return std::nullopt;
  const double difference_rad =
      MedianDifference(images, is_trajectory, false, false);
  for (const auto& [is_reordered, is_inverse] :
       {std::pair(true, false), std::pair(false, true),
        std::pair(true, true)}) {
    const double other_rad =
        MedianDifference(images, is_trajectory, is_reordered, is_inverse);
    if (!(other_rad < kMaxRatio * difference_rad)) continue;
    const auto degrees = [](double rad) {
      return FormatDouble(RadToDeg(rad), std::chars_format::general, 3);
    };
    return "the true rotations from image to image differ from those of the "
           "model by " +
           degrees(difference_rad) + " deg in the median, but by " +
           degrees(other_rad) + " deg if the file has " +
           (is_inverse ? is_trajectory ? "poses cam_from_world"
                                       : "poses world_from_cam"
                       : "") +
           (is_inverse && is_reordered ? " and " : "") +
           (is_reordered
                ? is_trajectory ? "quaternions w x y z" : "quaternions x y z w"
                : "") +
           "; write it again in the documented convention";
  }
  return std::nullopt;
}

}  // namespace mgsfm
