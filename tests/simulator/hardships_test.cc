// SPDX-License-Identifier: BSD-3-Clause
// Each degradation of the simulator in isolation.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/match_statistics.h"

namespace mgsfm {
namespace {

// 60 frames, 2 m apart, along a street and around a bend.
std::vector<Rigid3> Drive(int num_frames = 60) {
  std::vector<Rigid3> path;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (int i = 0; i < num_frames; ++i) {
    const double yaw = std::clamp((i - 30) / 15.0, 0.0, 1.0);
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0));
    path.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    center += 2.0 * (world_from_rig * Eigen::Vector3d::UnitZ());
  }
  return path;
}

int NumOfKind(const Simulation& simulation, PairKind kind) {
  return static_cast<int>(std::count(simulation.pair_kinds.begin(),
                                     simulation.pair_kinds.end(), kind));
}

int PointOf(const Simulation& simulation, int image_idx, uint32_t keypoint) {
  return simulation.keypoint_points[image_idx][keypoint];
}

bool HaveEqualMatches(const std::vector<Match>& a,
                      const std::vector<Match>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const Match& x, const Match& y) {
                      return x.keypoint_idx1 == y.keypoint_idx1 &&
                             x.keypoint_idx2 == y.keypoint_idx2;
                    });
}

bool AreEqual(const Simulation& a, const Simulation& b) {
  bool is_equal = a.scene.images.size() == b.scene.images.size() &&
                  a.view_graph.pairs.size() == b.view_graph.pairs.size() &&
                  a.pair_kinds == b.pair_kinds &&
                  a.keypoint_points == b.keypoint_points;
  for (size_t i = 0; is_equal && i < a.scene.images.size(); ++i) {
    is_equal = a.scene.images[i].keypoints_px == b.scene.images[i].keypoints_px;
  }
  for (size_t i = 0; is_equal && i < a.view_graph.pairs.size(); ++i) {
    const ImagePair& pair1 = a.view_graph.pairs[i];
    const ImagePair& pair2 = b.view_graph.pairs[i];
    is_equal = pair1.image_idx1 == pair2.image_idx1 &&
               pair1.image_idx2 == pair2.image_idx2 && pair1.E == pair2.E &&
               HaveEqualMatches(pair1.matches, pair2.matches);
  }
  return is_equal;
}

TEST(HardshipsTest, ThreadsChangeNothing) {
  const SimulationOptions options = AliasedSimulation(RigPreset::kKitti360);
  Context context;
  const Simulation one = Simulate(options, Drive(40), context);
  context.num_threads = 3;
  EXPECT_TRUE(AreEqual(one, Simulate(options, Drive(40), context)));
}

// Keypoints and their points by the names of the images.
using Sights = std::map<std::string, std::map<int, Eigen::Vector2f>>;

Sights SightsOf(const Simulation& simulation) {
  Sights sights;
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const Image& image = simulation.scene.images[i];
    for (size_t j = 0; j < image.keypoints_px.size(); ++j) {
      const int point = simulation.keypoint_points[i][j];
      if (point >= 0) sights[image.name][point] = image.keypoints_px[j];
    }
  }
  return sights;
}

// All keypoints of the simulation with an effect also exist, with the same
// coordinates, without it.
void ExpectSightsStay(const std::function<void(SimulationOptions*)>& change) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.7;
  const Sights without = SightsOf(Simulate(options, Drive()));
  change(&options);
  const Sights with = SightsOf(Simulate(options, Drive()));
  size_t num_same = 0;
  for (const auto& [name, points] : with) {
    const auto& points_without = without.at(name);
    for (const auto& [point, pixel] : points) {
      const auto found = points_without.find(point);
      ASSERT_NE(found, points_without.end());
      EXPECT_EQ(found->second, pixel);
      ++num_same;
    }
  }
  EXPECT_GT(num_same, 10000u);
}

TEST(HardshipsTest, MissingImagesLeaveTheOthersAlone) {
  ExpectSightsStay([](SimulationOptions* o) { o->missing_image_ratio = 0.3; });
}

