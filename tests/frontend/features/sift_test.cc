// SPDX-License-Identifier: BSD-3-Clause
#include "features/sift.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <utility>

#include "frontend/features/blob_images.h"

namespace mgsfm {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

Eigen::Vector2d PlaceOf(const FeatureKeypoint& keypoint) {
  return {keypoint.x_px, keypoint.y_px};
}

// The keypoint nearest to a point.
FeatureKeypoint Nearest(const Features& features,
                        const Eigen::Vector2d& place) {
  FeatureKeypoint nearest;
  double distance = std::numeric_limits<double>::infinity();
  for (const FeatureKeypoint& keypoint : features.keypoints) {
    if ((PlaceOf(keypoint) - place).norm() >= distance) continue;
    distance = (PlaceOf(keypoint) - place).norm();
    nearest = keypoint;
  }
  return nearest;
}

double SquaredDistance(const Features& a, Eigen::Index i, const Features& b,
                       Eigen::Index j) {
  return (a.descriptors.row(i).cast<float>() -
          b.descriptors.row(j).cast<float>())
      .squaredNorm();
}

// Nearest and second nearest descriptor in `b`.
struct Neighbor {
  int idx = -1;
  double distance = std::numeric_limits<double>::infinity();
  double second_distance = std::numeric_limits<double>::infinity();
};

Neighbor FindNeighbor(const Features& a, int i, const Features& b) {
  Neighbor neighbor;
  for (int j = 0; j < b.descriptors.rows(); ++j) {
    const double distance = std::sqrt(SquaredDistance(a, i, b, j));
    if (distance < neighbor.distance) {
      neighbor = {j, distance, neighbor.distance};
    } else if (distance < neighbor.second_distance) {
      neighbor.second_distance = distance;
    }
  }
  return neighbor;
}

// Mutual nearest neighbors that pass the ratio test.
std::vector<std::pair<int, int>> MatchFeatures(const Features& a,
                                               const Features& b) {
  std::vector<std::pair<int, int>> matches;
  for (int i = 0; i < a.descriptors.rows(); ++i) {
    const Neighbor neighbor = FindNeighbor(a, i, b);
    if (neighbor.distance < 0.8 * neighbor.second_distance &&
        FindNeighbor(b, neighbor.idx, a).idx == i) {
      matches.emplace_back(i, neighbor.idx);
    }
  }
  return matches;
}

// A blob of sigma s responds most to the difference of two Gaussians of sigma
// s / sqrt(k) and s sqrt(k) with k = 2^(1/3); keypoints have the former.
class SiftBlobTest : public testing::TestWithParam<double> {};

TEST_P(SiftBlobTest, HasCorrectPositionAndScale) {
  const double sigma = GetParam();
  for (const double contrast : {0.4, -0.4}) {
    // Odd image sizes and a position between pixels.
    const Blob blob{{120.3, 97.8}, sigma, contrast};
    const Features features = ExtractSift(RenderBlobs({blob}, 251, 203), {});
    ASSERT_FALSE(features.keypoints.empty());
    const FeatureKeypoint keypoint = Nearest(features, blob.center);
    EXPECT_LT((PlaceOf(keypoint) - blob.center).norm(), 0.02 * sigma + 0.02);
    const double expected_scale = sigma * std::exp2(-1.0 / 6.0);
    EXPECT_NEAR(keypoint.ScalePx(), expected_scale, 0.1 * expected_scale);
  }
}

INSTANTIATE_TEST_SUITE_P(Sigmas, SiftBlobTest,
                         testing::Values(1.5, 2.3, 3.7, 6.1, 11.0));

// Keypoints of one image are found at the corresponding positions of a rotated
// and scaled image, without bias, with consistent orientation and scale.
class SiftRepeatabilityTest
    : public testing::TestWithParam<std::pair<double, double>> {};

TEST_P(SiftRepeatabilityTest, MatchesRotatedAndScaledImages) {
  const double angle_rad = GetParam().first * kDegree;
  const double scale = GetParam().second;
  const std::vector<Blob> blobs = RandomBlobs(500, 240, 240, 3);
  Similarity similarity{scale, angle_rad, {0.0, 0.0}};
  similarity.translation =
      Eigen::Vector2d(211.0, 207.0) - similarity * Eigen::Vector2d(120, 120);
  const Features before = ExtractSift(RenderBlobs(blobs, 240, 240), {});
  const Features after =
      ExtractSift(RenderBlobs(blobs, 423, 415, similarity), {});
  const auto matches = MatchFeatures(before, after);

  int num_right = 0;
  Eigen::Vector2d sum_of_errors = Eigen::Vector2d::Zero();
  double sum_of_squares = 0.0;
  for (const auto& [i, j] : matches) {
    const FeatureKeypoint& a = before.keypoints[i];
    const FeatureKeypoint& b = after.keypoints[j];
    const Eigen::Vector2d error = PlaceOf(b) - similarity * PlaceOf(a);
    const double rotation_rad =
        b.OrientationRad() - a.OrientationRad() - similarity.angle_rad;
    const double scale_ratio = b.ScalePx() / a.ScalePx() / scale;
    if (error.norm() > 2.0 ||
        std::cos(rotation_rad) < std::cos(15.0 * kDegree) ||
        std::abs(std::log2(scale_ratio)) > 0.3) {
      continue;
    }
    ++num_right;
    sum_of_errors += error;
    sum_of_squares += error.squaredNorm();
  }
  EXPECT_GT(num_right, 100);
  EXPECT_GT(num_right, 0.97 * matches.size());
  EXPECT_LT((sum_of_errors / num_right).norm(), 0.05);
  EXPECT_LT(std::sqrt(sum_of_squares / num_right), 0.4 * std::max(1.0, scale));
}

INSTANTIATE_TEST_SUITE_P(
    AnglesAndScales, SiftRepeatabilityTest,
    testing::Values(std::pair(0.0, 1.0), std::pair(90.0, 1.0),
                    std::pair(180.0, 1.0), std::pair(37.0, 1.0),
                    std::pair(0.0, 1.6), std::pair(-100.0, 1.3),
                    std::pair(61.0, 0.7)));

class SiftTest : public testing::Test {
 protected:
  const GrayImage image_ = RenderBlobs(RandomBlobs(300, 200, 160, 5), 200, 160);
  const Features features_ = ExtractSift(image_, {});
};

TEST_F(SiftTest, DescriptorsAreRootNormalized) {
  ASSERT_GT(features_.keypoints.size(), 100u);
  ASSERT_EQ(features_.descriptors.rows(),
            static_cast<Eigen::Index>(features_.keypoints.size()));
  ASSERT_EQ(features_.descriptors.cols(), 128);
  for (Eigen::Index i = 0; i < features_.descriptors.rows(); ++i) {
    const auto row = features_.descriptors.row(i).cast<double>();
    // Rounding changes each of the 128 elements by at most one half; clipping
    // at 255 only shortens the descriptor.
    EXPECT_LT(row.norm(), 512.0 + 0.5 * std::sqrt(128.0));
    if (row.maxCoeff() < 255) {
      EXPECT_GT(row.norm(), 512.0 - 0.5 * std::sqrt(128.0));
    }
  }
}

TEST_F(SiftTest, LargestAreFirstAndKept) {
  for (size_t i = 1; i < features_.keypoints.size(); ++i) {
    EXPECT_LE(features_.keypoints[i].ScalePx(),
              features_.keypoints[i - 1].ScalePx() * 1.00001f);
  }
  SiftOptions options;
  options.max_num_features = 40;
  const Features largest = ExtractSift(image_, options);
  ASSERT_EQ(largest.keypoints.size(), 40u);
  EXPECT_EQ(largest.descriptors, features_.descriptors.topRows(40));
  for (int i = 0; i < 40; ++i) {
    EXPECT_EQ(PlaceOf(largest.keypoints[i]), PlaceOf(features_.keypoints[i]));
  }
}

TEST_F(SiftTest, ScalesLargeImagesDown) {
  // 401 px become 150 px, so the scales in x and y differ slightly.
  const Blob blob{{220.4, 131.7}, 9.0, 0.4};
  SiftOptions options;
  options.max_image_size = 150;
  const Features features = ExtractSift(RenderBlobs({blob}, 401, 299), options);
  const FeatureKeypoint keypoint = Nearest(features, blob.center);
  EXPECT_LT((PlaceOf(keypoint) - blob.center).norm(), 0.3);
  EXPECT_NEAR(keypoint.ScalePx(), blob.sigma * std::exp2(-1.0 / 6.0), 1.2);
}

TEST_F(SiftTest, ContrastOfTheImageDoesNotChangeDescriptors) {
  const GrayImage darker =
      (image_.cast<float>().array() * 0.5f).cast<uint8_t>();
  const Features features = ExtractSift(darker, {});
  const auto matches = MatchFeatures(features, features_);
  EXPECT_GT(matches.size(), 0.8 * features.keypoints.size());
  for (const auto& [i, j] : matches) {
    EXPECT_LT((PlaceOf(features.keypoints[i]) - PlaceOf(features_.keypoints[j]))
                  .norm(),
              2.0);
  }
}

TEST_F(SiftTest, OptionsHaveAnEffect) {
  const auto count = [&](const auto& change) {
    SiftOptions options;
    change(&options);
    return ExtractSift(image_, options).keypoints.size();
  };
  const size_t num = features_.keypoints.size();
  EXPECT_LT(count([](auto* o) { o->peak_threshold = 0.03; }), num);
  EXPECT_LT(count([](auto* o) { o->edge_threshold = 2.0; }), num);
  EXPECT_LT(count([](auto* o) { o->num_octaves = 1; }), num);
  EXPECT_LT(count([](auto* o) { o->max_num_orientations = 1; }), num);
  EXPECT_NE(count([](auto* o) { o->octave_resolution = 5; }), num);
}

TEST(SiftSizeTest, ConstantImagesHaveNoFeatures) {
  for (const auto& [rows, cols] :
       {std::pair(0, 0), std::pair(1, 1), std::pair(1, 300), std::pair(7, 9),
        std::pair(100, 100)}) {
    const Features features =
        ExtractSift(GrayImage::Constant(rows, cols, 130), {});
    EXPECT_TRUE(features.keypoints.empty());
    EXPECT_EQ(features.descriptors.rows(), 0);
  }
}

// Pixels are visited in rows, so that a transposed image visits others
// together. Only sums of blurred pixels are rounded differently.
TEST(SiftSizeTest, TransposedImagesHaveTransposedKeypoints) {
  for (int width = 90; width < 98; ++width) {
    const GrayImage image =
        RenderBlobs(RandomBlobs(150, width, 71, 7), width, 71);
    const Features features = ExtractSift(image, {});
    const Features transposed = ExtractSift(image.transpose(), {});
    ASSERT_GT(features.keypoints.size(), 30u);
    ASSERT_EQ(features.keypoints.size(), transposed.keypoints.size());
    for (const FeatureKeypoint& keypoint : features.keypoints) {
      const Eigen::Vector2d place = PlaceOf(keypoint).reverse();
      EXPECT_LT((PlaceOf(Nearest(transposed, place)) - place).norm(), 1e-2);
    }
  }
}

// Noise has extrema everywhere, including the borders.
TEST(SiftSizeTest, AcceptsImagesOfAnySize) {
  Random random(1);
  for (const auto& [rows, cols] :
       {std::pair(2, 2), std::pair(4, 5), std::pair(3, 200), std::pair(17, 16),
        std::pair(65, 33)}) {
    GrayImage image(rows, cols);
    for (auto& pixel : image.reshaped()) {
      pixel = static_cast<uint8_t>(random.Index(256));
    }
    for (const FeatureKeypoint& keypoint : ExtractSift(image, {}).keypoints) {
      EXPECT_GE(keypoint.x_px, 0.0f);
      EXPECT_LE(keypoint.x_px, static_cast<float>(cols) + 0.5f);
      EXPECT_GE(keypoint.y_px, 0.0f);
      EXPECT_LE(keypoint.y_px, static_cast<float>(rows) + 0.5f);
      EXPECT_GT(keypoint.ScalePx(), 0.0f);
    }
  }
}

}  // namespace
}  // namespace mgsfm
