// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rotation_averaging/rotation_averaging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <numeric>

#include "base/random.h"
#include "estimation/rotation_averaging/rotation_test_utils.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using testing::HasSubstr;

Mask All(const ViewGraph& view_graph) {
  return Mask(view_graph.pairs.size(), true);
}

RotationResult Average(const Scene& scene, const ViewGraph& view_graph) {
  return AverageRotations({scene, view_graph, All(view_graph)},
                          RotationAveragingOptions(), Context());
}

RotationResult Average(const Simulation& simulation) {
  return Average(simulation.scene, simulation.view_graph);
}

class PresetTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset, bool>> {};

TEST_P(PresetTest, GroundTruthIsRecovered) {
  SimulationOptions options = SmallSimulation();
  options.rig = std::get<0>(GetParam());
  options.path = std::get<1>(GetParam());
  options.extrinsics_are_known = std::get<2>(GetParam());
  const Simulation simulation = Simulate(options);
  const RotationResult result = Average(simulation);
  const RotationEstimate& estimate = result.estimate;
  EXPECT_EQ(NumFramesWithRotation(estimate), options.num_frames);
  EXPECT_EQ(result.summary.num_components, 1);
  EXPECT_LT(MaxFrameErrorDeg(simulation, estimate), 1e-6);
  EXPECT_LT(MaxSensorErrorDeg(simulation, estimate), 1e-6);
  for (size_t k = 0; k < simulation.scene.sensors.size(); ++k) {
    EXPECT_TRUE(estimate.sensor_from_rig[k].has_value())
        << result.summary.sensors[k].message;
    EXPECT_TRUE(result.summary.sensors[k].is_observable);
    EXPECT_FALSE(result.summary.sensors[k].message.empty());
  }
  for (const char is_inlier : estimate.pair_is_inlier) EXPECT_TRUE(is_inlier);
  EXPECT_EQ(result.summary.num_pairs_dropped, 0);
  EXPECT_LT(result.summary.median_error_deg.value(), 1e-6);
  for (const SolveSummary* solve :
       {&result.summary.images, &result.summary.frames,
        &result.summary.joint}) {
    EXPECT_EQ(solve->termination, Termination::kConverged) << solve->message;
  }
}

INSTANTIATE_TEST_SUITE_P(
    AllPresets, PresetTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kLoop, PathPreset::kCurve,
                                     PathPreset::kStraight,
                                     PathPreset::kStanding),
                     testing::Bool()));

// Averaging many pairs must make the error smaller than that of one pair.
TEST(RotationAveraging, NoiseIsAveragedOut) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kCube6;
  options.path = PathPreset::kLoop;
  options.relative_rotation_noise_deg = 0.5;
  const Simulation simulation = Simulate(options);
  const RotationEstimate estimate = Average(simulation).estimate;
  EXPECT_LT(MaxFrameErrorDeg(simulation, estimate), 0.5);
  EXPECT_LT(MaxSensorErrorDeg(simulation, estimate), 0.3);
}

TEST(RotationAveraging, WrongPairsAreFound) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kCube6}) {
    SimulationOptions options = SmallSimulation();
    options.rig = rig;
    options.relative_rotation_noise_deg = 0.2;
    options.wrong_pair_ratio = 0.3;
    const Simulation simulation = Simulate(options);
    const RotationResult result = Average(simulation);
    EXPECT_EQ(NumFramesWithRotation(result.estimate), options.num_frames);
    EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1.0);
    EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 0.5);
    // Few wrong pairs are off by less than max_error_deg.
    const double dropped =
        static_cast<double>(result.summary.num_pairs_dropped) /
        static_cast<double>(simulation.view_graph.pairs.size());
    EXPECT_GT(dropped, 0.24);
    EXPECT_LT(dropped, 0.36);
  }
}

