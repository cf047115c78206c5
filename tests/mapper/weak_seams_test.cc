// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/weak_seams.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/mapper/report.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 24;
constexpr int kFirstBeyond = 10;

// A drive with hardly any matches between two stretches. Their keypoints in the
// second one match no other image.
Simulation DriveWithWeakSeam() {
  SimulationOptions options;
  options.num_frames = kNumFrames;
  options.pixel_noise_px = 0.3;
  Simulation simulation = Simulate(options);
  const auto is_beyond = [&](int image_idx) {
    return simulation.scene.images[image_idx].frame_idx >= kFirstBeyond;
  };
  std::vector<ImagePair> pairs;
  std::set<std::pair<int, uint32_t>> crossing;  // image and keypoint
  int num_crossing = 0;
  for (ImagePair& pair : simulation.view_graph.pairs) {
    if (is_beyond(pair.image_idx1) != is_beyond(pair.image_idx2)) {
      if (num_crossing++ >= 2) continue;
      pair.matches.resize(std::min<size_t>(pair.matches.size(), 22));
      for (const Match& match : pair.matches) {
        crossing.insert({pair.image_idx2, match.keypoint_idx2});
      }
    }
    pairs.push_back(pair);
  }
  for (ImagePair& pair : pairs) {
    if (is_beyond(pair.image_idx1) != is_beyond(pair.image_idx2)) continue;
    const auto crosses = [&](const Match& match) {
      return crossing.count({pair.image_idx1, match.keypoint_idx1}) > 0 ||
             crossing.count({pair.image_idx2, match.keypoint_idx2}) > 0;
    };
    pair.matches.erase(
        std::remove_if(pair.matches.begin(), pair.matches.end(), crosses),
        pair.matches.end());
  }
  simulation.view_graph.pairs = std::move(pairs);
  return simulation;
}

std::vector<int> RegisteredFrames(const MapperModel& model) {
  std::vector<int> frames;
  for (int i = 0; i < kNumFrames; ++i) {
    if (model.reconstruction.rig_from_world[i]) frames.push_back(i);
  }
  return frames;
}

TEST(WeakSeams, AreReported) {
  const Simulation simulation = DriveWithWeakSeam();
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, {}, {});
  ASSERT_EQ(result.models.size(), 1u);
  const std::vector<Seam>& seams = result.models[0].confidence.seams;
  ASSERT_FALSE(seams.empty());
  std::vector<int> expected;
  for (int i = 0; i < kFirstBeyond; ++i) expected.push_back(i);
  EXPECT_EQ(seams[0].frame_idxs_beyond, expected);
  ASSERT_TRUE(seams[0].sigma_position && seams[0].sigma_rotation_deg);
  EXPECT_GT(*seams[0].sigma_position, 0.0);
  EXPECT_GT(*seams[0].sigma_rotation_deg, 0.0);
}

TEST(WeakSeams, AreReportedWithTheFramesNextToThem) {
  const Simulation simulation = DriveWithWeakSeam();
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, {}, {});
  RunDescription run;
  run.options_json = "{}";
  const auto report = nlohmann::json::parse(
      MapperReportToJson(simulation.scene, simulation.view_graph, result, run));
  const auto& seam = report["models"][0]["seams"][0];
  const auto& frames = simulation.scene.frames;
  const Seam& expected = result.models[0].confidence.seams[0];
  ASSERT_LT(expected.frame_idx_beyond, kFirstBeyond);
  ASSERT_GE(expected.frame_idx_core, kFirstBeyond);
  EXPECT_EQ(seam["frame_before"], frames[expected.frame_idx_beyond].name);
  EXPECT_EQ(seam["frame_after"], frames[expected.frame_idx_core].name);
}

TEST(WeakSeams, SplitModels) {
  const Simulation simulation = DriveWithWeakSeam();
  MapperOptions options;
  options.weak_seams = WeakSeams::kSplit;
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, options, {});
  ASSERT_EQ(result.models.size(), 2u);
  const std::vector<int> beyond = RegisteredFrames(result.models[0]);
  const std::vector<int> before = RegisteredFrames(result.models[1]);
  EXPECT_EQ(beyond.size(), size_t{kNumFrames - kFirstBeyond});
  EXPECT_EQ(beyond.front(), kFirstBeyond);
  EXPECT_EQ(before.size(), size_t{kFirstBeyond});
  EXPECT_EQ(before.back(), kFirstBeyond - 1);
  EXPECT_TRUE(result.unregistered_frames.empty());
  for (const MapperModel& model : result.models) {
    EXPECT_TRUE(model.confidence.seams.empty());
    for (const Point3D& point : model.reconstruction.points) {
      for (const Observation& observation : point.track) {
        EXPECT_TRUE(model.reconstruction.IsRegistered(simulation.scene,
                                                      observation.image_idx));
      }
    }
  }
}

