// SPDX-License-Identifier: BSD-3-Clause
#include "truth_conventions.h"

#include <cmath>
#include <utility>

#include "base/text.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// The rotation cam_from_world if the file is meant differently.
Quaterniond Reread(const Quaterniond& cam_from_world,
                   const PoseConvention& convention, bool is_reordered,
                   bool is_inverse) {
  Quaterniond in_file = convention.is_world_from_cam
                            ? cam_from_world.conjugate()
                            : cam_from_world;
  if (is_reordered && convention.order == PoseConvention::kXyzw) {
    in_file = Quaterniond(in_file.x(), in_file.y(), in_file.z(), in_file.w());
  } else if (is_reordered) {
    in_file = FromOrderXyzw(in_file);
  }
  return convention.is_world_from_cam != is_inverse ? in_file.conjugate()
                                                    : in_file;
}

std::vector<double> DifferencesRad(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, bool is_reordered, bool is_inverse) {
  std::vector<double> differences_rad;
  for (const RotationEvidence& pair : evidence) {
    const auto reread = [&](const Quaterniond& rotation) {
      return Reread(rotation, convention, is_reordered, is_inverse);
    };
    differences_rad.push_back(
        AngleBetween(pair.second_from_first,
                     reread(pair.second) * reread(pair.first).conjugate()));
  }
  return differences_rad;
}

// Whether more pairs are for the other reading than chance explains: between
// readings that are equally wrong, a pair decides like a coin. With 3.1
// standard deviations, chance does so once in 1000 files, and never in one of
// fewer than ten pairs.
bool MostAreFor(const std::vector<double>& other_rad,
                const std::vector<double>& as_read_rad) {
  const auto num_pairs = static_cast<double>(other_rad.size());
  double num_for = 0.0;
  for (size_t i = 0; i < other_rad.size(); ++i) {
    num_for += other_rad[i] < as_read_rad[i];
  }
  return 2.0 * num_for - num_pairs > 3.1 * std::sqrt(num_pairs);
}

}  // namespace

std::optional<std::string> FindOtherConvention(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, const std::string& source) {
  // Errors of sound poses shrink by no other convention.
  constexpr double kMaxRatio = 0.2;
  if (evidence.empty()) return std::nullopt;
  const std::vector<double> as_read_rad =
      DifferencesRad(evidence, convention, false, false);
  const double difference_rad = Median(as_read_rad);
  for (const auto& [is_reordered, is_inverse] :
       {std::pair(true, false), std::pair(false, true),
        std::pair(true, true)}) {
    if (is_reordered && convention.order == PoseConvention::kMatrix) continue;
    const std::vector<double> reread_rad =
        DifferencesRad(evidence, convention, is_reordered, is_inverse);
    const double other_rad = Median(reread_rad);
    if (!(other_rad < kMaxRatio * difference_rad) ||
        !MostAreFor(reread_rad, as_read_rad)) {
      continue;
    }
    const auto degrees = [](double rad) {
      return FormatDouble(RadToDeg(rad), std::chars_format::general, 3);
    };
    std::string other = !is_inverse                    ? ""
                        : convention.is_world_from_cam ? "poses cam_from_world"
                                                       : "poses world_from_cam";
    if (is_reordered) {
      other +=
          std::string(is_inverse ? " and " : "") + "quaternions " +
          (convention.order == PoseConvention::kXyzw ? "w x y z" : "x y z w");
    }
    return "the rotations from image to image differ from those of the " +
           source + " by " + degrees(difference_rad) +
           " deg in the median, but by " + degrees(other_rad) +
           " deg if the file has " + other +
           "; write it again in the documented convention";
  }
  return std::nullopt;
}

}  // namespace mgsfm
