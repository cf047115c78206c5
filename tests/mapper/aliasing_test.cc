// SPDX-License-Identifier: BSD-3-Clause
// Duplicate structures: pairs of images of different places whose matches are
// exact and consistent with each other, as those of equal facades.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "base/random.h"
#include "base/ranges.h"
#include "mapper/mapper_recipe.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

struct Copies {
  int first_frame_idx;       // of the frames that see the original
  int first_copy_frame_idx;  // of those that see the copy in the same way
  int num_frames;
};

void SortPairs(ViewGraph* view_graph) {
  SortBy(&view_graph->pairs, [](const ImagePair& pair) {
    return std::pair(pair.image_idx1, pair.image_idx2);
  });
}

// Duplicates half of the points that one range of frames sees in front of
// another range, and matches images of the duplicate with those of the
// original.
class CopyMaker {
 public:
  CopyMaker(const Copies& copies, Simulation* simulation)
      : copies_(copies),
        scene_(simulation->scene),
        view_graph_(simulation->view_graph) {}

  // Returns the number of wrong pairs.
  int Run() {
    first_copied_keypoint_.resize(scene_.images.size());
    for (size_t i = 0; i < scene_.images.size(); ++i) {
      const int copy_idx = CopyOf(static_cast<int>(i));
      if (copy_idx < 0) continue;
      auto& copied = scene_.images[copy_idx].keypoints_px;
      first_copied_keypoint_[i] = static_cast<uint32_t>(copied.size());
      const auto keypoints = scene_.images[i].keypoints_px;
      copied.insert(copied.end(), keypoints.begin(), keypoints.end());
    }
    const std::vector<ImagePair> true_pairs = view_graph_.pairs;
    for (const ImagePair& pair : true_pairs) {
      const int copy1 = CopyOf(pair.image_idx1);
      const int copy2 = CopyOf(pair.image_idx2);
      if (copy1 >= 0 && copy2 >= 0) AddMatches(pair, copy1, copy2);
      if (copy1 >= 0) AddPair(pair, copy1, pair.image_idx2);
      if (copy2 >= 0) AddPair(pair, pair.image_idx1, copy2);
    }
    SortPairs(&view_graph_);
    return static_cast<int>(view_graph_.pairs.size() - true_pairs.size());
  }

 private:
  int CopyOf(int image_idx) const {
    const Image& image = scene_.images[image_idx];
    const int offset = image.frame_idx - copies_.first_frame_idx;
    if (offset < 0 || offset >= copies_.num_frames) return -1;
    const Frame& frame = scene_.frames[copies_.first_copy_frame_idx + offset];
    for (const int idx : frame.image_idxs) {
      if (scene_.images[idx].sensor_idx == image.sensor_idx) return idx;
    }
    return -1;
  }

  // The motion of the original pair, for images that may show the duplicate.
  std::vector<Match> CopiedMatches(const ImagePair& pair, int image_idx1,
                                   int image_idx2) const {
    std::vector<Match> matches;
    for (Match match : pair.matches) {
      if (match.keypoint_idx2 % 2 != 0) continue;
      if (image_idx1 != pair.image_idx1) {
        match.keypoint_idx1 += first_copied_keypoint_[pair.image_idx1];
      }
      if (image_idx2 != pair.image_idx2) {
        match.keypoint_idx2 += first_copied_keypoint_[pair.image_idx2];
      }
      matches.push_back(match);
    }
    return matches;
  }

  void AddMatches(const ImagePair& original, int image_idx1, int image_idx2) {
    for (ImagePair& pair : view_graph_.pairs) {
      if (pair.image_idx1 != image_idx1 || pair.image_idx2 != image_idx2) {
        continue;
      }
      const auto matches = CopiedMatches(original, image_idx1, image_idx2);
      pair.matches.insert(pair.matches.end(), matches.begin(), matches.end());
    }
  }

  void AddPair(const ImagePair& original, int image_idx1, int image_idx2) {
    ImagePair pair;
    pair.image_idx1 = std::min(image_idx1, image_idx2);
    pair.image_idx2 = std::max(image_idx1, image_idx2);
    pair.config = TwoViewConfig::kCalibrated;
    pair.matches = CopiedMatches(original, image_idx1, image_idx2);
    if (image_idx1 > image_idx2) {
      for (Match& match : pair.matches) {
        std::swap(match.keypoint_idx1, match.keypoint_idx2);
      }
    }
    view_graph_.pairs.push_back(std::move(pair));
  }

