// SPDX-License-Identifier: BSD-3-Clause
// Vehicles that stay at a constant distance, weak cuts, and the presets with
// both.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/detection.h"
#include "simulator/road.h"
#include "simulator/weak_cuts.h"

namespace mgsfm {
namespace {

// 3 m between frames, with sharp turns.
std::vector<Rigid3> WindingPath(int num_frames = 150) {
  std::vector<Rigid3> path;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double yaw = 0.0;
  for (int i = 0; i < num_frames; ++i) {
    const int phase = i % 50;
    if (phase >= 40) yaw += (i / 50 % 2 == 0 ? 1.0 : -1.0) * DegToRad(9.0);
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0));
    path.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    center += 3.0 * (world_from_rig * Eigen::Vector3d::UnitZ());
  }
  return path;
}

SimulationInput WindingInput() {
  SimulationInput input;
  input.rig_from_world_path = WindingPath();
  return input;
}

// The position in the drive, as no frame of these tests is missing.
int FrameOf(const Simulation& simulation, int image_idx) {
  return simulation.scene.images[image_idx].frame_idx;
}

int NumCorrect(const Simulation& simulation, const ImagePair& pair) {
  return static_cast<int>(std::count_if(
      pair.matches.begin(), pair.matches.end(), [&](const Match& match) {
        const int point =
            simulation.keypoint_points[pair.image_idx1][match.keypoint_idx1];
        return point >= 0 &&
               point ==
                   simulation
                       .keypoint_points[pair.image_idx2][match.keypoint_idx2];
      }));
}

// The correct pairs of neighboring frames across each cut.
struct CutStatistics {
  std::vector<int> num_pairs, num_matches;
};

CutStatistics CountAcrossCuts(const Simulation& simulation) {
  const size_t num_frames = simulation.scene.frames.size();
  CutStatistics cuts{std::vector<int>(num_frames, 0),
                     std::vector<int>(num_frames, 0)};
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kTrue) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    const auto [begin, end] =
        std::minmax({FrameOf(simulation, pair.image_idx1),
                     FrameOf(simulation, pair.image_idx2)});
    if (end - begin > 10) continue;
    for (int cut = begin; cut < end; ++cut) {
      ++cuts.num_pairs[cut];
      cuts.num_matches[cut] += NumCorrect(simulation, pair);
    }
  }
  return cuts;
}

double ShareOnVehicles(const std::vector<int>& points) {
  return static_cast<double>(std::count(points.begin(), points.end(), -1)) /
         static_cast<double>(points.size());
}

TEST(HardPresetsTest, ConvoysFillImagesForTensOfFrames) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.clutter_ratio = 0.0;
  options.convoy_ratio = 0.45;
  const Simulation simulation = Simulate(options, WindingPath());
  double sum = 0.0, max = 0.0;
  for (const std::vector<int>& points : simulation.keypoint_points) {
    sum += ShareOnVehicles(points);
    max = std::max(max, ShareOnVehicles(points));
  }
  EXPECT_GT(max, 0.4);
  EXPECT_LE(max, 0.45 + 1e-9);
  const double mean = sum / simulation.keypoint_points.size();
  EXPECT_GT(mean, 0.05);
  EXPECT_LT(mean, 0.3);
}

TEST(HardPresetsTest, ConvoysKeepTheirDistance) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.convoy_ratio = 0.6;
  const Drive drive = MakeDrive(options, WindingInput());
  const Road road(drive, 100);
  const Vehicles vehicles(options, road, drive);
  std::vector<std::vector<double>> distances(vehicles.size());
  for (int frame = 0; frame < drive.num_frames(); ++frame) {
    const double time_s = drive.TimeOfFrame(frame);
    const auto convoy = vehicles.ConvoyAt(time_s);
    if (!convoy) continue;
    distances[*convoy].push_back(
        (drive.PoseOfFrame(frame) * vehicles.WorldFromVehicle(*convoy, time_s))
            .translation.norm());
  }
  ASSERT_GE(distances.size(), 2u);
  for (const std::vector<double>& some : distances) {
    ASSERT_FALSE(some.empty());
    EXPECT_LE(some.size(), 61u);
    const auto [min, max] = std::minmax_element(some.begin(), some.end());
    // At most 0.3 m/s for 60 frames of 0.1 s, and the chords of turns.
    EXPECT_LT(*max - *min, 0.3 * 6.0 + 0.2 * *max);
    EXPECT_GT(*min, 3.0);
    EXPECT_LT(*max, 17.0);
  }
}

