// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/position_initialization.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

TEST(PositionInitializationTest, ProxOfScaleResidualIsTheMinimum) {
  Random random(4);
  for (int trial = 0; trial < 300; ++trial) {
    const double rho = std::pow(10.0, random.Uniform(-1.0, 1.0));
    const double bound = -random.Uniform(0.0, 2.0);
    const double steep = random.Uniform(1.0, 5.0);
    const double v = random.Uniform(-8.0, 4.0);
    const auto cost = [&](double z) {
      return std::abs(z) + (steep - 1.0) * std::max(bound - z, 0.0) +
             0.5 * rho * (z - v) * (z - v);
    };
    double best = std::numeric_limits<double>::infinity();
    for (double z = -10.0; z <= 5.0; z += 1e-3) best = std::min(best, cost(z));
    EXPECT_LE(cost(ProxOfScaleResidual(v, rho, bound, steep)), best + 1e-12);
  }
}

// Single cameras without rotation.
PositionProblem PlainProblem(size_t num_frames) {
  PositionProblem problem;
  problem.num_frames = static_cast<int>(num_frames);
  problem.sensor_kind = {SensorKind::kFixed};
  problem.fixed_translation = {Vector3d::Zero()};
  for (size_t i = 0; i < num_frames; ++i) {
    problem.world_from_cam.emplace_back(Eigen::Matrix3d::Identity());
    problem.frame_idx.push_back(static_cast<int>(i));
    problem.sensor_idx.push_back(0);
  }
  return problem;
}

struct PlainPairs {
  std::vector<BaselineDirection> baselines;
  PairScales scales;

  void Add(int i, int j, const Vector3d& baseline, int group) {
    BaselineDirection direction;
    direction.image_idx1 = i;
    direction.image_idx2 = j;
    direction.kind = BaselineKind::kDirection;
    direction.direction = baseline.normalized();
    direction.sigma_rad = 0.01;
    baselines.push_back(direction);
    scales.pairs.push_back(PairScale{baseline.norm(), 0.05, group});
    if (group >= static_cast<int>(scales.group_sizes.size())) {
      scales.group_sizes.resize(group + 1, 0);
    }
    ++scales.group_sizes[group];
    scales.typical_depth = 10.0;
  }
  InitialPositions Initialize(size_t num_frames) const {
    return InitializePositions({PlainProblem(num_frames), baselines, scales,
                                Mask(baselines.size(), true)},
                               {0.3});
  }
};

std::vector<double> Lengths(const PlainPairs& pairs) {
  std::vector<double> lengths;
  for (const auto& pair : pairs.scales.pairs) lengths.push_back(pair->scale);
  return lengths;
}

std::vector<Vector3d> RandomCenters(int size, uint64_t seed) {
  Random random(seed);
  std::vector<Vector3d> centers(size, Vector3d::Zero());
  for (int i = 1; i < size; ++i) {
    centers[i] = centers[i - 1] +
                 Vector3d(1.0, 0.3 * random.Normal(), 0.3 * random.Normal());
  }
  return centers;
}

TEST(PositionInitializationTest, ExactPairsGiveTheCentersDespiteWrongOnes) {
  const std::vector<Vector3d> centers = RandomCenters(12, 0);
  PlainPairs pairs;
  for (int i = 0; i < 12; ++i) {
    for (int j = i + 1; j < std::min(i + 4, 12); ++j) {
      Vector3d baseline = centers[j] - centers[i];
      if ((i + j) % 7 == 0) baseline = Vector3d(0.2, -1.0, 1.5);
      pairs.Add(i, j, baseline, 0);
    }
  }
  const InitialPositions initial = pairs.Initialize(12);
  EXPECT_EQ(initial.solve.termination, Termination::kConverged);
  for (int i = 0; i < 12; ++i) {
    EXPECT_LT((initial.positions.frame_center[i] - centers[i]).norm(), 0.02);
  }
}

