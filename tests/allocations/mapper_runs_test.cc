// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/mapper_runs.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mgsfm {
namespace {

MapperResult MapNamed(const std::string& name) {
  const std::vector<MapperRun> runs = MapperRuns();
  const auto run = std::find_if(runs.begin(), runs.end(),
                                [&](const auto& r) { return r.name == name; });
  MapperResult result = Map(*run, 1);
  EXPECT_FALSE(result.models.empty());
  return result;
}

// What is not reached cannot fail.
TEST(MapperRuns, ReachOptionalStages) {
  const MapperModel all = MapNamed("all results").models.at(0);
  EXPECT_TRUE(all.position_priors && all.position_priors->is_registered);
  EXPECT_TRUE(all.covariances && all.covariances->is_usable);
  EXPECT_TRUE(all.soft_rig_images && all.soft_rig_images->summary.is_usable);

  const MapperModel delays = MapNamed("trigger delays").models.at(0);
  EXPECT_TRUE(delays.soft_rig_images);
  EXPECT_TRUE(delays.meters_per_unit);
  EXPECT_TRUE(delays.gravity);

  const MapperResult lengths = MapNamed("unknown focal lengths");
  ASSERT_EQ(lengths.focal_lengths.size(), 1u);
  EXPECT_TRUE(lengths.focal_lengths[0].estimated_px)
      << lengths.focal_lengths[0].message;

  EXPECT_EQ(MapNamed("weak seam").models.size(), 2u);
  EXPECT_FALSE(
      MapNamed("extension").models.at(0).extension->added_frames.empty());
  const Reconstruction separate =
      MapNamed("separate cameras").models.at(0).reconstruction;
  for (size_t i = 0; i < separate.sensor_from_rig.size(); ++i) {
    EXPECT_TRUE(separate.sensor_from_rig[i]) << i;
  }
}

}  // namespace
}  // namespace mgsfm
