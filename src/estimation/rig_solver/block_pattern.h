// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCore>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mgsfm {

// A pair of blocks as one number that sorts by column, then by row.
using BlockPairKey = uint64_t;

inline BlockPairKey MakeBlockPairKey(int column, int row) {
  return static_cast<uint64_t>(column) << 32 | static_cast<uint32_t>(row);
}
inline int ColumnOf(BlockPairKey key) { return static_cast<int>(key >> 32); }
inline int RowOf(BlockPairKey key) {
  return static_cast<int>(key & 0xffffffffu);
}

// The positions of the blocks of a symmetric block-sparse matrix in the values
// of a compressed sparse matrix of its lower triangle. Diagonal blocks are
// stored completely.
class BlockPattern {
 public:
  BlockPattern() = default;
  // `pairs` are the nonzero blocks (column, row) with row >= column, sorted and
  // including the diagonal.
  BlockPattern(const std::vector<int>& sizes,
               const std::vector<BlockPairKey>& pairs);

  struct Place {
    size_t position;  // of its first value
    int stride;       // from column to column
  };
  // Logarithmic in the rows of the column.
  bool Contains(int column, int row) const;
  // The block must be in the pattern.
  Place Find(int column, int row) const;

  // A matrix with this pattern and zero values.
  Eigen::SparseMatrix<double> MakeMatrix() const;

  int num_rows() const { return first_.empty() ? 0 : first_.back(); }

 private:
  size_t Search(int column, int row) const;

  std::vector<int> first_;            // first row of each block, and the end
  std::vector<size_t> column_begin_;  // in row_block_
  std::vector<int> row_block_;
  std::vector<int> row_offset_;  // below the first row of the column
  std::vector<size_t> first_value_;
  std::vector<int> height_;
};

}  // namespace mgsfm
