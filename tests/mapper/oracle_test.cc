// SPDX-License-Identifier: BSD-3-Clause
// Compares the mapper with the optimum of its input on realistic drives, see
// bench/oracle/oracle.h. docs/results/accuracy.md covers long drives.
#include "oracle/oracle.h"

#include <gtest/gtest.h>

namespace mgsfm {
namespace {

class OracleTest : public testing::TestWithParam<RigPreset> {};

TEST_P(OracleTest, MapperIsNearTheOptimum) {
  SimulationOptions options = StandardSimulation(GetParam());
  options.num_frames = 40;
  const Simulation simulation = Simulate(options);
  const MapperOptions mapper;
  const Context context;
  const auto comparison = CompareWithOracles(
      simulation,
      RunMapper({simulation.scene, simulation.view_graph}, mapper, context),
      mapper.bundle_adjustment, context);
  ASSERT_TRUE(comparison);
  EXPECT_EQ(comparison->mapper.num_registered, comparison->mapper.num_images);
  EXPECT_LE(comparison->OracleRatio(), 1.1);
  EXPECT_LE(comparison->FullOracleRatio(), 1.3);
}

INSTANTIATE_TEST_SUITE_P(Rigs, OracleTest,
                         testing::Values(RigPreset::kStereo,
                                         RigPreset::kKitti360));

TEST(ExactDriveTest, ExactInputGivesTheTruth) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = StreetSimulation(rig);
    options.num_frames = 30;
    const Simulation simulation = Simulate(options);
    const MapperResult result =
        RunMapper({simulation.scene, simulation.view_graph}, {}, Context());
    ASSERT_EQ(result.models.size(), 1u);
    const ModelErrors errors =
        EvaluateModel(simulation, result.models.front().reconstruction);
    EXPECT_EQ(errors.num_registered, errors.num_images);
    // The path is 29 m long; keypoints have single precision.
    EXPECT_LE(errors.position_m->mean, 29e-6);
    for (const RigErrors& sensor : errors.rig) {
      EXPECT_LE(sensor.position_m, 1e-6 * sensor.true_distance_m);
    }
  }
}

}  // namespace
}  // namespace mgsfm
