// SPDX-License-Identifier: BSD-3-Clause
#include "scene/typical_pose.h"

#include <limits>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

Rigid3 TypicalPose(const std::vector<Rigid3>& poses) {
  MGSFM_CHECK(!poses.empty());
  // Bounds the quadratic cost.
  const size_t step =
      (poses.size() + kSufficientNumSamples - 1) / kSufficientNumSamples;
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
  typical.translation =
      MedianOfCoordinates(Transformed(poses, &Rigid3::translation));
  return typical;
}

}  // namespace mgsfm
