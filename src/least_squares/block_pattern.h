// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCore>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/base/error.h"

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

// The places of the blocks of a symmetric block-sparse matrix in the values of
// a compressed sparse matrix of its lower triangle. Diagonal blocks are stored
// completely.
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
  // The rows of all columns in order, and where each column begins.
  struct Rows {
    std::vector<int> column_begin;
    std::vector<int> rows;
  };
  Rows MakeRows() const;

  // Moves the values to find_place(row, column), the Place of an entry of the
  // matrix in another array. Neither MakeMatrix() nor MakeRows() may
  // be called any more.
  template <class FindPlace>
  void MoveValues(const FindPlace& find_place);

  int num_rows() const { return first_.empty() ? 0 : first_.back(); }

 private:
  size_t Search(int column, int row) const;
  void ListRows(int* column_begin, int* rows) const;

  std::vector<int> first_;            // first row of each block, and the end
  std::vector<size_t> column_begin_;  // in row_block_
  std::vector<int> row_block_;
  std::vector<int> row_offset_;  // below the first row of the column
  std::vector<size_t> first_value_;
  std::vector<int> height_;
};

template <class FindPlace>
void BlockPattern::MoveValues(const FindPlace& find_place) {
  for (size_t b = 0; b < height_.size(); ++b) {
    const Place place = find_place(first_[b], first_[b]);
    first_value_[b] = place.position;
    height_[b] = place.stride;
    const int width = first_[b + 1] - first_[b];
    for (size_t k = column_begin_[b]; k < column_begin_[b + 1]; ++k) {
      const int row = row_block_[k];
      row_offset_[k] = static_cast<int>(
          find_place(first_[row], first_[b]).position - place.position);
      // A block stays in one piece.
      const int last = first_[row + 1] - 1;
      MGSFM_CHECK_EQ(find_place(last, first_[b] + width - 1).position,
                     place.position + row_offset_[k] + (last - first_[row]) +
                         static_cast<size_t>(width - 1) * place.stride);
    }
  }
}

}  // namespace mgsfm