TEST(HardshipsTest, VehiclesLeaveWhatIsSeenAlone) {
  ExpectSightsStay([](SimulationOptions* o) { o->moving_feature_ratio = 0.1; });
}

TEST(HardshipsTest, WrongMatchesAndPairsLeaveWhatIsSeenAlone) {
  ExpectSightsStay([](SimulationOptions* o) {
    o->mismatch_ratio = 0.2;
    o->epipolar_outlier_ratio = 0.05;
    o->isolated_wrong_pair_ratio = 0.1;
  });
}

TEST(HardshipsTest, OneKindOfWrongMatchesLeavesTheOtherAlone) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.mismatch_ratio = 0.2;
  const Simulation without = Simulate(options, Drive(20));
  options.isolated_wrong_pair_ratio = 0.1;
  const Simulation with = Simulate(options, Drive(20));
  size_t num_true = 0;
  for (size_t i = 0; i < with.pair_kinds.size(); ++i) {
    if (with.pair_kinds[i] != PairKind::kTrue) continue;
    ASSERT_LT(num_true, without.view_graph.pairs.size());
    EXPECT_TRUE(
        HaveEqualMatches(AllMatches(with.view_graph.pairs[i]),
                         AllMatches(without.view_graph.pairs[num_true])));
    ++num_true;
  }
  EXPECT_EQ(num_true, without.view_graph.pairs.size());
}

// The distances of all keypoints from their true place.
std::vector<double> KeypointErrorsOf(const Simulation& simulation) {
  std::vector<double> errors;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      const Image& image = simulation.scene.images[o.image_idx];
      const Camera& camera = simulation.scene.cameras[image.camera_idx];
      const auto pixel = ProjectToPixel(
          camera.model, camera.params.data(),
          simulation.cam_from_world[o.image_idx] * point.point_in_world);
      errors.push_back(
          (pixel.value() - image.keypoints_px[o.keypoint_idx].cast<double>())
              .norm());
    }
  }
  return errors;
}

TEST(HardshipsTest, NoiseHasTheStandardDeviationAskedFor) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.7;
  const std::vector<double> errors =
      KeypointErrorsOf(Simulate(options, Drive(20)));
  double sum = 0.0;
  for (const double error : errors) sum += error * error;
  EXPECT_NEAR(std::sqrt(sum / (2.0 * errors.size())), 0.7, 0.02);
}

// The norm of a vector of Student's t distribution with nu degrees of freedom
// and scale s exceeds e with the probability (1 + e^2 / (nu s^2))^(-nu / 2).
TEST(HardshipsTest, NoiseHasTheTailsAskedFor) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.5;
  options.keypoint_noise_tail = 0.2;
  const std::vector<double> errors =
      KeypointErrorsOf(Simulate(options, Drive(60)));
  for (const double error : {0.5, 1.0, 2.0, 4.0}) {
    constexpr int kNumScales = 10000;
    double expected = 0.0;
    for (int i = 0; i < kNumScales; ++i) {
      const double scale =
          std::min(8.0, 1.0 / std::sqrt((i + 0.5) / kNumScales));
      const double normalized = error / (options.pixel_noise_px * scale);
      expected += std::pow(1.0 + normalized * normalized / 5.0, -2.5);
    }
    const auto num_larger =
        std::count_if(errors.begin(), errors.end(),
                      [&](double value) { return value > error; });
    EXPECT_NEAR(num_larger / static_cast<double>(errors.size()),
                expected / kNumScales, 0.02)
        << error;
  }
}