// Wrong pairs that have as many matches as right ones enter spanning trees.
TEST(RotationAveraging, StrongWrongPairsAreFound) {
  SimulationOptions options = SmallSimulation();
  options.relative_rotation_noise_deg = 0.2;
  options.num_matched_frames = 4;
  Simulation simulation = Simulate(options);
  Random random(1);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    if (random.Uniform() > 0.2) continue;
    pair.relative_pose->cam2_from_cam1 =
        ExpSO3({random.Normal(), random.Normal(), random.Normal()});
  }
  const RotationResult result = Average(simulation);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1.0);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 0.5);
}

// A sensor that never overlaps with the others in a frame, but sees what they
// saw at other times.
TEST(RotationAveraging, SensorLinkedAcrossTimeOnly) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kKitti360;
  Simulation simulation = Simulate(options);
  KeepPairs(&simulation, [](const Image& a, const Image& b) {
    return a.sensor_idx == b.sensor_idx || a.frame_idx != b.frame_idx;
  });
  const RotationResult result = Average(simulation);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1e-6);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-6);
  EXPECT_GT(result.summary.sensors[2].num_samples, 0);
}

// No pairs between different sensors at all: only the common motion tells.
TEST(RotationAveraging, HandEyeCalibrationFindsUnlinkedSensors) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kKitti360;
  options.num_frames = 60;
  options.match_different_sensors = false;
  const Simulation simulation = Simulate(options);
  const RotationResult result = Average(simulation);
  for (const SensorRotationSummary& sensor : result.summary.sensors) {
    EXPECT_TRUE(sensor.is_observable) << sensor.message;
  }
  EXPECT_THAT(result.summary.sensors[3].message, HasSubstr("hand-eye"));
  EXPECT_EQ(result.summary.num_components, 1);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1e-6);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-6);
}

TEST(RotationAveraging, HandEyeCalibrationUnderNoise) {
  SimulationOptions options = SmallSimulation();
  options.num_frames = 100;
  options.match_different_sensors = false;
  options.relative_rotation_noise_deg = 0.05;
  const Simulation simulation = Simulate(options);
  const RotationResult result = Average(simulation);
  ASSERT_TRUE(result.estimate.sensor_from_rig[1].has_value());
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1.0);
}

TEST(RotationAveraging, UnlinkedSensorOnAStraightPathIsNotObservable) {
  SimulationOptions options = SmallSimulation();
  options.path = PathPreset::kStraight;
  options.match_different_sensors = false;
  options.relative_rotation_noise_deg = 0.05;
  const Simulation simulation = Simulate(options);
  std::vector<std::string> warnings;
  Context context;
  context.log = [&](LogLevel level, const std::string& message) {
    if (level == LogLevel::kWarning) warnings.push_back(message);
  };
  const RotationResult result = AverageRotations(
      {simulation.scene, simulation.view_graph, All(simulation.view_graph)},
      RotationAveragingOptions(), context);
  EXPECT_FALSE(result.estimate.sensor_from_rig[1].has_value());
  EXPECT_FALSE(result.summary.sensors[1].is_observable);
  EXPECT_THAT(result.summary.sensors[1].message, HasSubstr("not observable"));
  EXPECT_EQ(warnings.size(), 1u);
  EXPECT_GT(result.summary.num_pairs_unobservable, 0);
  // The other sensor has its frames all the same.
  EXPECT_EQ(NumFramesWithRotation(result.estimate), options.num_frames);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 0.5);
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    EXPECT_EQ(
        result.estimate.CamFromWorld(simulation.scene, image_idx).has_value(),
        simulation.scene.images[i].sensor_idx == 0);
  }
}

// A rig on a circle in a plane rotates about one axis only.
TEST(RotationAveraging, UnlinkedSensorOnAPlanarLoopIsNotObservable) {
  SimulationOptions options = SmallSimulation();
  options.path = PathPreset::kLoop;
  options.match_different_sensors = false;
  const RotationResult result = Average(Simulate(options));
  EXPECT_FALSE(result.estimate.sensor_from_rig[1].has_value());
}

