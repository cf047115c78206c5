// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/fixed_regions.h"

#include <gtest/gtest.h>

#include "base/ranges.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 40;
constexpr int kNumOnObject = 30;

// A drive with the true relative poses of its pairs.
Simulation Drive(PathPreset path) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.path = path;
  options.num_frames = kNumFrames;
  Simulation simulation = Simulate(options);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    const Rigid3 pose = simulation.cam_from_world[pair.image_idx2] *
                        simulation.cam_from_world[pair.image_idx1].Inverse();
    pair.relative_pose = {pose.rotation, pose.translation.stableNormalized()};
  }
  return simulation;
}

// An object in the lower edge of the images of the first sensor, from the first
// frame to one of them. Its matches win the pairs of frames an even number
// apart, which then state that the rig stands still.
void AddObject(int num_frames, Simulation* simulation) {
  Scene& scene = simulation->scene;
  std::vector<uint32_t> first_on_object;
  for (Image& image : scene.images) {
    first_on_object.push_back(static_cast<uint32_t>(image.keypoints_px.size()));
    const Camera& camera = scene.cameras[image.camera_idx];
    for (int k = 0; k < kNumOnObject; ++k) {
      image.keypoints_px.emplace_back(
          static_cast<float>((k + 0.5) * camera.width_px / kNumOnObject),
          static_cast<float>(camera.height_px - 4));
    }
  }
  for (ImagePair& pair : simulation->view_graph.pairs) {
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    if (image1.sensor_idx != 0 || image2.sensor_idx != 0 ||
        std::max(image1.frame_idx, image2.frame_idx) >= num_frames) {
      continue;
    }
    if ((image2.frame_idx - image1.frame_idx) % 2 == 0) {
      pair.matches.clear();
      pair.relative_pose = {Eigen::Quaterniond::Identity(), std::nullopt};
    }
    for (uint32_t k = 0; k < kNumOnObject; ++k) {
      pair.matches.push_back({first_on_object[pair.image_idx1] + k,
                              first_on_object[pair.image_idx2] + k});
    }
  }
}

// A desk in the lower edge of the images of both sensors. Its parallax within
// frames shows that it is near: a fifth of the width of an image.
void AddDesk(Simulation* simulation) {
  Scene& scene = simulation->scene;
  std::vector<uint32_t> first_on_desk;
  for (Image& image : scene.images) {
    first_on_desk.push_back(static_cast<uint32_t>(image.keypoints_px.size()));
    const Camera& camera = scene.cameras[image.camera_idx];
    for (int k = 0; k < kNumOnObject; ++k) {
      const double column = 0.3 + 0.5 * k / kNumOnObject;
      image.keypoints_px.emplace_back(
          static_cast<float>((column - 0.2 * image.sensor_idx) *
                             camera.width_px),
          static_cast<float>(camera.height_px - 4));
    }
  }
  for (ImagePair& pair : simulation->view_graph.pairs) {
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    if (image1.frame_idx != image2.frame_idx &&
        image1.sensor_idx != image2.sensor_idx) {
      continue;
    }
    for (uint32_t k = 0; k < kNumOnObject; ++k) {
      pair.matches.push_back({first_on_desk[pair.image_idx1] + k,
                              first_on_desk[pair.image_idx2] + k});
    }
  }
}

bool HasAny(const FixedRegions& regions) {
  return AnyOf(regions.of_sensor,
               [](const Mask& cells) { return !cells.empty(); });
}

FixedRegions Find(const Simulation& simulation) {
  const Scene& scene = simulation.scene;
  return FindFixedRegions(scene, ComputeBearings(scene, 1),
                          FramePairIndex(scene, simulation.view_graph),
                          simulation.view_graph, 2.0);
}

size_t CountMatches(const ViewGraph& view_graph) {
  size_t num_matches = 0;
  for (const ImagePair& pair : view_graph.pairs) {
    num_matches += pair.matches.size();
  }
  return num_matches;
}

TEST(FixedRegionsTest, AHullIsFoundAndItsMatchesAreDropped) {
  Simulation simulation = Drive(PathPreset::kCurve);
  AddObject(kNumFrames, &simulation);
  const FixedRegions regions = Find(simulation);
  ASSERT_TRUE(HasAny(regions));
  EXPECT_TRUE(regions.of_sensor[1].empty());
  EXPECT_LT(regions.FractionOf(0), 0.1);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    const auto half = pair.matches.begin() + pair.matches.size() / 2;
    pair.outliers.assign(half, pair.matches.end());
    pair.matches.erase(half, pair.matches.end());
  }
  const ViewGraph visible =
      DropFixedRegions(simulation.scene, regions, simulation.view_graph);
  for (size_t i = 0; i < visible.pairs.size(); ++i) {
    const ImagePair& pair = visible.pairs[i];
    for (const Match& match : AllMatches(pair)) {
      EXPECT_FALSE(regions.Contains(simulation.scene, pair.image_idx1,
                                    match.keypoint_idx1));
      EXPECT_FALSE(regions.Contains(simulation.scene, pair.image_idx2,
                                    match.keypoint_idx2));
    }
    const Image& image = simulation.scene.images[pair.image_idx1];
    const auto last =
        static_cast<size_t>(image.keypoints_px.size() - kNumOnObject);
    if (image.sensor_idx == 0) {
      for (size_t k = last; k < image.keypoints_px.size(); ++k) {
        EXPECT_TRUE(regions.Contains(simulation.scene, pair.image_idx1, k));
      }
    }
  }
}

