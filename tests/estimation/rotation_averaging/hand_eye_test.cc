// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/hand_eye.h"

#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Turns with the given sizes about the three axes of the rig.
std::vector<MotionPair> MakeMotions(const Quaterniond& a_from_b,
                                    const Vector3d& sizes, double noise_deg,
                                    double outlier_ratio, Random* random) {
  std::vector<MotionPair> motions;
  for (int i = 0; i < 300; ++i) {
    MotionPair motion;
    motion.beta = sizes.cwiseProduct(NormalVector(random));
    motion.alpha =
        LogSO3(a_from_b * ExpSO3(motion.beta) * a_from_b.conjugate() *
               ExpSO3(DegToRad(noise_deg) * NormalVector(random)));
    if (random->Uniform() < outlier_ratio) motion.alpha = NormalVector(random);
    motions.push_back(motion);
  }
  return motions;
}

TEST(HandEye, IsExactWithoutNoise) {
  Random random(1);
  const Quaterniond truth = ExpSO3({0.4, -1.5, 0.3});
  const HandEyeResult result = CalibrateHandEye(
      MakeMotions(truth, {0.3, 0.1, 0.0}, 0.0, 0.0, &random), 300);
  EXPECT_EQ(result.summary.termination, Termination::kConverged);
  EXPECT_LT(AngleBetween(result.a_from_b, truth), 1e-9);
  EXPECT_NEAR(result.second_axis_rms_rad, 0.1, 0.02);
}

TEST(HandEye, UncertaintyBoundsTheErrorUnderNoise) {
  Random random(2);
  const Quaterniond truth = ExpSO3({0.4, -1.5, 0.3});
  for (const double second : {0.2, 0.05}) {
    const HandEyeResult result = CalibrateHandEye(
        MakeMotions(truth, {0.3, second, 0.0}, 0.5, 0.2, &random), 300);
    EXPECT_LT(AngleBetween(result.a_from_b, truth),
              4.0 * result.uncertainty_rad);
    EXPECT_LT(RadToDeg(result.uncertainty_rad), 1.0);
  }
}

TEST(HandEye, OneAxisIsSeenAsDegenerate) {
  Random random(3);
  const HandEyeResult result = CalibrateHandEye(
      MakeMotions(Quaterniond::Identity(), {0.0, 0.5, 0.0}, 0.1, 0.0, &random),
      300);
  EXPECT_LT(RadToDeg(result.second_axis_rms_rad), 0.1);
}

}  // namespace
}  // namespace mgsfm
