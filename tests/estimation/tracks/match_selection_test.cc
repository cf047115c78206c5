// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/simulator/simulation.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {
namespace {

constexpr double kMaxErrorPx = 3.0;

Simulation Drive(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 12;
  options.num_points_per_frame = 150;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.5;
  return Simulate(options);
}

MatchSelection Select(const Simulation& simulation, const ViewGraph& view_graph,
                      const MatchSelectionOptions& options = {},
                      int num_threads = 2) {
  Context context;
  context.num_threads = num_threads;
  return SelectConsistentMatches(
      {simulation.scene, view_graph, Mask(view_graph.pairs.size(), true),
       simulation.ground_truth},
      kMaxErrorPx, options, context);
}

// The pair with its matches shifted by one, so that hardly any is correct.
void Scramble(ImagePair* pair) {
  const std::vector<Match> matches = pair->matches;
  for (size_t i = 0; i < matches.size(); ++i) {
    pair->matches[i].keypoint_idx2 =
        matches[(i + 1) % matches.size()].keypoint_idx2;
  }
}

class MatchSelectionTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {
 protected:
  const Simulation simulation_ =
      Drive(std::get<0>(GetParam()), std::get<1>(GetParam()));
};

TEST_P(MatchSelectionTest, KeepsTrueMatches) {
  const MatchSelection selection = Select(simulation_, simulation_.view_graph);
  size_t num_used = 0;
  for (const char used : selection.match_is_used) num_used += used;
  ASSERT_GT(selection.match_is_used.size(), 0u);
  // Errors of six standard deviations do not occur.
  EXPECT_EQ(num_used, selection.match_is_used.size());
  for (const char used : selection.pair_is_used) EXPECT_TRUE(used);
}

TEST_P(MatchSelectionTest, RejectsPairsOfDifferentPlaces) {
  ViewGraph view_graph = simulation_.view_graph;
  Mask is_scrambled(view_graph.pairs.size(), false);
  const std::vector<Image>& images = simulation_.scene.images;
  // All image pairs of some pairs of frames.
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    ImagePair& pair = view_graph.pairs[i];
    const int sum =
        images[pair.image_idx1].frame_idx + images[pair.image_idx2].frame_idx;
    if (sum % 7 != 0 || pair.matches.size() < 10) continue;
    is_scrambled[i] = true;
    Scramble(&pair);
  }
  const MatchSelection selection = Select(simulation_, view_graph);
  size_t num_scrambled = 0, num_scrambled_used = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (is_scrambled[i]) {
      ++num_scrambled;
      num_scrambled_used += selection.pair_is_used[i];
    } else if (view_graph.pairs[i].matches.size() >= 10) {
      EXPECT_TRUE(selection.pair_is_used[i]) << "pair " << i;
    }
  }
  ASSERT_GT(num_scrambled, 0u);
  EXPECT_EQ(num_scrambled_used, 0u);
}

INSTANTIATE_TEST_SUITE_P(
    Rigs, MatchSelectionTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kCurve,
                                     PathPreset::kStanding)));

// One wrong image pair does not outvote the others of its frames, but its
// matches are not used.
TEST(SelectConsistentMatchesTest, RigVotesJointly) {
  const Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kCurve);
  ViewGraph view_graph = simulation.view_graph;
  const std::vector<Image>& images = simulation.scene.images;
  size_t wrong = view_graph.pairs.size();
  size_t first_match = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (images[pair.image_idx1].frame_idx == 3 &&
        images[pair.image_idx2].frame_idx == 4) {
      wrong = i;
      break;
    }
    first_match += pair.matches.size();
  }
  ASSERT_LT(wrong, view_graph.pairs.size());
  Scramble(&view_graph.pairs[wrong]);
  const MatchSelection selection = Select(simulation, view_graph);
  EXPECT_TRUE(selection.pair_is_used[wrong]);
  const size_t num_matches = view_graph.pairs[wrong].matches.size();
  size_t num_used = 0;
  for (size_t k = 0; k < num_matches; ++k) {
    num_used += selection.match_is_used[first_match + k];
  }
  EXPECT_LT(num_used, num_matches / 5);
}

TEST(SelectConsistentMatchesTest, UnknownPosesAndUnusedPairs) {
  Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kCurve);
  simulation.ground_truth.rig_from_world[5].reset();
  const ViewGraph& view_graph = simulation.view_graph;
  Mask pair_is_used(view_graph.pairs.size(), true);
  pair_is_used[0] = false;
  const MatchSelection selection = SelectConsistentMatches(
      {simulation.scene, view_graph, pair_is_used, simulation.ground_truth},
      kMaxErrorPx, {}, {});
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const bool is_known =
        simulation.scene.images[pair.image_idx1].frame_idx != 5 &&
        simulation.scene.images[pair.image_idx2].frame_idx != 5;
    EXPECT_EQ(selection.pair_is_used[i] != 0, i != 0 && is_known);
  }
}

TEST(SelectConsistentMatchesTest, ThreadsDoNotMatter) {
  const Simulation simulation = Drive(RigPreset::kKitti360, PathPreset::kCurve);
  ViewGraph view_graph = simulation.view_graph;
  for (size_t i = 0; i < view_graph.pairs.size(); i += 3) {
    if (!view_graph.pairs[i].matches.empty()) Scramble(&view_graph.pairs[i]);
  }
  const MatchSelection one = Select(simulation, view_graph, {}, 1);
  const MatchSelection two = Select(simulation, view_graph, {}, 2);
  EXPECT_EQ(one.pair_is_used, two.pair_is_used);
  EXPECT_EQ(one.match_is_used, two.match_is_used);
}

// Without the vote, only matches are rejected.
TEST(SelectConsistentMatchesTest, ShareOfZeroKeepsPairs) {
  const Simulation simulation = Drive(RigPreset::kStereo, PathPreset::kCurve);
  ViewGraph view_graph = simulation.view_graph;
  for (ImagePair& pair : view_graph.pairs) Scramble(&pair);
  MatchSelectionOptions options;
  options.min_pair_share = 0.0;
  const MatchSelection selection = Select(simulation, view_graph, options);
  for (const char used : selection.pair_is_used) EXPECT_TRUE(used);
}

}  // namespace
}  // namespace mgsfm