TEST(FixedRegionsTest, AStaticWorldHasNone) {
  for (const PathPreset path : {PathPreset::kStraight, PathPreset::kCurve}) {
    const Simulation simulation = Drive(path);
    const FixedRegions regions = Find(simulation);
    EXPECT_FALSE(HasAny(regions));
    EXPECT_EQ(CountMatches(DropFixedRegions(simulation.scene, regions,
                                            simulation.view_graph)),
              CountMatches(simulation.view_graph));
  }
}

TEST(FixedRegionsTest, CellsAreAddedOnce) {
  Mask first(6, false), second(6, false);
  first[1] = second[1] = second[4] = true;
  FixedRegions regions;
  EXPECT_FALSE(regions.Add({{Mask(), Mask()}}));
  EXPECT_FALSE(HasAny(regions));
  EXPECT_TRUE(regions.Add({{Mask(), first}}));
  EXPECT_FALSE(regions.Add({{Mask(), first}}));
  EXPECT_TRUE(regions.Add({{first, second}}));
  EXPECT_FALSE(regions.Add({{first, first}}));
  EXPECT_EQ(regions.of_sensor[0].Count(), 1);
  EXPECT_EQ(regions.of_sensor[1].Count(), 2);
}

// On a straight way, distant points keep their rays as the desk does.
TEST(FixedRegionsTest, ANearDeskIsFoundOnAStraightWay) {
  Simulation simulation = Drive(PathPreset::kStraight);
  std::vector<size_t> num_of_scene;
  for (const Image& image : simulation.scene.images) {
    num_of_scene.push_back(image.keypoints_px.size());
  }
  AddDesk(&simulation);
  const FixedRegions regions = Find(simulation);
  for (const int sensor_idx : {0, 1}) {
    ASSERT_FALSE(regions.of_sensor[sensor_idx].empty());
    EXPECT_LT(regions.FractionOf(sensor_idx), 0.1);
  }
  for (size_t i = 0; i < num_of_scene.size(); ++i) {
    for (size_t k = num_of_scene[i]; k < num_of_scene[i] + kNumOnObject; ++k) {
      EXPECT_TRUE(regions.Contains(simulation.scene, static_cast<int>(i), k));
    }
  }
}

// A vehicle that keeps its distance for half of the drive, while the same part
// of the images shows the street before and after.
TEST(FixedRegionsTest, AVehicleIsNoHull) {
  Simulation simulation = Drive(PathPreset::kCurve);
  AddObject(kNumFrames / 2, &simulation);
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const Image& image = simulation.scene.images[pair.image_idx1];
    if (image.frame_idx < kNumFrames / 2) continue;
    ASSERT_FALSE(pair.matches.empty());
  }
  // The street at the lower edge.
  for (ImagePair& pair : simulation.view_graph.pairs) {
    Scene& scene = simulation.scene;
    Image& image1 = scene.images[pair.image_idx1];
    Image& image2 = scene.images[pair.image_idx2];
    if (image1.sensor_idx != 0 || image2.sensor_idx != 0 ||
        std::min(image1.frame_idx, image2.frame_idx) < kNumFrames / 2) {
      continue;
    }
    const auto first1 =
        static_cast<uint32_t>(image1.keypoints_px.size() - kNumOnObject);
    const auto first2 =
        static_cast<uint32_t>(image2.keypoints_px.size() - kNumOnObject);
    for (uint32_t k = 0; k + 1 < kNumOnObject; ++k) {
      pair.matches.push_back({first1 + k, first2 + k + 1});
    }
  }
  EXPECT_FALSE(HasAny(Find(simulation)));
}

// Nothing tells a hull from the scene if the rig stands still.
TEST(FixedRegionsTest, AStandingRigHasNone) {
  Simulation simulation = Drive(PathPreset::kCurve);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    pair.relative_pose = {Eigen::Quaterniond::Identity(), std::nullopt};
    pair.matches.clear();
  }
  AddObject(kNumFrames, &simulation);
  EXPECT_FALSE(HasAny(Find(simulation)));
}

}  // namespace
}  // namespace mgsfm
