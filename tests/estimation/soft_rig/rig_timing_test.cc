// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_timing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "estimation/soft_rig/winding_drive.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {
namespace {

struct TimedDrive {
  Simulation simulation;
  Reconstruction rigid;
  SoftRigResult timed;
};

SoftRigResult Adjust(const Simulation& simulation, const Reconstruction& rigid,
                     SoftRig method,
                     const RefinementConditions& conditions = {}) {
  const std::function<CandidateSource(const Scene&)> candidates =
      [&](const Scene&) {
        return FixedCandidates(GroupTracks(simulation.ground_truth));
      };
  SoftRigOptions options;
  options.method = method;
  return EstimateRigTiming({simulation.scene, TimesOf(simulation.scene),
                            candidates, rigid, conditions},
                           options, BundleAdjustmentOptions(), Threads(2));
}

TimedDrive AdjustDrive(const SimulationOptions& options, int num_frames,
                       SoftRig method) {
  TimedDrive drive{Simulate(options, WindingPath(num_frames)), {}, {}};
  drive.rigid = AdjustRigid(drive.simulation);
  drive.timed = Adjust(drive.simulation, drive.rigid, method);
  EXPECT_TRUE(drive.timed.images.summary.is_usable)
      << drive.timed.images.summary.message;
  EXPECT_TRUE(drive.timed.images.summary.has_converged);
  return drive;
}

double MeanError(const Simulation& simulation, const Reconstruction& model) {
  std::vector<ImagePoses> images;
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    images.push_back({simulation.scene.images[i].name, true,
                      model.CamFromWorld(simulation.scene, static_cast<int>(i)),
                      simulation.cam_from_world[i]});
  }
  return Evaluate(images, true, {}, {}).position_m->mean;
}

TEST(RigTimingTest, DelaysAreFound) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = DriveOptions(rig);
    options.trigger_offset_ms = 30.0;
    const TimedDrive drive = AdjustDrive(
        options, rig == RigPreset::kStereo ? 40 : 20, SoftRig::kTimeOffset);
    for (const SoftRigSensor& sensor : drive.timed.images.summary.sensors) {
      EXPECT_FALSE(sensor.readout_s.has_value());
      if (drive.simulation.scene.IsReference(sensor.sensor_idx)) {
        EXPECT_FALSE(sensor.time_offset_s.has_value());
        EXPECT_EQ(sensor.message, "");
        continue;
      }
      ASSERT_TRUE(sensor.time_offset_s.has_value()) << sensor.message;
      EXPECT_LT(*sensor.time_offset_sigma_s, 0.002);
      EXPECT_NEAR(*sensor.time_offset_s, 0.030,
                  4.0 * *sensor.time_offset_sigma_s);
    }
    EXPECT_LT(MeanError(drive.simulation, drive.timed.estimate),
              0.5 * MeanError(drive.simulation, drive.rigid));
  }
}

TEST(RigTimingTest, ReadoutTimesAreFound) {
  for (const double readout_ms : {0.0, 25.0}) {
    SimulationOptions options = DriveOptions(RigPreset::kStereo);
    options.readout_ms = readout_ms;
    const TimedDrive drive = AdjustDrive(options, 40, SoftRig::kReadout);
    for (const SoftRigSensor& sensor : drive.timed.images.summary.sensors) {
      EXPECT_FALSE(sensor.time_offset_s.has_value());
      ASSERT_TRUE(sensor.readout_s.has_value()) << sensor.message;
      EXPECT_LT(*sensor.readout_sigma_s, 0.003);
      EXPECT_NEAR(*sensor.readout_s, 1e-3 * readout_ms,
                  4.0 * *sensor.readout_sigma_s);
    }
    if (readout_ms == 0.0) continue;
    EXPECT_LT(MeanError(drive.simulation, drive.timed.estimate),
              MeanError(drive.simulation, drive.rigid));
  }
}

TEST(RigTimingTest, DelaysAndReadoutTimesAreSeparated) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = -20.0;
  options.readout_ms = 20.0;
  const TimedDrive drive = AdjustDrive(options, 40, SoftRig::kBoth);
  const auto& sensors = drive.timed.images.summary.sensors;
  ASSERT_EQ(sensors.size(), 2u);
  ASSERT_TRUE(sensors[1].time_offset_s && sensors[1].readout_s);
  EXPECT_NEAR(*sensors[1].time_offset_s, -0.020,
              4.0 * *sensors[1].time_offset_sigma_s);
  EXPECT_NEAR(*sensors[1].readout_s, 0.020, 4.0 * *sensors[1].readout_sigma_s);
}

