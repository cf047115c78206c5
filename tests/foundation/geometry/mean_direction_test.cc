// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/mean_direction.h"

#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

TEST(RobustMeanDirection, SurvivesOutliers) {
  Random random(1);
  const Vector3d truth = NormalVector(&random).normalized();
  std::vector<Vector3d> directions;
  for (int i = 0; i < 400; ++i) {
    directions.push_back(
        i % 5 < 3 ? ExpSO3(DegToRad(1.0) * NormalVector(&random)) * truth
                  : NormalVector(&random).normalized());
  }
  EXPECT_LT(RadToDeg(AngleBetween(RobustMeanDirection(directions), truth)),
            0.4);
}

TEST(RobustMeanDirection, OfEqualOnesIsThat) {
  const Vector3d v = Vector3d(1.0, -2.0, 0.5).normalized();
  EXPECT_LT((RobustMeanDirection({v}) - v).norm(), 1e-15);
  EXPECT_LT((RobustMeanDirection({v, v, v}) - v).norm(), 1e-15);
}

}  // namespace
}  // namespace mgsfm