TEST(RotationAveraging, ComponentsShareSensorRotations) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kCube6;
  options.num_frames = 30;
  Simulation simulation = Simulate(options);
  // Frames 0 to 11 and 12 to 29; no pair within a frame in the first
  // component.
  KeepPairs(&simulation, [](const Image& a, const Image& b) {
    const bool is_first = a.frame_idx < 12;
    return is_first == (b.frame_idx < 12) &&
           !(is_first && a.sensor_idx != b.sensor_idx);
  });
  const RotationResult result = Average(simulation);
  EXPECT_EQ(result.summary.num_components, 2);
  for (int frame = 0; frame < 30; ++frame) {
    EXPECT_EQ(result.estimate.component[frame], frame < 12 ? 1 : 0);
  }
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate, 0), 1e-6);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate, 1), 1e-6);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-6);
}

TEST(RotationAveraging, FramesWithoutReferenceImage) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kCube6;
  options.missing_image_ratio = 0.3;
  options.random_seed = 5;
  Simulation simulation = Simulate(options);
  // Sensor 0 is the reference: only a third of the frames keep its image.
  KeepPairs(&simulation, [](const Image& a, const Image& b) {
    return (a.sensor_idx != 0 || a.frame_idx % 3 == 0) &&
           (b.sensor_idx != 0 || b.frame_idx % 3 == 0);
  });
  const RotationResult result = Average(simulation);
  EXPECT_EQ(NumFramesWithRotation(result.estimate),
            static_cast<int>(simulation.scene.frames.size()));
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1e-6);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-6);
}

// The samples of one sensor come through another that is not the reference.
TEST(RotationAveraging, SensorsAreChainedThroughOthers) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kCube6;
  Simulation simulation = Simulate(options);
  // Sensors 0, 1, 2 meet in the first frames, 2, 3, 4, 5 in the others, so that
  // 3, 4 and 5 share no connected component with the reference.
  KeepPairs(&simulation, [](const Image& a, const Image& b) {
    const auto is_first = [](const Image& image) {
      return image.frame_idx < 12 && image.sensor_idx <= 2;
    };
    const auto is_second = [](const Image& image) {
      return image.frame_idx >= 12 && image.sensor_idx >= 2;
    };
    return (is_first(a) && is_first(b)) || (is_second(a) && is_second(b));
  });
  const RotationResult result = Average(simulation);
  EXPECT_EQ(result.summary.num_components, 2);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-6);
  for (const SensorRotationSummary& sensor : result.summary.sensors) {
    EXPECT_TRUE(sensor.is_observable) << sensor.message;
  }
}

TEST(RotationAveraging, KnownSensorRotationsStay) {
  SimulationOptions options = SmallSimulation();
  options.relative_rotation_noise_deg = 1.0;
  options.extrinsics_are_known = true;
  const Simulation simulation = Simulate(options);
  const RotationResult result = Average(simulation);
  EXPECT_LT(MaxSensorErrorDeg(simulation, result.estimate), 1e-12);
}

TEST(RotationAveraging, PairsWithoutRelativePoseAreIgnored) {
  Simulation simulation = Simulate(SmallSimulation());
  auto& pairs = simulation.view_graph.pairs;
  for (size_t i = 0; i < pairs.size(); i += 4) pairs[i].relative_pose.reset();
  const RotationResult result = Average(simulation);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1e-6);
  EXPECT_EQ(result.summary.num_pairs_without_rotation,
            static_cast<int>((pairs.size() + 3) / 4));
  for (size_t i = 0; i < pairs.size(); ++i) {
    EXPECT_EQ(result.estimate.pair_is_inlier[i], i % 4 == 0 ? 0 : 1);
  }
}

