// SPDX-License-Identifier: BSD-3-Clause
#include "scene/typical_pose.h"

#include <limits>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Bounds the quadratic cost; the median of 200 samples is accurate to about a
// tenth of their standard deviation.
constexpr size_t kMaxNumCandidates = 200;

}  // namespace

Rigid3 TypicalPose(const std::vector<Rigid3>& poses) {
  MGSFM_CHECK(!poses.empty());
  const size_t step =
      (poses.size() + kMaxNumCandidates - 1) / kMaxNumCandidates;
  double least_sum = std::numeric_limits<double>::infinity();
  Rigid3 typical;
  for (size_t i = 0; i < poses.size(); i += step) {
    double sum = 0.0;
    for (size_t j = 0; j < poses.size(); j += step) {
      sum += AngleBetween(poses[i].rotation, poses[j].rotation);
    }
    if (sum >= least_sum) continue;
    least_sum = sum;
    typical.rotation = poses[i].rotation;
  }
  std::vector<Eigen::Vector3d> translations;
  translations.reserve(poses.size());
  for (const Rigid3& pose : poses) translations.push_back(pose.translation);
  typical.translation = MedianOfCoordinates(translations);
  return typical;
}

}  // namespace mgsfm