// The relative pose of a pair is that of the motion that most of its matches
// follow, whether it is that of the world or not.
TEST(HardPresetsTest, PairsFollowTheDominantMotion) {
  const SimulationOptions options = HardSimulation(RigPreset::kKitti360);
  const Simulation simulation = Simulate(options, WindingPath());
  const Bearings bearings = ComputeBearings(simulation.scene, 1);
  int num_on_vehicles = 0;
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kMovingObject) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    ++num_on_vehicles;
    Rigid3 truth = simulation.cam_from_world[pair.image_idx2] *
                   simulation.cam_from_world[pair.image_idx1].Inverse();
    truth.translation.normalize();
    const double max_error_rad =
        options.max_verification_error_px /
        PixelsPerRadian(CameraModelId::kPinhole,
                        simulation.scene.cameras[0].params.data());
    int num_follow_world = 0;
    for (const Match& match : AllMatches(pair)) {
      num_follow_world +=
          std::abs(SampsonAngle(
              truth, bearings.Ray(pair.image_idx1, match.keypoint_idx1),
              bearings.Ray(pair.image_idx2, match.keypoint_idx2))) <
                  0.5 * max_error_rad
              ? 1
              : 0;
    }
    EXPECT_GT(static_cast<int>(pair.matches.size()), num_follow_world);
  }
  EXPECT_GT(num_on_vehicles, 100);
}

TEST(HardPresetsTest, FewCorrectMatchesCrossWeakCuts) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = HardSimulation(rig);
    options.missing_image_ratio = 0.0;
    options.convoy_ratio = 0.0;
    options.weak_cut_spacing = 30;
    const Simulation simulation = Simulate(options, WindingPath());
    const CutStatistics cuts = CountAcrossCuts(simulation);
    const std::vector<int> weak =
        PlanWeakCuts(options, MakeDrive(options, WindingInput()));
    ASSERT_GE(weak.size(), 3u);
    std::vector<int> sorted = cuts.num_matches;
    std::sort(sorted.begin(), sorted.end());
    int fewest = sorted.back();
    for (const int cut : weak) {
      EXPECT_GT(cuts.num_matches[cut], 0.6 * options.min_num_weak_cut_matches);
      EXPECT_LT(4 * cuts.num_matches[cut], sorted[sorted.size() / 2]);
      fewest = std::min(fewest, cuts.num_matches[cut]);
    }
    // Pairs with few correct matches, but enough inliers, add to the number.
    EXPECT_LT(fewest, 2.0 * options.max_num_weak_cut_matches);
  }
}

TEST(HardPresetsTest, CorrectPairsConnectAllFrames) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = HardSimulation(rig);
    options.missing_image_ratio = 0.0;
    const CutStatistics cuts =
        CountAcrossCuts(Simulate(options, WindingPath()));
    for (size_t cut = 0; cut + 1 < cuts.num_pairs.size(); ++cut) {
      EXPECT_GE(cuts.num_pairs[cut], 2) << "after frame " << cut;
    }
  }
}

TEST(HardPresetsTest, ThreadsChangeNothing) {
  const SimulationOptions options = HardSimulation(RigPreset::kKitti360);
  Context context;
  const Simulation one = Simulate(options, WindingPath(), context);
  context.num_threads = 3;
  const Simulation three = Simulate(options, WindingPath(), context);
  EXPECT_EQ(one.pair_kinds, three.pair_kinds);
  EXPECT_EQ(one.keypoint_points, three.keypoint_points);
  ASSERT_EQ(one.view_graph.pairs.size(), three.view_graph.pairs.size());
  for (size_t i = 0; i < one.view_graph.pairs.size(); ++i) {
    EXPECT_EQ(one.view_graph.pairs[i].E, three.view_graph.pairs[i].E);
  }
}

}  // namespace
}  // namespace mgsfm
