// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "matching/dot_tiles.h"
#include "mgsfm/matching/descriptor_matching.h"

namespace mgsfm::internal {

// Enters all dot products of num_rows rows and num_columns columns, packed as
// `functions` wants them, into the nearest of both, which are cleared.
template <class Row, class Column>
void FindTwoNearestOfPacked(const TileFunctions<Row, Column>& functions,
                            const std::vector<Row>& rows, size_t num_rows,
                            const std::vector<Column>& columns,
                            size_t num_columns,
                            std::vector<TwoNearest>* nearest_of_rows,
                            std::vector<TwoNearest>* nearest_of_columns);

// Rows one after the other, filled up with zeros to whole tiles.
template <class Row>
std::vector<Row> PackRows(DescriptorView descriptors) {
  const size_t num_tiles = (descriptors.size + kTileRows - 1) / kTileRows;
  std::vector<Row> rows(num_tiles * kTileRows * kNumDims, 0);
  std::copy_n(descriptors.data, descriptors.size * kNumDims, rows.begin());
  return rows;
}

// Columns in blocks, likewise; value(i, k) is dimension k of descriptor i.
// Factors stay zero.
template <class Functions, class Column, class Value>
std::vector<Column> PackColumns(size_t size, const Value& value) {
  constexpr size_t kGroupSize = Functions::kGroupSize;
  const size_t num_blocks = (size + kTileColumns - 1) / kTileColumns;
  std::vector<Column> blocks(num_blocks * Functions::kBlockSize, 0);
  for (size_t i = 0; i < size; ++i) {
    Column* block = blocks.data() + i / kTileColumns * Functions::kBlockSize;
    const size_t column = i % kTileColumns;
    for (size_t group = 0; group < kNumDims / kGroupSize; ++group) {
      for (size_t k = 0; k < kGroupSize; ++k) {
        block[(group * kTileColumns + column) * kGroupSize + k] =
            value(i, group * kGroupSize + k);
      }
    }
  }
  return blocks;
}

}  // namespace mgsfm::internal