// Two halves joined by two pairs that contradict each other and all else: no
// pair that is kept may connect frames whose rotations do not fit together.
TEST(RotationAveraging, ConnectivityIsCheckedAfterFilters) {
  SimulationOptions options = SmallSimulation();
  options.num_frames = 20;
  Simulation simulation = Simulate(options);
  KeepPairs(&simulation, [](const Image& a, const Image& b) {
    return (a.frame_idx < 10) == (b.frame_idx < 10);
  });
  for (int i = 0; i < 3; ++i) {
    ImagePair pair;
    pair.image_idx1 = 7 + i;
    pair.image_idx2 = 12 + i;
    pair.matches.resize(15);
    pair.relative_pose =
        RelativePose{ExpSO3(1.5 * Vector3d::Unit(i)), std::nullopt};
    simulation.view_graph.pairs.push_back(pair);
  }
  const RotationResult result = Average(simulation);
  const auto& pairs = simulation.view_graph.pairs;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!result.estimate.pair_is_inlier[i]) continue;
    const auto cam1 =
        result.estimate.CamFromWorld(simulation.scene, pairs[i].image_idx1);
    const auto cam2 =
        result.estimate.CamFromWorld(simulation.scene, pairs[i].image_idx2);
    ASSERT_TRUE(cam1 && cam2);
    EXPECT_LE(RadToDeg(AngleBetween(*cam2 * cam1->conjugate(),
                                    pairs[i].relative_pose->cam2_from_cam1)),
              RotationAveragingOptions().max_error_deg);
    EXPECT_EQ(
        result.estimate
            .component[simulation.scene.images[pairs[i].image_idx1].frame_idx],
        result.estimate
            .component[simulation.scene.images[pairs[i].image_idx2].frame_idx]);
  }
  EXPECT_EQ(NumFramesWithRotation(result.estimate), 20);
}

TEST(RotationAveraging, FrameWithOnlyWrongPairsHasNoRotation) {
  SimulationOptions options = SmallSimulation();
  Simulation simulation = Simulate(options);
  Random random(6);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    const auto& images = simulation.scene.images;
    const int frame1 = images[pair.image_idx1].frame_idx;
    const int frame2 = images[pair.image_idx2].frame_idx;
    if (frame1 == frame2 || (frame1 != 5 && frame2 != 5)) continue;
    pair.relative_pose.reset();
  }
  const RotationResult result = Average(simulation);
  EXPECT_FALSE(result.estimate.rig_from_world[5].has_value());
  EXPECT_FALSE(result.estimate.component[5].has_value());
  for (size_t i = 0; i < simulation.view_graph.pairs.size(); ++i) {
    const ImagePair& pair = simulation.view_graph.pairs[i];
    if (simulation.scene.images[pair.image_idx1].frame_idx == 5) {
      EXPECT_FALSE(result.estimate.pair_is_inlier[i]);
    }
  }
}

// All arrays in another order, as if the images had other names.
TEST(RotationAveraging, OrderDoesNotMatter) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kKitti360;
  options.relative_rotation_noise_deg = 0.2;
  options.wrong_pair_ratio = 0.2;
  const Simulation original = Simulate(options);
  Scene scene = original.scene;
  const int num_images = static_cast<int>(scene.images.size());
  const int num_frames = static_cast<int>(scene.frames.size());
  const auto new_image = [&](int i) { return (7 * i + 3) % num_images; };
  const auto new_frame = [&](int f) { return num_frames - 1 - f; };
  for (int f = 0; f < num_frames; ++f) {
    Frame& frame = scene.frames[new_frame(f)];
    frame = original.scene.frames[f];
    for (int& image_idx : frame.image_idxs) image_idx = new_image(image_idx);
  }
  for (int i = 0; i < num_images; ++i) {
    scene.images[new_image(i)] = original.scene.images[i];
    scene.images[new_image(i)].frame_idx =
        new_frame(original.scene.images[i].frame_idx);
  }
  ASSERT_NE(num_images % 7, 0);
  ViewGraph view_graph;
  for (ImagePair pair : original.view_graph.pairs) {
    pair.image_idx1 = new_image(pair.image_idx1);
    pair.image_idx2 = new_image(pair.image_idx2);
    if (pair.image_idx1 > pair.image_idx2) {
      std::swap(pair.image_idx1, pair.image_idx2);
      pair.relative_pose->cam2_from_cam1 =
          pair.relative_pose->cam2_from_cam1.conjugate();
    }
    view_graph.pairs.push_back(pair);
  }
  const RotationEstimate a = Average(original).estimate;
  const RotationEstimate b = Average(scene, view_graph).estimate;
  const Quaterniond world =
      a.rig_from_world[0]->conjugate() * *b.rig_from_world[new_frame(0)];
  for (int f = 0; f < num_frames; ++f) {
    EXPECT_LT(RadToDeg(AngleBetween(*b.rig_from_world[new_frame(f)],
                                    *a.rig_from_world[f] * world)),
              1e-3);
  }
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    EXPECT_LT(
        RadToDeg(AngleBetween(*a.sensor_from_rig[k], *b.sensor_from_rig[k])),
        1e-3);
  }
}

