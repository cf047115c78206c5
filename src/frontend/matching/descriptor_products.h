// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mgsfm {

// Dot products of descriptors in tiles of kTileRows x kTileColumns, and the two
// largest products of each row and column. Row descriptors are contiguous;
// column descriptors are stored in blocks of kTileColumns as [group of
// dimensions][column][dimension within the group].
constexpr int kTileRows = 8;
constexpr int kTileColumns = 16;
constexpr int kNumDims = 128;

// A dot product (at most 128 * 255^2 < 2^23) and its position in one integer:
//   dot * 256 + 255 - position, for up to 256 positions.
// A larger code means a larger product or the first of equal products. Codes
// are non-negative, so the kernels use -1 for "none" and take plain maxima.
constexpr int kMaxNumPositions = 256;

inline int32_t CodedDot(int32_t coded) { return coded >> 8; }
inline int32_t CodedPosition(int32_t coded) { return 255 - (coded & 255); }

// The two largest codes of each of kTileColumns columns, or of one row in each
// of kTileColumns lanes.
struct TopTwoLanes {
  int32_t best[kTileColumns];
  int32_t second[kTileColumns];
};

// Kernels for one pair of element types. A group of dimensions has 32 bits.
template <class Row, class Column>
struct TileFunctions {
  static constexpr size_t kGroupSize = sizeof(int32_t) / sizeof(Column);
  static constexpr size_t kNumValues = size_t{kTileColumns} * kNumDims;
  // Elements per block; a block of bytes ends with a 32-bit number per
  // column.
  static constexpr size_t kBlockSize =
      kNumValues + (kGroupSize == 4 ? kTileColumns * sizeof(int32_t) : 0);

  // tile[r * kTileColumns + c] = rows[r] . columns[c] for `num_rows` rows, a
  // divisor of kTileRows.
  int num_rows = 0;
  void (*multiply)(const Row* rows, const Column* columns,
                   int32_t* tile) = nullptr;
  // Updates the two largest codes with a tile. `first_row` and `block` are the
  // positions in the codes of its first row and of its block of columns.
  void (*update)(const int32_t* tile, int first_row, int block,
                 TopTwoLanes* of_rows, TopTwoLanes* of_columns) = nullptr;
};

// Exact, because all sums are integers below 2^24.
using FloatTileFunctions = TileFunctions<float, float>;
// Bytes minus 128, and bytes; exact. The number of a column is 128 times the
// sum of its elements.
using ByteTileFunctions = TileFunctions<int8_t, uint8_t>;
// Bytes and bytes below 65 whose dot products are all below 2^16. The products
// are multiplied by the factor of the column, below 2^15, and divided by
// 2^kFactorBits.
using RoughTileFunctions = TileFunctions<uint8_t, int8_t>;
// The factors are at most 6 (nearest_two.cc), so with 12 bits they stay
// below 2^15; with 13 bits they would not.
constexpr int kFactorBits = 12;

// From the slowest to the fastest.
enum class InstructionSet { kPortable, kAvx2, kAvx512Vnni };

// Those of this processor.
std::vector<InstructionSet> InstructionSets();
InstructionSet FastestInstructionSet();

// The kernels of a set; `floats` always exist, the others are null pointers if
// a set lacks them. With AVX2, rough products take a third of the time of
// floats.
struct TileKernels {
  FloatTileFunctions floats;
  ByteTileFunctions bytes;
  RoughTileFunctions rough;
};
TileKernels KernelsOf(InstructionSet set);

}  // namespace mgsfm
