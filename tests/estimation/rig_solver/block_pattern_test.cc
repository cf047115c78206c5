// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/block_pattern.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <vector>

namespace mgsfm {
namespace {

TEST(BlockPatternTest, FindReturnsThePlacesOfBlocks) {
  const std::vector<int> sizes = {3, 6, 1, 4};
  const std::vector<BlockPairKey> pairs = {
      MakeBlockPairKey(0, 0), MakeBlockPairKey(0, 2), MakeBlockPairKey(1, 1),
      MakeBlockPairKey(1, 3), MakeBlockPairKey(2, 2), MakeBlockPairKey(2, 3),
      MakeBlockPairKey(3, 3)};
  const BlockPattern pattern(sizes, pairs);
  EXPECT_EQ(pattern.num_rows(), 14);
  Eigen::SparseMatrix<double> matrix = pattern.MakeMatrix();
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(14, 14);
  const std::vector<int> first = {0, 3, 9, 10};
  double value = 1.0;
  for (const BlockPairKey key : pairs) {
    const int column = ColumnOf(key), row = RowOf(key);
    const auto [position, stride] = pattern.Find(column, row);
    for (int j = 0; j < sizes[column]; ++j) {
      for (int i = 0; i < sizes[row]; ++i) {
        matrix.valuePtr()[position + static_cast<size_t>(j) * stride + i] =
            value;
        expected(first[row] + i, first[column] + j) = value++;
      }
    }
  }
  EXPECT_EQ(Eigen::MatrixXd(matrix), expected);
}

TEST(BlockPatternTest, ContainsOnlyTheGivenPairs) {
  const BlockPattern pattern({2, 2, 2},
                             {MakeBlockPairKey(0, 0), MakeBlockPairKey(0, 2),
                              MakeBlockPairKey(1, 1), MakeBlockPairKey(2, 2)});
  EXPECT_TRUE(pattern.Contains(0, 2));
  EXPECT_FALSE(pattern.Contains(0, 1));
  EXPECT_FALSE(pattern.Contains(1, 2));
}

TEST(BlockPatternTest, EmptyPattern) {
  EXPECT_EQ(BlockPattern().num_rows(), 0);
  EXPECT_EQ(BlockPattern().MakeMatrix().nonZeros(), 0);
}

}  // namespace
}  // namespace mgsfm