TEST(RotationAveraging, IsRepeatable) {
  SimulationOptions options = SmallSimulation();
  options.relative_rotation_noise_deg = 0.3;
  options.wrong_pair_ratio = 0.2;
  const Simulation simulation = Simulate(options);
  const RotationEstimate a = Average(simulation).estimate;
  const RotationEstimate b = Average(simulation).estimate;
  for (size_t f = 0; f < a.rig_from_world.size(); ++f) {
    EXPECT_EQ(a.rig_from_world[f]->coeffs(), b.rig_from_world[f]->coeffs());
  }
}

// Without relative poses there is nothing to average; a sensor is not to blame.
TEST(RotationAveraging, ViewGraphsWithoutRelativePosesAreRejected) {
  Simulation simulation = Simulate(SmallSimulation());
  const auto expect_error = [&](const Mask& pair_is_used, const char* count) {
    try {
      const RotationResult result = AverageRotations(
          {simulation.scene, simulation.view_graph, pair_is_used},
          RotationAveragingOptions(), Context());
      ADD_FAILURE() << "no error";
    } catch (const Error& error) {
      EXPECT_THAT(error.what(),
                  testing::AllOf(HasSubstr("relative pose"), HasSubstr(count),
                                 HasSubstr("EstimateViewGraph")));
    }
  };
  const size_t num_pairs = simulation.view_graph.pairs.size();
  expect_error(Mask(num_pairs, false), "none of the 0 ");
  for (ImagePair& pair : simulation.view_graph.pairs) {
    pair.relative_pose.reset();
  }
  expect_error(Mask(num_pairs, true), std::to_string(num_pairs).c_str());
  simulation.view_graph.pairs.clear();
  expect_error({}, "none of the 0 ");
}

// Averaging with a start stays at the start where pairs permit it, and pairs
// that are not used do not matter.
TEST(RotationAveraging, UsesItsPairsAndItsStart) {
  SimulationOptions options = SmallSimulation();
  options.relative_rotation_noise_deg = 0.2;
  options.wrong_pair_ratio = 0.3;
  const Simulation simulation = Simulate(options);
  Mask is_right(simulation.view_graph.pairs.size());
  for (size_t i = 0; i < is_right.size(); ++i) {
    const ImagePair& pair = simulation.view_graph.pairs[i];
    const Quaterniond truth =
        simulation.cam_from_world[pair.image_idx2].rotation *
        simulation.cam_from_world[pair.image_idx1].rotation.conjugate();
    is_right[i] =
        AngleBetween(pair.relative_pose->cam2_from_cam1, truth) < DegToRad(2.0);
  }
  const auto average = [&](const Mask& pair_is_used,
                           const RotationEstimate* start) {
    return AverageRotations(
        {simulation.scene, simulation.view_graph, pair_is_used, start},
        RotationAveragingOptions(), Context());
  };
  const RotationResult right = average(is_right, nullptr);
  for (size_t i = 0; i < is_right.size(); ++i) {
    EXPECT_LE(right.estimate.pair_is_inlier[i], is_right[i]);
  }
  const RotationResult all =
      average(All(simulation.view_graph), &right.estimate);
  EXPECT_THAT(all.summary.images.message, testing::Not(HasSubstr("L1 step")));
  EXPECT_LT(MaxFrameErrorDeg(simulation, right.estimate), 0.5);
  EXPECT_LT(MaxFrameErrorDeg(simulation, all.estimate), 0.5);
}

}  // namespace
}  // namespace mgsfm