// A model of all frames, with a seam of each kind before frames 5, 10 and 15.
MapperModel ModelWithSeams(const Scene& scene) {
  MapperModel model;
  model.reconstruction.rig_from_world.assign(scene.frames.size(), Rigid3());
  int first = 0;
  for (const SeamReason reason :
       {SeamReason::kFewTies, SeamReason::kJump, SeamReason::kContradicted}) {
    first += 5;
    Seam seam;
    seam.reason = reason;
    seam.sigma_position = 0.1;
    for (int i = first; i < kNumFrames; ++i)
      seam.frame_idxs_beyond.push_back(i);
    model.confidence.seams.push_back(seam);
  }
  return model;
}

MapperOptions SplitJumps() {
  MapperOptions options;
  options.weak_seams = WeakSeams::kSplitJumps;
  return options;
}

TEST(WeakSeams, AreKeptByDefault) {
  const Scene scene = DriveWithWeakSeam().scene;
  EXPECT_TRUE(SeamsToSplit(scene, ModelWithSeams(scene), {}).empty());
}

TEST(WeakSeams, SplitModelsAtJumps) {
  const Scene scene = DriveWithWeakSeam().scene;
  const MapperModel model = ModelWithSeams(scene);
  MapperOptions options = SplitJumps();
  const auto jumps = SeamsToSplit(scene, model, options);
  ASSERT_EQ(jumps.size(), 1u);
  EXPECT_EQ(jumps[0].reason, SeamReason::kJump);
  options.weak_seams = WeakSeams::kKeep;
  EXPECT_TRUE(SeamsToSplit(scene, model, options).empty());
  options.weak_seams = WeakSeams::kSplit;
  EXPECT_EQ(SeamsToSplit(scene, model, options).size(), 3u);
}

TEST(WeakSeams, SplitModelsWherePointsDoNotRelateTheSides) {
  const Scene scene = DriveWithWeakSeam().scene;
  MapperModel model = ModelWithSeams(scene);
  model.confidence.seams[0].sigma_position.reset();
  ASSERT_EQ(SeamsToSplit(scene, model, {}).size(), 1u);
  const auto seams = SeamsToSplit(scene, model, SplitJumps());
  ASSERT_EQ(seams.size(), 2u);
  EXPECT_EQ(seams[0].reason, SeamReason::kFewTies);
  EXPECT_EQ(seams[1].reason, SeamReason::kJump);
  for (const SeamReason reason :
       {SeamReason::kOnePlace, SeamReason::kRefutedLoops}) {
    model.confidence.seams[2].reason = reason;
    EXPECT_EQ(SeamsToSplit(scene, model, {}).size(), 2u);
  }
  // Positions place both sides in one world.
  model.position_priors = PositionPriorSummary();
  model.position_priors->is_registered = true;
  EXPECT_TRUE(SeamsToSplit(scene, model, {}).empty());
  EXPECT_EQ(SeamsToSplit(scene, model, SplitJumps()).size(), 1u);
}

// If nearly all frames jump, the expected motion is wrong, not the model.
TEST(WeakSeams, DoNotSplitModelsThatJumpAllTheTime) {
  const Scene scene = DriveWithWeakSeam().scene;
  MapperModel model = ModelWithSeams(scene);
  model.confidence.seams.clear();
  const auto add_jump = [&](int frame_idx) {
    Seam seam;
    seam.reason = SeamReason::kJump;
    seam.sigma_position = 0.1;
    seam.frame_idxs_beyond = {frame_idx};
    model.confidence.seams.push_back(seam);
  };
  for (int i = 1; i < kNumFrames; i += 2) add_jump(i);
  EXPECT_EQ(SeamsToSplit(scene, model, SplitJumps()).size(),
            size_t{kNumFrames / 2});
  for (int i = 0; i < kNumFrames; i += 2) add_jump(i);
  EXPECT_TRUE(SeamsToSplit(scene, model, SplitJumps()).empty());
  // A part without a relation to the others is none all the same.
  model.confidence.seams[2].sigma_position.reset();
  const auto seams = SeamsToSplit(scene, model, SplitJumps());
  ASSERT_EQ(seams.size(), 1u);
  EXPECT_EQ(seams[0].frame_idxs_beyond,
            model.confidence.seams[2].frame_idxs_beyond);
}

TEST(WeakSeams, LeaveSoundModelsWhole) {
  SimulationOptions options;
  options.num_frames = kNumFrames;
  const Simulation simulation = Simulate(options);
  MapperOptions split;
  split.weak_seams = WeakSeams::kSplit;
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, split, {});
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.models[0].confidence.seams.empty());
}

TEST(WeakSeams, AreNamedInFull) {
  Simulation simulation = DriveWithWeakSeam();
  std::string name;
  for (int i = 0; i < 500; ++i) name += "\u00e9";  // two bytes each
  simulation.scene.frames[0].name = name + "0";
  simulation.scene.frames[1].name = name + "1";
  Confidence confidence;
  confidence.seams.emplace_back();
  confidence.seams[0].frame_idx_core = 0;
  confidence.seams[0].frame_idx_beyond = 1;
  const auto finding = DescribeSeams(simulation.scene, confidence);
  ASSERT_TRUE(finding.has_value());
  EXPECT_NE(finding->text.find(name + "0"), std::string::npos);
  EXPECT_NE(finding->text.find(name + "1"), std::string::npos);
}

}  // namespace
}  // namespace mgsfm
