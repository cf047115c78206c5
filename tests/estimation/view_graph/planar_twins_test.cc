// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "view_graph/pair_estimation.h"

namespace mgsfm::internal {
namespace {

Eigen::Vector3d RandomTurn(double angle_rad, Random* random) {
  return angle_rad *
         Eigen::Vector3d(random->Normal(), random->Normal(), random->Normal());
}

// Pairs of images with random rotations. The share `share_wrong` of the pairs
// has the right motion as its twin, and all others a wrong twin.
struct Case {
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<PairEstimate> estimates;
};

Case MakeCase(int num_images, double share_wrong, Random* random) {
  Case result;
  for (int i = 0; i < num_images; ++i) {
    result.rotations.push_back(ExpSO3(RandomTurn(1.0, random)));
  }
  for (int i = 0; i < num_images; ++i) {
    for (int j = i + 1; j < std::min(i + 5, num_images); ++j) {
      const Eigen::Quaterniond right = ExpSO3(RandomTurn(0.005, random)) *
                                       result.rotations[j] *
                                       result.rotations[i].conjugate();
      const Eigen::Quaterniond wrong = ExpSO3(RandomTurn(0.2, random)) * right;
      PairEstimate estimate;
      estimate.outcome = PairOutcome::kFromRow;
      estimate.pair.image_idx1 = i;
      estimate.pair.image_idx2 = j;
      estimate.twin = estimate.pair;
      estimate.pair.relative_pose = {right, std::nullopt};
      estimate.twin->relative_pose = {wrong, std::nullopt};
      if (random->Uniform() < share_wrong) {
        std::swap(estimate.pair, *estimate.twin);
      }
      result.estimates.push_back(std::move(estimate));
    }
  }
  return result;
}

double ErrorOf(const ImagePair& pair, const Case& test_case) {
  return AngleBetween(pair.relative_pose->cam2_from_cam1,
                      test_case.rotations[pair.image_idx2] *
                          test_case.rotations[pair.image_idx1].conjugate());
}

TEST(PlanarTwinsTest, TrianglesTellWhichMotionIsRight) {
  Random random(1);
  int num_right = 0, num_pairs = 0;
  for (int trial = 0; trial < 10; ++trial) {
    Case test_case = MakeCase(/*num_images=*/20, /*share_wrong=*/0.35, &random);
    ChooseTwins(&test_case.estimates);
    for (const PairEstimate& estimate : test_case.estimates) {
      num_right += ErrorOf(estimate.pair, test_case) <
                   ErrorOf(*estimate.twin, test_case);
      ++num_pairs;
    }
  }
  EXPECT_GE(num_right, 0.98 * num_pairs);
}

TEST(PlanarTwinsTest, OrderOfImagesAndPairsDoesNotMatter) {
  Random random(2);
  constexpr int kNumImages = 12;
  Case test_case = MakeCase(kNumImages, 0.4, &random);
  std::vector<int> new_idx(kNumImages);
  std::iota(new_idx.begin(), new_idx.end(), 0);
  for (int i = kNumImages - 1; i > 0; --i) {
    std::swap(new_idx[i], new_idx[random.Index(static_cast<uint32_t>(i) + 1)]);
  }
  std::vector<PairEstimate> renamed = test_case.estimates;
  for (PairEstimate& estimate : renamed) {
    for (ImagePair* pair : {&estimate.pair, &*estimate.twin}) {
      pair->image_idx1 = new_idx[pair->image_idx1];
      pair->image_idx2 = new_idx[pair->image_idx2];
      if (pair->image_idx1 < pair->image_idx2) continue;
      std::swap(pair->image_idx1, pair->image_idx2);
      auto& rotation = pair->relative_pose->cam2_from_cam1;
      rotation = rotation.conjugate();
    }
  }
  std::reverse(renamed.begin(), renamed.end());
  ChooseTwins(&test_case.estimates);
  ChooseTwins(&renamed);
  std::reverse(renamed.begin(), renamed.end());
  for (size_t i = 0; i < renamed.size(); ++i) {
    const auto angle = [](const ImagePair& pair) {
      return Eigen::AngleAxisd(pair.relative_pose->cam2_from_cam1).angle();
    };
    EXPECT_NEAR(angle(renamed[i].pair), angle(test_case.estimates[i].pair),
                1e-12);
  }
}

TEST(PlanarTwinsTest, WithoutTrianglesTheSmallerCostDecides) {
  Random random(3);
  Case test_case = MakeCase(/*num_images=*/2, /*share_wrong=*/1.0, &random);
  ChooseTwins(&test_case.estimates);
  EXPECT_GT(ErrorOf(test_case.estimates[0].pair, test_case),
            ErrorOf(*test_case.estimates[0].twin, test_case));
}

}  // namespace
}  // namespace mgsfm::internal
