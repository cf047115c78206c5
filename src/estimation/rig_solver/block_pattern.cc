// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/block_pattern.h"

#include <algorithm>
#include <limits>

#include "mgsfm/base/error.h"

namespace mgsfm {

BlockPattern::BlockPattern(const std::vector<int>& sizes,
                           const std::vector<BlockPairKey>& pairs)
    : first_(sizes.size() + 1, 0),
      column_begin_(sizes.size() + 1, 0),
      first_value_(sizes.size() + 1, 0),
      height_(sizes.size(), 0) {
  for (size_t b = 0; b < sizes.size(); ++b)
    first_[b + 1] = first_[b] + sizes[b];
  row_block_.reserve(pairs.size());
  row_offset_.reserve(pairs.size());
  for (const BlockPairKey key : pairs) {
    const int column = ColumnOf(key);
    ++column_begin_[column + 1];
    row_block_.push_back(RowOf(key));
    row_offset_.push_back(height_[column]);
    height_[column] += sizes[RowOf(key)];
  }
  for (size_t b = 0; b < sizes.size(); ++b) {
    column_begin_[b + 1] += column_begin_[b];
    first_value_[b + 1] =
        first_value_[b] + static_cast<size_t>(height_[b]) * sizes[b];
  }
}

size_t BlockPattern::Search(int column, int row) const {
  const auto end = row_block_.begin() + column_begin_[column + 1];
  return std::lower_bound(row_block_.begin() + column_begin_[column], end,
                          row) -
         row_block_.begin();
}

bool BlockPattern::Contains(int column, int row) const {
  const size_t k = Search(column, row);
  return k < column_begin_[column + 1] && row_block_[k] == row;
}

BlockPattern::Place BlockPattern::Find(int column, int row) const {
  const size_t k = Search(column, row);
  MGSFM_CHECK(k < column_begin_[column + 1] && row_block_[k] == row);
  return {first_value_[column] + row_offset_[k], height_[column]};
}

Eigen::SparseMatrix<double> BlockPattern::MakeMatrix() const {
  Eigen::SparseMatrix<double> matrix(num_rows(), num_rows());
  if (num_rows() == 0) return matrix;
  MGSFM_CHECK_LE(first_value_.back(),
                 static_cast<size_t>(std::numeric_limits<int>::max()));
  matrix.resizeNonZeros(static_cast<Eigen::Index>(first_value_.back()));
  int* column_begin = matrix.outerIndexPtr();
  int* rows = matrix.innerIndexPtr();
  *column_begin = 0;
  for (size_t b = 0; b < height_.size(); ++b) {
    for (int c = first_[b]; c < first_[b + 1]; ++c) {
      for (size_t k = column_begin_[b]; k < column_begin_[b + 1]; ++k) {
        const int row = row_block_[k];
        for (int r = first_[row]; r < first_[row + 1]; ++r) *rows++ = r;
      }
      ++column_begin;
      *column_begin = *(column_begin - 1) + height_[b];
    }
  }
  std::fill_n(matrix.valuePtr(), matrix.nonZeros(), 0.0);
  return matrix;
}

}  // namespace mgsfm
