// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "estimation/rig_solver/rig_fixtures.h"
#include "mgsfm/base/mask.h"
#include "rig_solver/preconditioner_pattern.h"

namespace mgsfm {
namespace {

constexpr int kNumKept = 3;

RigSceneOptions Options() {
  RigSceneOptions options;
  options.cameras = {PerspectiveTestCameras()[0]};
  options.num_frames = 14;
  options.num_points = 80;
  options.num_frames_of_point = 9;
  return options;
}

// A scene with one camera, so that blocks are frames, with points and terms.
struct CutScene {
  explicit CutScene(const std::vector<BlockPairKey>& inseparable = {})
      : scene(MakeRayScene(Options(), 0.0)),
        structure(scene.problem, ImagesOfObservations(),
                  {ReducedSolver::kDirect}, 1) {
    const Mask no_border(structure.block_size.size(), false);
    PointPartitioner(true, no_border, inseparable, 1, &structure).Cut(kNumKept);
  }

  std::vector<int> ImagesOfObservations() const {
    std::vector<int> images;
    for (const RayObservation& o : scene.problem.observations) {
      images.push_back(o.image);
    }
    return images;
  }
  // kNoBlock if the frame is constant.
  int BlockOfImage(int image) const {
    return structure.frame_block[scene.problem.images[image].frame];
  }
  int ImageOf(const ChunkRanges& chunk, int position) const {
    return structure.chunk_images[chunk.images.begin + position].image;
  }

  // Counts shared points and terms, and returns the pairs of each block with
  // the kNumKept others that have the largest counts.
  std::set<std::pair<int, int>> PreconditionerPatternByCounting() const {
    std::map<std::pair<int, int>, int> count;
    const auto add = [&](const std::set<int>& blocks) {
      for (const int a : blocks) {
        for (const int b : blocks) {
          if (a != b && a >= 0 && b >= 0) ++count[{a, b}];
        }
      }
    };
    for (size_t p = 0; p < scene.problem.num_points(); ++p) {
      std::set<int> blocks;
      for (size_t o = scene.problem.point_begin[p];
           o < scene.problem.point_begin[p + 1]; ++o) {
        blocks.insert(BlockOfImage(scene.problem.observations[o].image));
      }
      add(blocks);
    }
    for (const BaselineTerm& term : scene.problem.baselines) {
      add({BlockOfImage(term.image1), BlockOfImage(term.image2)});
    }
    std::set<std::pair<int, int>> strong;
    const int num_blocks = static_cast<int>(structure.block_size.size());
    for (int a = 0; a < num_blocks; ++a) {
      std::vector<int> others;
      for (int b = 0; b < num_blocks; ++b) {
        if (count[{a, b}] > 0) others.push_back(b);
      }
      std::stable_sort(others.begin(), others.end(), [&](int b, int c) {
        return std::make_pair(-count[{a, b}], std::abs(a - b)) <
               std::make_pair(-count[{a, c}], std::abs(a - c));
      });
      others.resize(std::min<size_t>(others.size(), kNumKept));
      for (const int b : others)
        strong.insert({std::min(a, b), std::max(a, b)});
    }
    return strong;
  }

  RigScene<RayObservation> scene;
  RigStructure structure;
};

TEST(PointPartitionerTest, BlocksOfAPartAreStrongPairs) {
  const CutScene cut;
  const RigStructure& s = cut.structure;
  const auto strong = cut.PreconditionerPatternByCounting();
  size_t num_components = 0;
  for (const ChunkRanges& chunk : s.chunks) {
    for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
      std::vector<int> part, images;
      for (size_t k = s.point_begin[p]; k < s.point_begin[p + 1]; ++k) {
        if (s.observation_starts_part[k]) {
          part.clear();
          ++num_components;
        }
        images.push_back(cut.ImageOf(chunk, s.observation_image[k]));
        const int block = cut.BlockOfImage(images.back());
        for (const int other : part) {
          if (block < 0 || other < 0 || block == other) continue;
          EXPECT_TRUE(strong.count(std::minmax(block, other)))
              << block << " " << other;
        }
        part.push_back(block);
      }
      // No observation is lost or duplicated.
      std::vector<int> expected;
      const int point = s.point_order[p];
      for (size_t o = cut.scene.problem.point_begin[point];
           o < cut.scene.problem.point_begin[point + 1]; ++o) {
        expected.push_back(cut.scene.problem.observations[o].image);
      }
      EXPECT_TRUE(std::is_permutation(images.begin(), images.end(),
                                      expected.begin(), expected.end()));
    }
  }
  EXPECT_GT(num_components, cut.scene.problem.num_points() / 2);
}

TEST(PointPartitionerTest, TermsAreCutUnlessTheirImagesAreAStrongPair) {
  const CutScene cut;
  const RigStructure& s = cut.structure;
  const auto strong = cut.PreconditionerPatternByCounting();
  int num_cut = 0;
  ASSERT_EQ(s.term_is_cut.size(), cut.scene.problem.baselines.size());
  for (size_t t = 0; t < s.term_is_cut.size(); ++t) {
    const BaselineTerm& term = cut.scene.problem.baselines[s.term_order[t]];
    const int a = cut.BlockOfImage(term.image1);
    const int b = cut.BlockOfImage(term.image2);
    const bool is_weak =
        a >= 0 && b >= 0 && a != b && strong.count(std::minmax(a, b)) == 0;
    EXPECT_EQ(s.term_is_cut[t] != 0, is_weak) << a << " " << b;
    num_cut += is_weak;
  }
  EXPECT_GT(num_cut, 0);
}

TEST(PointPartitionerTest, InseparablePairsAreNotCut) {
  const CutScene free;
  const RigStructure& s = free.structure;
  const auto first_cut =
      std::find(s.term_is_cut.begin(), s.term_is_cut.end(), char{true});
  ASSERT_NE(first_cut, s.term_is_cut.end());
  const size_t t = first_cut - s.term_is_cut.begin();
  const BaselineTerm& term = free.scene.problem.baselines[s.term_order[t]];
  const auto [a, b] = std::minmax(
      {free.BlockOfImage(term.image1), free.BlockOfImage(term.image2)});
  const CutScene tied({MakeBlockPairKey(a, b)});
  EXPECT_FALSE(tied.structure.term_is_cut[t]);
}

}  // namespace
}  // namespace mgsfm