// A mask has the same effect as pairs that do not exist.
TEST(PositionInitializationTest, PairsOutsideTheMaskDoNotMatter) {
  const std::vector<Vector3d> centers = RandomCenters(8, 6);
  PlainPairs pairs;
  Mask pair_is_used;
  PlainPairs used;
  Random random(7);
  for (int i = 0; i < 8; ++i) {
    for (int j = i + 1; j < std::min(i + 4, 8); ++j) {
      const Vector3d baseline = centers[j] - centers[i];
      pairs.Add(i, j, baseline, 0);
      used.Add(i, j, baseline, 0);
      pair_is_used.push_back(true);
      pairs.Add(i, j, random.Uniform(0.5, 2.0) * Vector3d(-1.0, 2.0, 0.0), 0);
      pair_is_used.push_back(false);
    }
  }
  pairs.scales.group_sizes = used.scales.group_sizes;
  const InitialPositions masked = InitializePositions(
      {PlainProblem(8), pairs.baselines, pairs.scales, pair_is_used}, {0.3});
  EXPECT_EQ(masked.positions.frame_center,
            used.Initialize(8).positions.frame_center);
}

TEST(PositionInitializationTest, WrongPairsOfHardlyAnyLengthDoNotOutvote) {
  const std::vector<Vector3d> centers = RandomCenters(12, 4);
  PlainPairs pairs;
  for (int i = 0; i < 12; ++i) {
    for (int j = i + 1; j < std::min(i + 4, 12); ++j) {
      const Vector3d baseline = centers[j] - centers[i];
      for (int k = 0; k < 4; ++k) pairs.Add(i, j, baseline, 0);
      if (i % 3 == 1) pairs.Add(i, j, 0.003 * Vector3d(0.4, -1.0, 0.5), 0);
    }
  }
  const InitialPositions initial = pairs.Initialize(12);
  EXPECT_EQ(initial.solve.termination, Termination::kConverged);
  for (int i = 0; i < 12; ++i) {
    EXPECT_LT((initial.positions.frame_center[i] - centers[i]).norm(), 0.02);
  }
}

TEST(PositionInitializationTest, GroupFactorsAreFoundWhereTheyShow) {
  // The pairs over an odd distance have lengths in another unit.
  const std::vector<Vector3d> centers = RandomCenters(10, 1);
  PlainPairs pairs;
  for (int i = 0; i < 10; ++i) {
    for (int j = i + 1; j < std::min(i + 5, 10); ++j) {
      const int group = (j - i) % 2;
      const double unit = group == 0 ? 1.0 : 2.5;
      pairs.Add(i, j, (centers[j] - centers[i]) * unit, group);
    }
  }
  const InitialPositions initial = pairs.Initialize(10);
  ASSERT_EQ(initial.group_factor.size(), 2u);
  EXPECT_NEAR(initial.group_factor[1], 1.0 / 2.5, 0.01);
  for (int i = 0; i < 10; ++i) {
    EXPECT_LT((initial.positions.frame_center[i] - centers[i]).norm(), 0.05);
  }
}

TEST(PositionInitializationTest, PairsWithoutParallaxKeepFramesTogether) {
  PlainPairs pairs;
  pairs.Add(0, 1, Vector3d(1.0, 0.0, 0.0), 0);
  BaselineDirection still;
  still.image_idx1 = 1;
  still.image_idx2 = 2;
  still.kind = BaselineKind::kNoParallax;
  pairs.baselines.push_back(still);
  pairs.scales.pairs.emplace_back();
  const InitialPositions initial = pairs.Initialize(4);
  const Positions& positions = initial.positions;
  EXPECT_LT((positions.frame_center[2] - positions.frame_center[1]).norm(),
            1e-3);
  EXPECT_NEAR(positions.frame_center[1].x(), 1.0, 1e-3);
  EXPECT_TRUE(positions.frame_is_placed[2]);
  EXPECT_FALSE(positions.frame_is_placed[3]);
}