  const Copies copies_;
  Scene& scene_;
  ViewGraph& view_graph_;
  std::vector<uint32_t> first_copied_keypoint_;  // per original image
};

SimulationOptions Drive(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 60;
  options.num_points_per_frame = 80;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.5;
  return options;
}

void ExpectNamed(const Copies& copies, const MapperModel& model) {
  ASSERT_FALSE(model.rejected_groups.empty());
  const RejectedGroup& group = model.rejected_groups.front();
  // Neighbors of the frames are also matched with the duplicates.
  constexpr int kReach = 3;
  EXPECT_GE(group.first_frame_idx1, copies.first_frame_idx - kReach);
  EXPECT_LE(group.last_frame_idx1,
            copies.first_frame_idx + copies.num_frames - 1 + kReach);
  EXPECT_GE(group.first_frame_idx2, copies.first_copy_frame_idx);
  EXPECT_LE(group.last_frame_idx2,
            copies.first_copy_frame_idx + copies.num_frames - 1);
}

class AliasingTest
    : public testing::TestWithParam<std::pair<RigPreset, PathPreset>> {};

TEST_P(AliasingTest, EqualFacadesDoNotFoldTheRoad) {
  Simulation simulation = Simulate(Drive(GetParam().first, GetParam().second));
  const Copies copies{8, 40, 4};
  const size_t num_true_pairs = simulation.view_graph.pairs.size();
  const int num_wrong_pairs = CopyMaker(copies, &simulation).Run();
  ASSERT_GT(num_wrong_pairs, static_cast<int>(num_true_pairs / 20));
  const MapperResult result = RunMapper(
      {simulation.scene, simulation.view_graph}, MapperOptions(), Context());
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  EXPECT_LT(CompareModels(simulation.scene, result.models[0].reconstruction,
                          simulation.ground_truth)
                .max_position,
            0.3);
  ExpectNamed(copies, result.models[0]);
  EXPECT_EQ(result.models[0].rejected_groups[0].pair_idxs.size(),
            num_wrong_pairs);
}

// Single pairs with hardly any matches can deviate by their noise alone.
TEST_P(AliasingTest, ADriveWithoutDuplicatesHasNoLargeRejectedGroups) {
  constexpr size_t kFew = 5;
  const Simulation simulation =
      Simulate(Drive(GetParam().first, GetParam().second));
  const MapperResult result = RunMapper(
      {simulation.scene, simulation.view_graph}, MapperOptions(), Context());
  ASSERT_EQ(result.models.size(), 1u);
  for (const RejectedGroup& group : result.models[0].rejected_groups) {
    EXPECT_LT(group.pair_idxs.size(), kFew);
  }
}

INSTANTIATE_TEST_SUITE_P(
    RigsAndPaths, AliasingTest,
    testing::Values(std::pair(RigPreset::kMono, PathPreset::kStraight),
                    std::pair(RigPreset::kMono, PathPreset::kCurve),
                    std::pair(RigPreset::kStereo, PathPreset::kStraight),
                    std::pair(RigPreset::kStereo, PathPreset::kCurve),
                    std::pair(RigPreset::kKitti360, PathPreset::kStraight)));

constexpr Copies kCopies{8, 40, 4};
constexpr int kFirstAfterCut = 26;

// Leaves 20 matches of each pair of images that the frames on either side of
// the cut have, and no other pairs across it.
void Weaken(int first_frame_idx_after, Simulation* simulation) {
  constexpr size_t kNumMatches = 20;
  auto& pairs = simulation->view_graph.pairs;
  const auto frame_of = [&](int image_idx) {
    return simulation->scene.images[image_idx].frame_idx;
  };
  std::vector<ImagePair> kept;
  for (ImagePair& pair : pairs) {
    const auto [first, last] =
        std::minmax({frame_of(pair.image_idx1), frame_of(pair.image_idx2)});
    if (first < first_frame_idx_after && first_frame_idx_after <= last) {
      if (last != first + 1) continue;
      pair.matches.resize(std::min(pair.matches.size(), kNumMatches));
    }
    kept.push_back(std::move(pair));
  }
  pairs = std::move(kept);
}

