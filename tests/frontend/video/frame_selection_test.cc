// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

#include "base/random.h"
#include "video/sampling_plan.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// About 30 images per second, some of which are missing.
std::vector<int64_t> JitteredTimes(uint64_t seed, int num_images) {
  Random random(seed);
  std::vector<int64_t> times_ns;
  for (int i = 0; i < num_images; ++i) {
    if (random.Uniform(0.0, 1.0) < 0.2) continue;
    times_ns.push_back(33'333'333 * int64_t{i} +
                       static_cast<int64_t>(random.Uniform(0.0, 8e6)));
  }
  return times_ns;
}

TEST(SelectByRateTest, TakesTheNearestImages) {
  const std::vector<int64_t> times_ns = JitteredTimes(3, 90);
  const double rate_hz = 4.0;
  std::set<int> nearest;
  for (int64_t t = times_ns.front(); t <= times_ns.back();
       t += std::llround(1e9 / rate_hz)) {
    int best = 0;
    for (size_t i = 0; i < times_ns.size(); ++i) {
      if (std::abs(times_ns[i] - t) < std::abs(times_ns[best] - t)) {
        best = static_cast<int>(i);
      }
    }
    nearest.insert(best);
  }
  EXPECT_EQ(SelectByRate(times_ns, rate_hz),
            std::vector<int>(nearest.begin(), nearest.end()));
}

TEST(SelectByRateTest, HighRatesTakeEachImageOnce) {
  EXPECT_THAT(SelectByRate({0, 100'000'000, 200'000'000}, 1000.0),
              ElementsAre(0, 1, 2));
  EXPECT_THAT(SelectByRate({5}, 1.0), ElementsAre(0));
  EXPECT_THAT(SelectByRate({}, 1.0), IsEmpty());
}

TEST(SelectAtInstantsTest, PairsAreNearestAndOneToOne) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const std::vector<int64_t> instants_ns = JitteredTimes(seed, 40);
    const std::vector<int64_t> times_ns = JitteredTimes(seed + 100, 40);
    constexpr int64_t kMax = 16'000'000;
    const auto selected = SelectAtInstants(instants_ns, times_ns, kMax);
    std::set<int> used;
    for (size_t i = 0; i < selected.size(); ++i) {
      if (!selected[i]) continue;
      EXPECT_TRUE(used.insert(*selected[i]).second);
      const int64_t difference =
          std::abs(times_ns[*selected[i]] - instants_ns[i]);
      EXPECT_LE(difference, kMax);
      for (const int64_t time_ns : times_ns) {
        EXPECT_LE(difference, std::abs(time_ns - instants_ns[i]));
      }
      for (const int64_t instant_ns : instants_ns) {
        EXPECT_LE(difference, std::abs(times_ns[*selected[i]] - instant_ns));
      }
    }
    // Images that are nearest to each other are paired.
    EXPECT_GT(used.size(), 15u);
  }
}

TEST(SelectAtInstantsTest, FarImagesAreLeftOut) {
  EXPECT_THAT(SelectAtInstants({0, 100}, {40, 61}, 39),
              ElementsAre(std::nullopt, 1));
  EXPECT_THAT(SelectAtInstants({0, 100}, {}, 39),
              ElementsAre(std::nullopt, std::nullopt));
}

TEST(MedianIntervalTest, IgnoresGaps) {
  EXPECT_EQ(MedianInterval({0, 10, 20, 30, 500}), 10);
  EXPECT_EQ(MedianInterval({7}), std::nullopt);
}

}  // namespace
}  // namespace mgsfm