// The objective of the header by an independent route. counted_length: the
// length that each pair counts with.
double CostOfPairs(const PlainPairs& pairs,
                   const std::vector<double>& counted_length,
                   const std::vector<Vector3d>& centers) {
  constexpr double kSigma = 0.5 * 3.14159265358979 / 180.0;
  double sum = 0.0;
  for (size_t p = 0; p < pairs.baselines.size(); ++p) {
    const BaselineDirection& baseline = pairs.baselines[p];
    const Vector3d C =
        centers[baseline.image_idx2] - centers[baseline.image_idx1];
    const double along = C.dot(baseline.direction);
    const double across = (C - along * baseline.direction).norm();
    sum += (across + std::abs(along - pairs.scales.pairs[p]->scale)) /
           (counted_length[p] * std::hypot(0.01, kSigma));
  }
  return sum;
}

// Compared with many positions near the solution, where a run of frames moves
// as a whole or each frame by itself; frame 0 is the gauge.
void ExpectMinimum(const std::vector<Vector3d>& solution,
                   const PlainPairs& pairs,
                   const std::vector<double>& counted_length) {
  Random random(5);
  const auto step = [&](double radius) -> Vector3d {
    return radius * Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  const int num_frames = static_cast<int>(solution.size());
  const double solved = CostOfPairs(pairs, counted_length, solution);
  for (int trial = 0; trial < 20000; ++trial) {
    std::vector<Vector3d> other = solution;
    const double radius = std::pow(10.0, random.Uniform(-4.0, 0.0));
    const int first = 1 + random.Index(num_frames - 1);
    const int last = first + random.Index(num_frames - first);
    const Vector3d common = step(radius);
    for (int f = first; f <= last; ++f) {
      other[f] += trial % 2 == 0 ? common : step(radius);
    }
    ASSERT_GE(CostOfPairs(pairs, counted_length, other), solved * (1.0 - 1e-3));
  }
}

PlainPairs NoisyPairsOfAll(const std::vector<Vector3d>& centers) {
  Random random(3);
  PlainPairs pairs;
  const int num_frames = static_cast<int>(centers.size());
  for (int i = 0; i < num_frames; ++i) {
    for (int j = i + 1; j < num_frames; ++j) {
      const Vector3d noise(random.Normal(), random.Normal(), random.Normal());
      pairs.Add(i, j, centers[j] - centers[i] + 0.2 * noise, 0);
    }
  }
  return pairs;
}

TEST(PositionInitializationTest, IsTheMinimumOfASmallProblem) {
  const PlainPairs pairs = NoisyPairsOfAll(RandomCenters(3, 2));
  const InitialPositions initial = pairs.Initialize(3);
  ExpectMinimum(initial.positions.frame_center, pairs, Lengths(pairs));
}

// Ten frames that all have pairs with each other, so that the lower quartile
// of a frame's nine lengths is the third.
std::vector<double> CountedLengths(const PlainPairs& pairs) {
  constexpr int kFrames = 10;
  std::vector<double> quartile;
  for (int f = 0; f < kFrames; ++f) {
    std::vector<double> lengths;
    for (size_t p = 0; p < pairs.baselines.size(); ++p) {
      const BaselineDirection& baseline = pairs.baselines[p];
      if (baseline.image_idx1 == f || baseline.image_idx2 == f) {
        lengths.push_back(pairs.scales.pairs[p]->scale);
      }
    }
    std::sort(lengths.begin(), lengths.end());
    quartile.push_back(lengths[2]);
  }
  std::vector<double> counted_length = Lengths(pairs);
  for (size_t p = 0; p < counted_length.size(); ++p) {
    const BaselineDirection& baseline = pairs.baselines[p];
    const double bound = 0.5 * std::min(quartile[baseline.image_idx1],
                                        quartile[baseline.image_idx2]);
    counted_length[p] = std::max(counted_length[p], bound);
  }
  return counted_length;
}

TEST(PositionInitializationTest, ShortPairsCountWithHalfTheLowerQuartile) {
  for (uint64_t seed = 0; seed < 8; ++seed) {
    PlainPairs pairs = NoisyPairsOfAll(RandomCenters(10, seed));
    Random random(seed);
    for (auto& pair : pairs.scales.pairs) {
      if (random.Uniform(0.0, 1.0) < 0.15) pair->scale = 0.01;
    }
    const InitialPositions initial = pairs.Initialize(10);
    ExpectMinimum(initial.positions.frame_center, pairs, CountedLengths(pairs));
  }
}

}  // namespace
}  // namespace mgsfm