// Matches of images that do not see the same, as databases have them before
// verification.
void AddWrongMatches(Simulation* simulation) {
  constexpr uint32_t kNumMatches = 8;
  const auto& images = simulation->scene.images;
  auto& pairs = simulation->view_graph.pairs;
  std::vector<ImagePair> added;
  Random random(1);
  const auto keypoint_of = [&](int image_idx) {
    return random.Index(
        static_cast<uint32_t>(images[image_idx].keypoints_px.size()));
  };
  for (int i = 0; i < static_cast<int>(images.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(images.size()); ++j) {
      if (FindPair(simulation->view_graph, i, j) != nullptr) continue;
      ImagePair pair;
      pair.image_idx1 = i;
      pair.image_idx2 = j;
      pair.config = TwoViewConfig::kCalibrated;
      for (uint32_t k = 0; k < kNumMatches; ++k) {
        pair.matches.push_back({keypoint_of(i), keypoint_of(j)});
      }
      added.push_back(std::move(pair));
    }
  }
  pairs.insert(pairs.end(), added.begin(), added.end());
  SortPairs(&simulation->view_graph);
}

// The rest of the drive extends a model of the first half.
MapperResult ExtendFirstHalf(const Simulation& simulation) {
  MapperInput input{simulation.scene, {}};
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const auto is_first = [&](int image_idx) {
      return simulation.scene.images[image_idx].frame_idx < kFirstAfterCut;
    };
    if (is_first(pair.image_idx1) && is_first(pair.image_idx2)) {
      input.view_graph.pairs.push_back(pair);
    }
  }
  const MapperResult first = RunMapper(input, MapperOptions(), Context());
  MGSFM_CHECK_EQ(first.models.size(), 1u);
  input.view_graph = simulation.view_graph;
  input.existing_model = first.models[0].reconstruction;
  return RunMapper(input, MapperOptions(), Context());
}

void ExpectRight(const Simulation& simulation, const MapperResult& result) {
  ASSERT_FALSE(result.models.empty());
  for (const MapperModel& model : result.models) {
    EXPECT_LT(CompareModels(simulation.scene, model.reconstruction,
                            simulation.ground_truth)
                  .max_position,
              0.3);
  }
}

// Parallel streets: rotations do not contradict the copies.
class GrowthAliasingTest : public testing::TestWithParam<RigPreset> {
 protected:
  GrowthAliasingTest()
      : simulation_(Simulate(Drive(GetParam(), PathPreset::kStraight))) {}

  Simulation simulation_;
};

// Frames beyond the cut see fewer points than others need.
TEST_P(GrowthAliasingTest, AWeakCutDoesNotStopGrowth) {
  Weaken(kFirstAfterCut, &simulation_);
  const MapperResult result = RunIncrementalMapper(
      {simulation_.scene, simulation_.view_graph}, MapperOptions(), Context());
  EXPECT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  ExpectRight(simulation_, result);
}

// More matches join the copies than the frames beside the cut.
TEST_P(GrowthAliasingTest, EqualFacadesDoNotJoinPartsThatGrow) {
  Weaken(kFirstAfterCut, &simulation_);
  CopyMaker(kCopies, &simulation_).Run();
  const MapperResult result = RunIncrementalMapper(
      {simulation_.scene, simulation_.view_graph}, MapperOptions(), Context());
  EXPECT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  ExpectRight(simulation_, result);
}

TEST_P(GrowthAliasingTest, EqualFacadesDoNotExtendAModel) {
  Weaken(kFirstAfterCut, &simulation_);
  CopyMaker(kCopies, &simulation_).Run();
  ExpectRight(simulation_, ExtendFirstHalf(simulation_));
}

TEST_P(GrowthAliasingTest, EqualFacadesDoNotStopAnExtension) {
  CopyMaker(kCopies, &simulation_).Run();
  const MapperResult result = ExtendFirstHalf(simulation_);
  EXPECT_TRUE(result.unregistered_frames.empty());
  ExpectRight(simulation_, result);
}

// Pairs that fail verification do not show how long points stay in view.
TEST(GrowthAliasing, UnverifiedPairsDoNotHideEqualFacades) {
  Simulation simulation =
      Simulate(Drive(RigPreset::kMono, PathPreset::kStraight));
  Weaken(kFirstAfterCut, &simulation);
  CopyMaker(kCopies, &simulation).Run();
  AddWrongMatches(&simulation);
  ExpectRight(simulation, ExtendFirstHalf(simulation));
}

INSTANTIATE_TEST_SUITE_P(Rigs, GrowthAliasingTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360));

}  // namespace
}  // namespace mgsfm