TEST(HardshipsTest, FewMismatchesPassVerificationAndEpipolarOutliersDo) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  const auto wrong_shares = [&options] {
    const Simulation simulation = Simulate(options, Drive(30));
    double num_raw = 0.0, num_wrong_raw = 0.0, num = 0.0, num_wrong = 0.0;
    for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
      const ImagePair& pair = simulation.view_graph.pairs[i];
      const auto is_wrong = [&](const Match& match) {
        return PointOf(simulation, pair.image_idx1, match.keypoint_idx1) !=
               PointOf(simulation, pair.image_idx2, match.keypoint_idx2);
      };
      const std::vector<Match> raw = AllMatches(pair);
      num_raw += raw.size();
      num_wrong_raw += std::count_if(raw.begin(), raw.end(), is_wrong);
      num += pair.matches.size();
      num_wrong +=
          std::count_if(pair.matches.begin(), pair.matches.end(), is_wrong);
    }
    return std::make_pair(num_wrong_raw / num_raw, num_wrong / num);
  };
  options.mismatch_ratio = 0.2;
  const auto [raw_mismatches, mismatches] = wrong_shares();
  EXPECT_NEAR(raw_mismatches, 0.2, 0.02);
  EXPECT_LT(mismatches, 0.03);
  options.mismatch_ratio = 0.0;
  options.epipolar_outlier_ratio = 0.1;
  const auto [raw_outliers, outliers] = wrong_shares();
  EXPECT_NEAR(raw_outliers, 0.1, 0.03);
  EXPECT_NEAR(outliers, raw_outliers, 1e-3);
}

TEST(HardshipsTest, VehiclesHaveTheirShareOfTheFeatures) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.clutter_ratio = 0.0;
  options.moving_feature_ratio = 0.1;
  const Simulation simulation = Simulate(options, Drive());
  double num_moving = 0.0, num = 0.0;
  for (const std::vector<int>& points : simulation.keypoint_points) {
    num_moving += std::count(points.begin(), points.end(), -1);
    num += points.size();
  }
  EXPECT_LT(num_moving / num, 0.1 + 1e-3);
  EXPECT_GT(num_moving / num, 0.03);
}

TEST(HardshipsTest, AVehicleThatFillsTheViewIsTakenForTheWorld) {
  SimulationOptions options = StreetSimulation(RigPreset::kMono);
  options.max_num_features_per_image = 600;
  options.moving_feature_ratio = 0.9;
  const Simulation simulation = Simulate(options, Drive());
  ASSERT_GT(NumOfKind(simulation, PairKind::kMovingObject), 10);
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kMovingObject) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    const auto num_on_vehicles = std::count_if(
        pair.matches.begin(), pair.matches.end(), [&](const Match& match) {
          return PointOf(simulation, pair.image_idx1, match.keypoint_idx1) < 0;
        });
    EXPECT_GT(3 * num_on_vehicles, static_cast<int>(pair.matches.size()));
  }
}

// Expects that the epipolar errors of all matches are below the bound.
void ExpectEpipolarErrors(const Bearings& bearings, const ImagePair& pair,
                          double bound_rad) {
  const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                    pair.relative_pose->translation_direction.value()};
  for (const Match& match : pair.matches) {
    EXPECT_LT(std::abs(SampsonAngle(
                  pose, bearings.Ray(pair.image_idx1, match.keypoint_idx1),
                  bearings.Ray(pair.image_idx2, match.keypoint_idx2))),
              bound_rad);
  }
}

TEST(HardshipsTest, IsolatedWrongPairsAreConsistentAndPlausible) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.7;
  options.isolated_wrong_pair_ratio = 0.05;
  const Simulation simulation = Simulate(options, Drive());
  const int num_wrong = NumOfKind(simulation, PairKind::kIsolatedWrong);
  EXPECT_NEAR(num_wrong, 0.05 * simulation.pair_kinds.size(), 1.0);
  const Bearings bearings = ComputeBearings(simulation.scene, 1);
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kIsolatedWrong) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    EXPECT_GE(pair.matches.size(), 15u);
    EXPECT_LE(pair.matches.size(), 60u);
    ASSERT_TRUE(pair.relative_pose &&
                pair.relative_pose->translation_direction);
    ExpectEpipolarErrors(bearings, pair, 4.0 / 707.0);
    std::set<uint32_t> keypoints1, keypoints2;
    for (const Match& match : pair.matches) {
      EXPECT_TRUE(keypoints1.insert(match.keypoint_idx1).second);
      EXPECT_TRUE(keypoints2.insert(match.keypoint_idx2).second);
    }
  }
}

