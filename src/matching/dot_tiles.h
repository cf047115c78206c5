// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

namespace mgsfm::internal {

// Dot products of descriptors in tiles of kTileRows x kTileColumns, and the two
// largest of each row and column. The descriptors of the rows follow each
// other; those of the columns are in blocks of kTileColumns,
// [group of dimensions][column][dimension of the group].
constexpr int kTileRows = 4;
constexpr int kTileColumns = 16;
constexpr int kNumDims = 128;

// A dot product, at most 128 * 255^2 < 2^23, and which one it is as one number,
// such that the larger is the larger product, or the first of equal ones:
// dot * 256 + 255 - position, for up to 256 positions. Negative for none.
constexpr int kMaxNumPositions = 256;

inline int32_t CodedDot(int32_t coded) { return coded >> 8; }
inline int32_t CodedPosition(int32_t coded) { return 255 - (coded & 255); }

// The two largest coded products of kTileColumns columns, or of one row in as
// many parts.
struct TopTwoLanes {
  int32_t best[kTileColumns];
  int32_t second[kTileColumns];

  void Clear();
};

// For rows and columns of these types; groups of dimensions have the width of
// 32 bits.
template <class Row, class Column>
struct TileFunctions {
  static constexpr size_t kGroupSize = sizeof(int32_t) / sizeof(Column);
  static constexpr size_t kNumValues = size_t{kTileColumns} * kNumDims;
  // Elements of a block; a block of bytes ends with a factor for each column.
  static constexpr size_t kBlockSize =
      kNumValues + (kGroupSize == 4 ? kTileColumns * sizeof(int32_t) : 0);

  // tile[r * kTileColumns + c] = rows[r] . columns[c].
  void (*multiply)(const Row* rows, const Column* columns, int32_t* tile);
  // Enters a tile. The positions of its first row, and of its block of columns,
  // are those of the codes.
  void (*update)(const int32_t* tile, int first_row, int block,
                 TopTwoLanes* of_rows, TopTwoLanes* of_columns);
};

// Bytes, widened.
using ExactTileFunctions = TileFunctions<int16_t, int16_t>;
// Bytes and bytes below 65 whose dot products are all below 2^16; these are
// multiplied with the factor of the column, below 2^15, and divided by
// 2^kFactorBits.
using RoughTileFunctions = TileFunctions<uint8_t, int8_t>;
constexpr int kFactorBits = 12;

// All exact ones give the same numbers.
ExactTileFunctions PortableTileFunctions();
ExactTileFunctions FastestTileFunctions();  // for this processor
// Twice as fast; nullopt if this processor has no AVX2.
std::optional<RoughTileFunctions> FindRoughTileFunctions();

}  // namespace mgsfm::internal