// The times of images that are given need no estimate.
TEST(RigTimingTest, GivenTimesAreUsed) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = 30.0;
  Simulation simulation = Simulate(options, WindingPath(40));
  const Reconstruction rigid = AdjustRigid(simulation);
  const auto shift = [&](double time_s) {
    for (Image& image : simulation.scene.images) {
      if (!simulation.scene.IsReference(image.sensor_idx)) {
        *image.timestamp_s += time_s;
      }
    }
  };
  const auto times_matter = [&] {
    return TimesMatter(simulation.scene, TimesOf(simulation.scene), rigid,
                       Threads(2));
  };
  EXPECT_FALSE(times_matter());
  shift(1e-5);
  EXPECT_FALSE(times_matter());
  shift(0.030 - 1e-5);
  EXPECT_TRUE(times_matter());
  const SoftRigResult timed = Adjust(simulation, rigid, SoftRig::kAuto);
  ASSERT_TRUE(timed.images.summary.is_usable);
  for (const SoftRigSensor& sensor : timed.images.summary.sensors) {
    EXPECT_FALSE(sensor.time_offset_s || sensor.readout_s);
    EXPECT_EQ(sensor.message, "");
  }
  EXPECT_LT(MeanError(simulation, timed.estimate),
            0.5 * MeanError(simulation, rigid));
  const BundleAdjustmentOptions bundle_options;
  EXPECT_TRUE(ExplainsMore(simulation.scene, timed.estimate, rigid,
                           bundle_options, Threads(2)));
  // Wrong times explain less.
  shift(-0.060);
  const SoftRigResult wrong = Adjust(simulation, rigid, SoftRig::kAuto);
  EXPECT_FALSE(ExplainsMore(simulation.scene, wrong.estimate, rigid,
                            bundle_options, Threads(2)));
}

// Known sensor poses define the unit of length even if cameras trigger late.
TEST(RigTimingTest, KnownRigKeepsTheScale) {
  SimulationOptions options = DriveOptions(RigPreset::kKitti360);
  options.trigger_offset_ms = 30.0;
  options.extrinsics_are_known = true;
  const TimedDrive drive = AdjustDrive(options, 30, SoftRig::kTimeOffset);
  EXPECT_NEAR(PathLength(drive.timed.estimate) /
                  PathLength(drive.simulation.ground_truth),
              1.0, 0.01);
}

// Measured positions outweigh a known rig that is 5 % too large.
TEST(RigTimingTest, PositionsKeepTheScale) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = 30.0;
  options.extrinsics_are_known = true;
  Simulation simulation = Simulate(options, WindingPath(40));
  RefinementConditions conditions;
  auto& positions = conditions.priors.positions.images;
  positions.resize(simulation.scene.images.size());
  for (size_t i = 0; i < positions.size(); ++i) {
    if (!simulation.scene.IsReference(simulation.scene.images[i].sensor_idx)) {
      continue;
    }
    positions[i].emplace();
    positions[i]->position = simulation.cam_from_world[i].Center();
    positions[i]->covariance *= 1e-2;
  }
  simulation.scene.sensors[1].sensor_from_rig->translation *= 1.05;
  const SoftRigResult timed = Adjust(simulation, simulation.ground_truth,
                                     SoftRig::kTimeOffset, conditions);
  ASSERT_TRUE(timed.images.summary.is_usable);
  EXPECT_NEAR(PathLength(timed.estimate) / PathLength(simulation.ground_truth),
              1.0, 0.005);
}

TEST(RigTimingTest, StandingRigDeterminesNoTimes) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_offset_ms = 30.0;
  options.frame_step = 1;
  options.frame_rate_hz = kFrameRate;
  options.path = PathPreset::kStanding;
  options.num_frames = 20;
  const Simulation standing = Simulate(options);
  const SoftRigResult timed =
      Adjust(standing, AdjustRigid(standing), SoftRig::kBoth);
  ASSERT_TRUE(timed.images.summary.is_usable);
  for (const SoftRigSensor& sensor : timed.images.summary.sensors) {
    EXPECT_FALSE(sensor.time_offset_s || sensor.readout_s);
    EXPECT_NE(sensor.message, "");
  }
}

}  // namespace
}  // namespace mgsfm