TEST(HardshipsTest, IsolatedWrongPairsAreExactWithoutNoise) {
  SimulationOptions options = StreetSimulation(RigPreset::kMono);
  options.isolated_wrong_pair_ratio = 0.05;
  const Simulation simulation = Simulate(options, Drive());
  const Bearings bearings = ComputeBearings(simulation.scene, 1);
  ASSERT_GT(NumOfKind(simulation, PairKind::kIsolatedWrong), 0);
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kIsolatedWrong) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    ExpectEpipolarErrors(bearings, pair, 1e-6);
  }
}

// All pairs of a duplicate structure are consistent with one rigid motion of
// the copy.
TEST(HardshipsTest, DuplicatedStructuresAgreeAmongThemselves) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.duplicated_pair_ratio = 0.05;
  const Simulation simulation = Simulate(options, Drive(100));
  const int num_wrong = NumOfKind(simulation, PairKind::kDuplicatedStructure);
  EXPECT_NEAR(num_wrong, 0.05 * simulation.pair_kinds.size(), 0.3 * num_wrong);
  // The point with which each point is confused, the same in all pairs.
  std::map<int, int> copy_of;
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kDuplicatedStructure) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> places;
    for (const Match& match : pair.matches) {
      int point1 = PointOf(simulation, pair.image_idx1, match.keypoint_idx1);
      int point2 = PointOf(simulation, pair.image_idx2, match.keypoint_idx2);
      if (point1 > point2) std::swap(point1, point2);
      ASSERT_GE(point1, 0);
      ASSERT_NE(point1, point2);
      EXPECT_EQ(copy_of.emplace(point1, point2).first->second, point2);
      places.emplace_back(simulation.world_points[point1],
                          simulation.world_points[point2]);
    }
    // Rigidity: distances between points equal those between their copies.
    for (size_t j = 1; j < places.size(); ++j) {
      EXPECT_NEAR((places[j].first - places[0].first).norm(),
                  (places[j].second - places[0].second).norm(), 1e-9);
    }
  }
}

TEST(HardshipsTest, WithoutNoiseDuplicatedPairsAreExact) {
  SimulationOptions options = StreetSimulation(RigPreset::kKitti360);
  options.duplicated_pair_ratio = 0.05;
  const Simulation simulation = Simulate(options, Drive(80));
  const Bearings bearings = ComputeBearings(simulation.scene, 1);
  ASSERT_GT(NumOfKind(simulation, PairKind::kDuplicatedStructure), 10);
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    const ImagePair& pair = simulation.view_graph.pairs[i];
    ExpectEpipolarErrors(bearings, pair, 1e-6);
  }
}

TEST(HardshipsTest, PairsWithoutBaselineArePlanarOrPanoramic) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.path = PathPreset::kStanding;
  options.num_frames = 4;
  options.pixel_noise_px = 0.7;
  const Simulation simulation = Simulate(options);
  ASSERT_FALSE(simulation.view_graph.pairs.empty());
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const bool is_same_camera =
        simulation.scene.images[pair.image_idx1].sensor_idx ==
        simulation.scene.images[pair.image_idx2].sensor_idx;
    if (!is_same_camera) continue;
    EXPECT_EQ(pair.config, TwoViewConfig::kPlanarOrPanoramic);
    EXPECT_FALSE(pair.E.has_value());
    EXPECT_FALSE(pair.relative_pose->translation_direction.has_value());
  }
}

TEST(HardshipsTest, ARealisticStreetHasRealisticTracks) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = StreetSimulation(rig);
    options.pixel_noise_px = 0.7;
    const Simulation simulation = Simulate(options, Drive());
    const MatchStatistics statistics = ComputeMatchStatistics(
        simulation.scene, simulation.view_graph, simulation.cam_from_world);
    EXPECT_GT(statistics.track_length.mean, 4.0);
    EXPECT_LT(statistics.track_length.mean, 8.0);
    EXPECT_LE(statistics.keypoints_per_image.mean, 400.0);
    EXPECT_GT(statistics.keypoints_per_image.mean, 300.0);
    EXPECT_LT(statistics.outlier_share, 0.002);
    EXPECT_GT(statistics.parallax_deg.median, 0.5);
  }
}

}  // namespace
}  // namespace mgsfm
