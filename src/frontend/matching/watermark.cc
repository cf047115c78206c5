// SPDX-License-Identifier: BSD-3-Clause
#include "matching/watermark.h"

#include <algorithm>
#include <cmath>

namespace mgsfm::internal {
namespace {

// At the default ratio of 0.7 all 20 samples are outliers with a probability of
// 0.3^20 < 1e-10.
constexpr int kNumTrials = 20;

bool IsInBorder(const Camera& camera, const Eigen::Vector2f& point,
                double border_size) {
  const double width = camera.width_px, height = camera.height_px;
  const double border = border_size * std::hypot(width, height);
  return point.x() < border || point.y() < border ||
         point.x() > width - border || point.y() > height - border;
}

}  // namespace

bool IsWatermark(const VerificationView& view1, const VerificationView& view2,
                 const std::vector<Match>& inliers,
                 const TwoViewGeometryOptions& options, Random* random) {
  std::vector<Eigen::Vector2f> shifts;
  for (const Match& match : inliers) {
    const Eigen::Vector2f& point1 = (*view1.keypoints_px)[match.keypoint_idx1];
    const Eigen::Vector2f& point2 = (*view2.keypoints_px)[match.keypoint_idx2];
    if (IsInBorder(*view1.camera, point1, options.watermark_border_size) &&
        IsInBorder(*view2.camera, point2, options.watermark_border_size)) {
      shifts.emplace_back(point2 - point1);
    }
  }
  const double min_num_shifts =
      options.watermark_min_inlier_ratio * static_cast<double>(inliers.size());
  if (shifts.empty() || static_cast<double>(shifts.size()) < min_num_shifts) {
    return false;
  }
  for (int trial = 0; trial < kNumTrials; ++trial) {
    const Eigen::Vector2f shift =
        shifts[random->Index(static_cast<uint32_t>(shifts.size()))];
    const auto num_alike = std::count_if(
        shifts.begin(), shifts.end(), [&](const Eigen::Vector2f& other) {
          return (other - shift).norm() <= options.max_error;
        });
    if (static_cast<double>(num_alike) >= min_num_shifts) return true;
  }
  return false;
}

}  // namespace mgsfm::internal
