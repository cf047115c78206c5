// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/geodesic_median.h"

#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Quaterniond RandomRotation(Random* random) {
  return Quaterniond(random->Normal(), random->Normal(), random->Normal(),
                     random->Normal())
      .normalized();
}

double SumOfDistances(const Quaterniond& rotation,
                      const std::vector<Quaterniond>& samples,
                      const std::vector<double>& weights) {
  double sum = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    sum += weights[i] * AngleBetween(rotation, samples[i]);
  }
  return sum;
}

// Compass search around many starts.
double BruteForceMinimum(const std::vector<Quaterniond>& samples,
                         const std::vector<double>& weights, Random* random) {
  double best = SumOfDistances(samples[0], samples, weights);
  for (int start = 0; start < 30; ++start) {
    Quaterniond rotation =
        start < 10 ? samples[start % samples.size()] : RandomRotation(random);
    double cost = SumOfDistances(rotation, samples, weights);
    for (double radius = 0.5; radius > 1e-9;) {
      bool has_improved = false;
      for (int axis = 0; axis < 6; ++axis) {
        const Vector3d step =
            (axis < 3 ? radius : -radius) * Vector3d::Unit(axis % 3);
        const Quaterniond trial = rotation * ExpSO3(step);
        const double trial_cost = SumOfDistances(trial, samples, weights);
        if (trial_cost < cost) {
          rotation = trial;
          cost = trial_cost;
          has_improved = true;
        }
      }
      if (!has_improved) radius *= 0.5;
    }
    best = std::min(best, cost);
  }
  return best;
}

TEST(GeodesicMedian, AgreesWithBruteForce) {
  Random random(1);
  for (int trial = 0; trial < 8; ++trial) {
    const Quaterniond center = RandomRotation(&random);
    std::vector<Quaterniond> samples;
    std::vector<double> weights;
    for (int i = 0; i < 4 + 3 * trial; ++i) {
      samples.push_back(center * ExpSO3(0.3 * NormalVector(&random)));
      weights.push_back(random.Uniform(0.5, 2.0));
    }
    const GeodesicMedian median = FindGeodesicMedian(samples, weights, 0.5);
    EXPECT_EQ(median.summary.termination, Termination::kConverged);
    EXPECT_NEAR(median.summary.final_cost,
                BruteForceMinimum(samples, weights, &random), 1e-7);
  }
}

TEST(GeodesicMedian, StopsAtASampleThatIsOptimal) {
  const Quaterniond center = ExpSO3({0.3, -0.2, 1.0});
  const std::vector<Quaterniond> samples = {
      center * ExpSO3({0.1, 0.0, 0.0}), center,
      center * ExpSO3({0.0, 0.1, 0.0}), center * ExpSO3({-0.05, -0.07, 0.0}),
      center};
  const GeodesicMedian median =
      FindGeodesicMedian(samples, std::vector<double>(5, 1.0), 0.2);
  EXPECT_EQ(median.summary.termination, Termination::kConverged);
  EXPECT_LT(AngleBetween(median.rotation, center), 1e-9);
}

TEST(GeodesicMedian, SurvivesAlmostHalfOutliersThatAgree) {
  Random random(2);
  const Quaterniond truth = RandomRotation(&random);
  const Quaterniond wrong = truth * ExpSO3({0.0, DegToRad(40.0), 0.0});
  std::vector<Quaterniond> samples;
  for (int i = 0; i < 500; ++i) {
    const Quaterniond& center = i % 20 < 9 ? wrong : truth;
    samples.push_back(center * ExpSO3(DegToRad(0.5) * NormalVector(&random)));
  }
  const GeodesicMedian median =
      FindGeodesicMedian(samples, std::vector<double>(500, 1.0), DegToRad(10));
  EXPECT_LT(RadToDeg(AngleBetween(median.rotation, truth)), 1.5);
  EXPECT_LT(RadToDeg(median.median_deviation_rad), 3.0);
}

TEST(GeodesicMedian, SurvivesAlmostHalfScatteredOutliers) {
  Random random(3);
  const Quaterniond truth = RandomRotation(&random);
  std::vector<Quaterniond> samples;
  for (int i = 0; i < 500; ++i) {
    samples.push_back(
        i % 20 < 9 ? RandomRotation(&random)
                   : truth * ExpSO3(DegToRad(0.5) * NormalVector(&random)));
  }
  const GeodesicMedian median =
      FindGeodesicMedian(samples, std::vector<double>(500, 1.0), DegToRad(10));
  EXPECT_LT(RadToDeg(AngleBetween(median.rotation, truth)), 0.2);
}

// Two groups that disagree: the heavier one wins, there is no midpoint.
TEST(GeodesicMedian, TakesTheHeavierOfTwo) {
  const Quaterniond a = ExpSO3({0.1, 0.0, 0.0});
  const Quaterniond b = ExpSO3({0.0, 0.9, 0.0});
  EXPECT_LT(
      AngleBetween(FindGeodesicMedian({a, b}, {1.0, 1.1}, 0.2).rotation, b),
      1e-9);
  EXPECT_LT(
      AngleBetween(FindGeodesicMedian({a, b}, {1.1, 1.0}, 0.2).rotation, a),
      1e-9);
}

TEST(GeodesicMedian, SignsOfQuaternionsDoNotMatter) {
  Random random(4);
  std::vector<Quaterniond> samples, flipped;
  for (int i = 0; i < 9; ++i) {
    samples.push_back(ExpSO3(0.1 * NormalVector(&random)));
    flipped.push_back(samples.back());
    if (i % 2 == 0) flipped.back().coeffs() *= -1.0;
  }
  const std::vector<double> weights(9, 1.0);
  EXPECT_LT(AngleBetween(FindGeodesicMedian(samples, weights, 1.0).rotation,
                         FindGeodesicMedian(flipped, weights, 1.0).rotation),
            1e-9);
}

TEST(GeodesicMedian, NoSamplesBreakTheContract) {
  EXPECT_THROW(FindGeodesicMedian({}, {}, 0.1), ContractError);
}

}  // namespace
}  // namespace mgsfm
