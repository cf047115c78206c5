// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/sub_maps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

// A loop: the last frames see what the first ones saw.
SceneModel Drive() {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = PathPreset::kLoop;
  options.num_frames = 40;
  options.num_points_per_frame = 60;
  options.max_num_features_per_image = 60;
  Simulation simulation = Simulate(options);
  SceneModel drive{std::move(simulation.scene),
                   std::move(simulation.ground_truth)};
  RemoveLargeErrors(1.0, &drive);
  return drive;
}

SceneModel Frames(SceneModel model, const std::set<int>& frames) {
  Mask keeps;
  for (const Image& image : model.scene.images) {
    keeps.push_back(frames.count(image.frame_idx) > 0);
  }
  KeepImages(keeps, &model);
  return model;
}

std::set<int> Range(int begin, int end) {
  std::set<int> frames;
  for (int i = begin; i < end; ++i) frames.insert(i);
  return frames;
}

// Parts of a drive, each in a world of its own.
std::vector<SceneModel> Parts(const SceneModel& drive, int num_parts) {
  const auto num_frames = static_cast<int>(drive.scene.frames.size());
  Random random(7);
  const auto vector = [&] {
    return Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  std::vector<SceneModel> parts;
  for (int i = 0; i < num_parts; ++i) {
    parts.push_back(Frames(drive, Range(i * num_frames / num_parts - 2,
                                        (i + 1) * num_frames / num_parts + 2)));
    const Sim3 change{std::exp(random.Uniform(-1.0, 1.0)), ExpSO3(vector()),
                      30.0 * vector()};
    TransformWorld(change, &parts.back().reconstruction);
  }
  return parts;
}

// The largest distance of an image from its true place, after alignment.
double LargestError(const SceneModel& model, const SceneModel& truth) {
  const std::vector<ImagePoses> images = PairImages(model, truth);
  const Sim3 world_from_model = *AlignPoses(images);
  double largest = 0.0;
  for (const ImagePoses& image : images) {
    largest =
        std::max(largest, (world_from_model * image.cam_from_model->Center() -
                           image.cam_from_world.Center())
                              .norm());
  }
  return largest;
}

// Matches between the images of a frame and those of others, from the points of
// the drive.
std::vector<CrossPair> MatchesBetween(const SceneModel& drive, int frame1,
                                      const std::set<int>& frames2) {
  std::vector<CrossPair> pairs;
  std::map<std::pair<int, int>, std::vector<Match>> matches;
  for (const Point3D& point : drive.reconstruction.points) {
    for (const Observation& a : point.track) {
      for (const Observation& b : point.track) {
        if (drive.scene.images[a.image_idx].frame_idx != frame1 ||
            frames2.count(drive.scene.images[b.image_idx].frame_idx) == 0) {
          continue;
        }
        matches[{a.image_idx, b.image_idx}].push_back(
            {static_cast<uint32_t>(a.keypoint_idx),
             static_cast<uint32_t>(b.keypoint_idx)});
      }
    }
  }
  for (const auto& [images, of_pair] : matches) {
    pairs.push_back({drive.scene.images[images.first].name,
                     drive.scene.images[images.second].name, of_pair});
  }
  return pairs;
}

TEST(SubMaps, PartsInTheirOwnWorldsBecomeTheWhole) {
  const SceneModel drive = Drive();
  const JoinedMaps joined = JoinSubMaps(Parts(drive, 4), {}, {}, {});
  ASSERT_EQ(joined.models.size(), 1u);
  EXPECT_EQ(joined.models[0].scene.images.size(), drive.scene.images.size());
  EXPECT_EQ(joined.edges.size(), 3u);
  EXPECT_LT(LargestError(joined.models[0], drive), 1e-6);
}

TEST(SubMaps, MissingPartLeavesTwoModels) {
  const SceneModel drive = Drive();
  std::vector<SceneModel> parts = Parts(drive, 4);
  parts.erase(parts.begin() + 1);
  const JoinedMaps joined = JoinSubMaps(parts, {}, {}, {});
  ASSERT_EQ(joined.models.size(), 2u);
  EXPECT_THAT(joined.sub_maps[0], testing::ElementsAre(1, 2));
  EXPECT_THAT(joined.sub_maps[1], testing::ElementsAre(0));
}

TEST(SubMaps, PartWithAnotherRigStaysSeparate) {
  const SceneModel drive = Drive();
  std::vector<SceneModel> parts = Parts(drive, 4);
  Rigid3& pose = *parts[0].reconstruction.sensor_from_rig[1];
  pose.rotation = ExpSO3({0.0, DegToRad(20.0), 0.0}) * pose.rotation;
  const JoinedMaps joined = JoinSubMaps(parts, {}, {}, {});
  ASSERT_EQ(joined.models.size(), 2u);
  EXPECT_THAT(joined.sub_maps[0], testing::ElementsAre(1, 2, 3));
  EXPECT_THAT(joined.sub_maps[1], testing::ElementsAre(0));
  EXPECT_THAT(joined.conflicts[0], testing::HasSubstr("the rig has changed"));
  EXPECT_LT(LargestError(joined.models[0], drive), 1e-6);
}

std::vector<CrossPair> MatchesOfLoop(const SceneModel& drive) {
  std::vector<CrossPair> pairs;
  for (const int frame : {0, 1, 2}) {
    for (CrossPair& pair : MatchesBetween(drive, frame, Range(35, 40))) {
      pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

// The first and the last part have no common frame, but matches.
TEST(SubMaps, MatchesCloseALoop) {
  const SceneModel drive = Drive();
  const std::vector<CrossPair> pairs = MatchesOfLoop(drive);
  ASSERT_FALSE(pairs.empty());
  JoinOptions options;
  options.min_num_loop_points = 10;
  const JoinedMaps joined = JoinSubMaps(Parts(drive, 4), pairs, options, {});
  ASSERT_EQ(joined.models.size(), 1u);
  EXPECT_GT(joined.num_loop_points, 0);
  EXPECT_TRUE(std::all_of(joined.edges.begin(), joined.edges.end(),
                          [](const SubMapEdge& edge) { return edge.is_used; }));
  EXPECT_LT(LargestError(joined.models[0], drive), 1e-6);
}

// A keypoint that only one sub-map has a point of.
TEST(SubMaps, MatchesExtendTracks) {
  const SceneModel drive = Drive();
  std::vector<SceneModel> parts = Parts(drive, 4);
  const std::vector<CrossPair> pairs = MatchesOfLoop(drive);
  std::set<std::pair<std::string, int>> matched;
  for (const CrossPair& pair : pairs) {
    for (const Match& match : pair.matches) {
      matched.emplace(pair.name1, match.keypoint_idx1);
    }
  }
  SceneModel& first = parts.front();
  std::vector<Point3D>& points = first.reconstruction.points;
  points.erase(
      std::remove_if(points.begin(), points.end(),
                     [&](const Point3D& point) {
                       const Observation& o = point.track.front();
                       const Image& image = first.scene.images[o.image_idx];
                       return o.keypoint_idx % 2 == 0 &&
                              matched.count({image.name, o.keypoint_idx}) > 0;
                     }),
      points.end());
  const auto num_observations = [](const SceneModel& model) {
    return AnalyzeModel(model).num_observations;
  };
  JoinOptions options;
  options.min_num_loop_points = 10;
  const JoinedMaps joined = JoinSubMaps(parts, pairs, options, {});
  const JoinedMaps without = JoinSubMaps(parts, {}, options, {});
  ASSERT_EQ(joined.models.size(), 1u);
  EXPECT_GT(num_observations(joined.models[0]),
            num_observations(without.models[0]));
  for (const Point3D& point : joined.models[0].reconstruction.points) {
    EXPECT_LT(*point.error_px, 1.0);
  }
}

// The name of each image of the drive, by the image of the same sensor that
// many frames earlier.
std::map<std::string, std::string> NamesLater(const SceneModel& drive,
                                              int num_frames) {
  std::map<std::string, std::string> later;
  for (const Image& image : drive.scene.images) {
    for (const Image& other : drive.scene.images) {
      if (other.frame_idx == image.frame_idx + num_frames &&
          other.sensor_idx == image.sensor_idx) {
        later[image.name] = other.name;
      }
    }
  }
  return later;
}

double BaselineOf(const SceneModel& stereo) {
  return stereo.reconstruction.sensor_from_rig[1]->translation.norm();
}

// Replaces the points of the second part by copies of those of the first, at
// another place and with the keypoints of later images. Returns the matches
// between the images of both, on which all points agree.
std::vector<CrossPair> CopyPoints(
    const SceneModel& first, const std::map<std::string, std::string>& later,
    SceneModel* second) {
  std::map<std::string, int> image_of_name;
  for (size_t i = 0; i < second->scene.images.size(); ++i) {
    image_of_name[second->scene.images[i].name] = static_cast<int>(i);
  }
  const Sim3 second_from_first{BaselineOf(*second) / BaselineOf(first),
                               Eigen::Quaterniond::Identity(),
                               {90.0, 0.0, 60.0}};
  std::vector<CrossPair> pairs;
  second->reconstruction.points.clear();
  for (Point3D point : first.reconstruction.points) {
    std::vector<Observation> track;
    for (const Observation& o : point.track) {
      const std::string& name = first.scene.images[o.image_idx].name;
      const auto found = image_of_name.find(later.at(name));
      if (found == image_of_name.end()) continue;
      const auto keypoint_idx = static_cast<uint32_t>(o.keypoint_idx);
      track.push_back({found->second, o.keypoint_idx});
      pairs.push_back({name, found->first, {{keypoint_idx, keypoint_idx}}});
    }
    if (track.size() < 2) continue;
    point.track = std::move(track);
    point.point_in_world = second_from_first * point.point_in_world;
    second->reconstruction.points.push_back(std::move(point));
  }
  return pairs;
}

// Matches say that frames 22 to 29 see what frames 0 to 7 see. Each of them is
// in one part only.
TEST(SubMaps, WrongLoopIsRejected) {
  const SceneModel drive = Drive();
  std::vector<SceneModel> parts = Parts(drive, 4);
  const std::vector<CrossPair> pairs = CopyPoints(
      Frames(parts[0], Range(0, 8)), NamesLater(drive, 22), &parts[2]);
  const JoinedMaps joined = JoinSubMaps(parts, pairs, {}, {});
  ASSERT_EQ(joined.models.size(), 1u);
  ASSERT_EQ(joined.edges.size(), 4u);
  for (const SubMapEdge& edge : joined.edges) {
    EXPECT_EQ(edge.is_used, edge.num_common_images > 0);
  }
  EXPECT_EQ(joined.num_loop_points, 0);
  EXPECT_LT(LargestError(joined.models[0], drive), 1e-6);
}

}  // namespace
}  // namespace mgsfm
