// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/mean_direction.h"

#include <algorithm>
#include <limits>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Bounds the quadratic cost of the start.
constexpr size_t kMaxNumStarts = 100;

double MedianAngle(const std::vector<Vector3d>& directions,
                   const Vector3d& mean) {
  std::vector<double> angles = Transformed(
      directions, [&](const Vector3d& v) { return AngleBetween(mean, v); });
  const auto middle = angles.begin() + (angles.size() - 1) / 2;
  std::nth_element(angles.begin(), middle, angles.end());
  return *middle;
}

Vector3d BestSample(const std::vector<Vector3d>& directions) {
  const size_t step = (directions.size() + kMaxNumStarts - 1) / kMaxNumStarts;
  Vector3d best = directions.front();
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < directions.size(); i += step) {
    const double median = MedianAngle(directions, directions[i]);
    if (median >= least) continue;
    least = median;
    best = directions[i];
  }
  return best;
}

}  // namespace

Vector3d RobustMeanDirection(const std::vector<Vector3d>& directions) {
  MGSFM_CHECK(!directions.empty());
  Vector3d mean = BestSample(directions);
  // The limit stops inputs whose inlier sets alternate.
  for (int i = 0; i < 50; ++i) {
    // Normal errors of a direction exceed three medians with probability 2^-9.
    // The lower limit keeps the bound above rounding for equal directions.
    const double bound = std::max(1e-6, 3.0 * MedianAngle(directions, mean));
    Vector3d sum = Vector3d::Zero();
    for (const Vector3d& v : directions) {
      const double angle = AngleBetween(mean, v);
      if (angle > bound) continue;
      sum += v / std::max(angle, 0.01 * bound);
    }
    if (!(sum.norm() > 0.0)) break;
    const Vector3d next = sum.normalized();
    const double move = (next - mean).norm();
    mean = next;
    // Far below the error of a direction (radians).
    if (move < 1e-9) break;
  }
  return mean;
}

}  // namespace mgsfm
