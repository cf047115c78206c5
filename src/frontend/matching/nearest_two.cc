// SPDX-License-Identifier: BSD-3-Clause
#include "matching/nearest_two.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <optional>
#include <utility>

namespace mgsfm {
namespace {

// Rows and blocks of columns whose positions fit into one code.
constexpr int kCellRows = kMaxNumPositions;
constexpr int kCellBlocks = kMaxNumPositions;
// Size of the rows that are multiplied with one block of columns, of at most
// 8 KiB, while both are in the L1 cache of usually 32 KiB.
constexpr int kPanelBytes = 16 << 10;
// Maps bytes to signed bytes.
constexpr int kByteOffset = 128;

void Enter(int32_t dot, int32_t idx, TwoNearest* nearest) {
  if (dot > nearest->best_dot ||
      (dot == nearest->best_dot && idx < nearest->best_idx)) {
    nearest->second_dot = nearest->best_dot;
    nearest->best_dot = dot;
    nearest->best_idx = idx;
  } else {
    nearest->second_dot = std::max(nearest->second_dot, dot);
  }
}

template <class EnterCode>
void EnterLanes(const TopTwoLanes& lanes, const EnterCode& enter) {
  for (int c = 0; c < kTileColumns; ++c) {
    if (lanes.best[c] >= 0) enter(c, lanes.best[c]);
    if (lanes.second[c] >= 0) enter(c, lanes.second[c]);
  }
}

// A submatrix of the dot products, small enough that its positions fit into
// codes.
template <class Row, class Column>
class Cell {
 public:
  Cell(const TileFunctions<Row, Column>& functions, size_t num_rows,
       size_t num_columns, const TileSelection* tiles)
      : functions_(functions),
        tiles_(tiles),
        num_rows_(static_cast<int>(num_rows)),
        num_columns_(static_cast<int>(num_columns)) {}

  // Computes the cell that starts at this row and block of columns.
  void Multiply(const std::vector<Row>& rows,
                const std::vector<Column>& columns, int first_row,
                int first_block) {
    TopTwoLanes none{};
    std::fill_n(none.best, kTileColumns, -1);
    std::fill_n(none.second, kTileColumns, -1);
    of_rows_.assign(kCellRows, none);
    of_columns_.assign(kCellBlocks, none);
    first_row_ = first_row;
    first_block_ = first_block;
    num_cell_rows_ = std::min(kCellRows, num_rows_ - first_row);
    num_cell_blocks_ =
        std::min(kCellBlocks, (num_columns_ + kTileColumns - 1) / kTileColumns -
                                  first_block);
    constexpr int kPanelRows = kPanelBytes / (kNumDims * sizeof(Row));
    for (int panel = 0; panel < num_cell_rows_; panel += kPanelRows) {
      const int panel_end = std::min(panel + kPanelRows, num_cell_rows_);
      for (int block = 0; block < num_cell_blocks_; ++block) {
        const size_t idx =
            static_cast<size_t>(first_block) + static_cast<size_t>(block);
        const Column* block_columns =
            columns.data() + idx * TileFunctions<Row, Column>::kBlockSize;
        for (int row = panel; row < panel_end; row += kTileRows) {
          if (tiles_ != nullptr &&
              !tiles_->IsSelected(
                  static_cast<size_t>(first_row + row) / kTileRows, idx)) {
            continue;
          }
          MultiplyTile(
              rows.data() + static_cast<size_t>(first_row + row) * kNumDims,
              block_columns, row, block);
        }
      }
    }
  }

  void EnterRows(std::vector<TwoNearest>* nearest) const {
    for (int r = 0; r < num_cell_rows_; ++r) {
      EnterLanes(of_rows_[r], [&](int lane, int32_t code) {
        const int block = first_block_ + CodedPosition(code);
        Enter(CodedDot(code), block * kTileColumns + lane,
              &(*nearest)[first_row_ + r]);
      });
    }
  }

  void EnterColumns(std::vector<TwoNearest>* nearest) const {
    for (int block = 0; block < num_cell_blocks_; ++block) {
      EnterLanes(of_columns_[block], [&](int lane, int32_t code) {
        const int column = (first_block_ + block) * kTileColumns + lane;
        if (column >= num_columns_) return;
        Enter(CodedDot(code), first_row_ + CodedPosition(code),
              &(*nearest)[column]);
      });
    }
  }

 private:
  void MultiplyTile(const Row* rows, const Column* columns, int row,
                    int block) {
    for (int r = 0; r < kTileRows; r += functions_.num_rows) {
      functions_.multiply(rows + r * kNumDims, columns,
                          tile_ + r * kTileColumns);
    }
    const int rows_left = num_cell_rows_ - row;
    const int columns_left =
        num_columns_ - (first_block_ + block) * kTileColumns;
    if (rows_left < kTileRows || columns_left < kTileColumns) {
      MaskPadding(rows_left, columns_left);
    }
    functions_.update(tile_, row, block, &of_rows_[row], &of_columns_[block]);
  }

  // Prevents padding rows and columns from being found.
  void MaskPadding(int num_rows, int num_columns) {
    for (int r = 0; r < kTileRows; ++r) {
      for (int c = 0; c < kTileColumns; ++c) {
        if (r >= num_rows || c >= num_columns) {
          tile_[r * kTileColumns + c] = -1;
        }
      }
    }
  }

  const TileFunctions<Row, Column> functions_;
  const TileSelection* tiles_;  // null: all
  const int num_rows_;
  const int num_columns_;
  int first_row_ = 0;
  int first_block_ = 0;
  int num_cell_rows_ = 0;
  int num_cell_blocks_ = 0;
  std::vector<TopTwoLanes> of_rows_;     // per row of the cell
  std::vector<TopTwoLanes> of_columns_;  // per block of columns
  alignas(64) int32_t tile_[kTileRows * kTileColumns];
};

template <class Row, class Column>
TwoNearestOfPair FindTwoNearestOfPacked(
    const TileFunctions<Row, Column>& functions, const std::vector<Row>& rows,
    size_t num_rows, const std::vector<Column>& columns, size_t num_columns,
    const TileSelection* tiles = nullptr) {
  TwoNearestOfPair nearest;
  nearest.of_1.resize(num_rows);
  nearest.of_2.resize(num_columns);
  Cell<Row, Column> cell(functions, num_rows, num_columns, tiles);
  const int num_blocks =
      static_cast<int>(columns.size() / TileFunctions<Row, Column>::kBlockSize);
  for (int row = 0; row < static_cast<int>(num_rows); row += kCellRows) {
    for (int block = 0; block < num_blocks; block += kCellBlocks) {
      cell.Multiply(rows, columns, row, block);
      cell.EnterRows(&nearest.of_1);
      cell.EnterColumns(&nearest.of_2);
    }
  }
  return nearest;
}

// Contiguous rows less `offset`, padded with zeros to whole tiles. The next
// call in this thread reuses the memory, of at most 16 MiB by default;
// allocating it anew would take a tenth of the time of a search.
template <class Row>
const std::vector<Row>& PackRows(DescriptorView descriptors, int offset = 0) {
  const size_t num_tiles = (descriptors.size + kTileRows - 1) / kTileRows;
  static thread_local std::vector<Row> rows;
  rows.assign(num_tiles * kTileRows * kNumDims, 0);
  std::transform(
      descriptors.data, descriptors.data + descriptors.size * kNumDims,
      rows.begin(),
      [&](uint8_t value) { return static_cast<Row>(value - offset); });
  return rows;
}

// Columns in blocks of value(element), padded to whole blocks with zeros. A
// block of bytes ends with number(column) for each column.
template <class Column, class Value, class Number>
const std::vector<Column>& PackColumns(DescriptorView descriptors,
                                       const Value& value,
                                       const Number& number) {
  using Functions = TileFunctions<Column, Column>;
  constexpr size_t kGroupSize = Functions::kGroupSize;
  const size_t num_blocks =
      (descriptors.size + kTileColumns - 1) / kTileColumns;
  static thread_local std::vector<Column> blocks;
  blocks.assign(num_blocks * Functions::kBlockSize, 0);
  for (size_t i = 0; i < descriptors.size; ++i) {
    Column* block = blocks.data() + i / kTileColumns * Functions::kBlockSize;
    const size_t column = i % kTileColumns;
    Column values[kNumDims];
    std::transform(
        descriptors.Row(i), descriptors.Row(i + 1), values,
        [&](uint8_t element) { return static_cast<Column>(value(element)); });
    for (size_t k = 0; k < kNumDims; k += kGroupSize) {
      std::memcpy(block + k * kTileColumns + column * kGroupSize, values + k,
                  sizeof(int32_t));
    }
    if (Functions::kBlockSize == Functions::kNumValues) continue;
    const int32_t number_of_i = number(i);
    std::memcpy(block + Functions::kNumValues + column * sizeof(number_of_i),
                &number_of_i, sizeof(number_of_i));
  }
  return blocks;
}

}  // namespace

TwoNearestOfPair FindTwoNearest(DescriptorView descriptors1,
                                DescriptorView descriptors2, InstructionSet set,
                                const TileSelection* tiles) {
  const TileKernels kernels = KernelsOf(set);
  const auto same = [](uint8_t value) { return value; };
  const auto offset = [&](size_t j) {
    return kByteOffset *
           std::accumulate(descriptors2.Row(j), descriptors2.Row(j + 1), 0);
  };
  if (kernels.bytes.multiply != nullptr) {
    return FindTwoNearestOfPacked(
        kernels.bytes, PackRows<int8_t>(descriptors1, kByteOffset),
        descriptors1.size, PackColumns<uint8_t>(descriptors2, same, offset),
        descriptors2.size, tiles);
  }
  return FindTwoNearestOfPacked(
      kernels.floats, PackRows<float>(descriptors1), descriptors1.size,
      PackColumns<float>(descriptors2, same, offset), descriptors2.size, tiles);
}

namespace {

// c = (b * kMultiplier + 64) / 128 is at most 62, below the limit of 64 of the
// kernel.
constexpr int kMultiplier = 31;
// Largest 16-bit sum.
constexpr double kMaxRoughDot = 65535.0;
// Largest 15-bit factor.
constexpr int32_t kMaxFactor = 32767;
// Bound on the rounding errors of a dot product: a rounded factor causes less
// than 2^16 * 2^-kFactorBits / 2 = 8, the division less than 1.
constexpr double kMargin = 10.0;

int32_t RoundedValue(uint8_t value) { return (value * kMultiplier + 64) >> 7; }

int32_t ExactDot(const uint8_t* a, const uint8_t* b) {
  int32_t sum = 0;
  for (size_t k = 0; k < DescriptorView::kDim; ++k) sum += int32_t{a[k]} * b[k];
  return sum;
}

// Decomposition of a descriptor of image 2, named as in the header.
struct Rounding {
  double length_c = 0.0;
  double s = 0.0;
  double h = 0.0;  // |h|

  double m() const { return s * length_c; }
  int32_t Factor() const {
    return static_cast<int32_t>(std::lround(s * (1 << kFactorBits)));
  }
};

Rounding RoundingOf(const uint8_t* b) {
  int32_t squared_b = 0, squared_c = 0, b_c = 0;
  for (size_t k = 0; k < DescriptorView::kDim; ++k) {
    const int32_t c = RoundedValue(b[k]);
    squared_b += int32_t{b[k]} * b[k];
    squared_c += c * c;
    b_c += b[k] * c;
  }
  Rounding rounding;
  rounding.h = std::sqrt(squared_b);
  if (squared_c == 0) return rounding;
  rounding.length_c = std::sqrt(squared_c);
  rounding.s = static_cast<double>(b_c) / squared_c;
  rounding.h = std::sqrt(std::max(0.0, squared_b - rounding.s * b_c));
  return rounding;
}

// Upper (lower) bound on the exact dot product if the approximate one is at
// most (at least) y. For a set of descriptors, a, m and h are the maxima.
struct Bounds {
  double a = 0.0;  // |a|
  double m = 0.0;
  double h = 0.0;

  double Upper(double y) const {
    if (m == 0.0) return a * h + kMargin;
    // The bound increases up to the angle whose tangent is h / m.
    const double along = std::min(y / m, a * m / std::hypot(m, h));
    return m * along + h * Across(along) + kMargin;
  }
  double Lower(double y) const {
    return y - h * Across(m > 0.0 ? y / m : 0.0) - kMargin;
  }

 private:
  double Across(double along) const {
    return std::sqrt(std::max(0.0, a * a - along * along));
  }
};

// Marks a decision that the bounds leave open.
constexpr int32_t kUnsure = -2;

// The descriptor that one accepts, kNone or kUnsure.
int32_t Decide(const TwoNearest& rough, int32_t best_dot, const Bounds& bounds,
               const AcceptanceTest& accepts) {
  if (rough.best_idx == TwoNearest::kNone) return TwoNearest::kNone;
  double max_second = 0.0, min_second = 0.0;
  if (rough.second_dot >= 0) {
    max_second = std::max(0.0, bounds.Upper(rough.second_dot));
    min_second = std::max(0.0, bounds.Lower(rough.second_dot));
    if (best_dot <= max_second) {
      // Another descriptor may be nearest.
      const bool may_accept =
          accepts(static_cast<int32_t>(std::ceil(max_second)),
                  std::min<double>(best_dot, min_second));
      return may_accept ? kUnsure : TwoNearest::kNone;
    }
  }
  if (!accepts(best_dot, min_second)) return TwoNearest::kNone;
  return accepts(best_dot, max_second) ? rough.best_idx : kUnsure;
}

// nullopt if there are no rough products or sums could overflow.
std::optional<Accepted> DecideRoughly(DescriptorView descriptors1,
                                      DescriptorView descriptors2,
                                      InstructionSet set,
                                      const AcceptanceTest& accepts,
                                      const TileSelection* tiles) {
  const RoughTileFunctions functions = KernelsOf(set).rough;
  if (functions.multiply == nullptr) return std::nullopt;
  std::vector<double> norms(descriptors1.size);
  std::vector<Rounding> roundings(descriptors2.size);
  Bounds all;
  double max_length_c = 0.0;
  int32_t max_factor = 0;
  for (size_t i = 0; i < descriptors1.size; ++i) {
    norms[i] = std::sqrt(ExactDot(descriptors1.Row(i), descriptors1.Row(i)));
    all.a = std::max(all.a, norms[i]);
  }
  for (size_t j = 0; j < descriptors2.size; ++j) {
    const Rounding& rounding = roundings[j] = RoundingOf(descriptors2.Row(j));
    all.m = std::max(all.m, rounding.m());
    all.h = std::max(all.h, rounding.h);
    max_length_c = std::max(max_length_c, rounding.length_c);
    max_factor = std::max(max_factor, rounding.Factor());
  }
  if (all.a * max_length_c > kMaxRoughDot || max_factor > kMaxFactor) {
    return std::nullopt;
  }
  const TwoNearestOfPair rough = FindTwoNearestOfPacked(
      functions, PackRows<uint8_t>(descriptors1), descriptors1.size,
      PackColumns<int8_t>(descriptors2, RoundedValue,
                          [&](size_t j) { return roundings[j].Factor(); }),
      descriptors2.size, tiles);
  Accepted decisions;
  const auto exact_dot = [&](int32_t i, int32_t j) {
    if (i == TwoNearest::kNone || j == TwoNearest::kNone) {
      return TwoNearest::kNone;
    }
    return ExactDot(descriptors1.Row(i), descriptors2.Row(j));
  };
  for (size_t i = 0; i < descriptors1.size; ++i) {
    Bounds bounds = all;
    bounds.a = norms[i];
    const int32_t j = rough.of_1[i].best_idx;
    decisions.of_1.push_back(Decide(
        rough.of_1[i], exact_dot(static_cast<int32_t>(i), j), bounds, accepts));
  }
  for (size_t j = 0; j < descriptors2.size; ++j) {
    const Bounds bounds{all.a, roundings[j].m(), roundings[j].h};
    const int32_t i = rough.of_2[j].best_idx;
    decisions.of_2.push_back(Decide(
        rough.of_2[j], exact_dot(i, static_cast<int32_t>(j)), bounds, accepts));
  }
  return decisions;
}

std::vector<int32_t> DecideExactly(const std::vector<TwoNearest>& nearest,
                                   const AcceptanceTest& accepts) {
  std::vector<int32_t> accepted;
  for (const TwoNearest& two : nearest) {
    const bool is_accepted = two.best_idx != TwoNearest::kNone &&
                             accepts(two.best_dot, two.second_dot);
    accepted.push_back(is_accepted ? two.best_idx : TwoNearest::kNone);
  }
  return accepted;
}

void SettleUnsure(DescriptorView descriptors, DescriptorView others,
                  InstructionSet set, const AcceptanceTest& accepts,
                  std::vector<int32_t>* decisions) {
  std::vector<size_t> unsure;
  std::vector<uint8_t> values;
  for (size_t i = 0; i < decisions->size(); ++i) {
    if ((*decisions)[i] != kUnsure) continue;
    unsure.push_back(i);
    values.insert(values.end(), descriptors.Row(i), descriptors.Row(i + 1));
  }
  if (unsure.empty()) return;
  const auto exact = DecideExactly(
      FindTwoNearest({values.data(), unsure.size()}, others, set).of_1,
      accepts);
  for (size_t k = 0; k < unsure.size(); ++k) {
    (*decisions)[unsure[k]] = exact[k];
  }
}

// The same for descriptors that are compared only if is_compared(i, j).
template <class Compared>
void SettleUnsureAmong(DescriptorView descriptors, DescriptorView others,
                       const Compared& is_compared,
                       const AcceptanceTest& accepts,
                       std::vector<int32_t>* decisions) {
  for (size_t i = 0; i < decisions->size(); ++i) {
    if ((*decisions)[i] != kUnsure) continue;
    TwoNearest nearest;
    for (size_t j = 0; j < others.size; ++j) {
      if (!is_compared(i, j)) continue;
      Enter(ExactDot(descriptors.Row(i), others.Row(j)),
            static_cast<int32_t>(j), &nearest);
    }
    (*decisions)[i] = DecideExactly({nearest}, accepts).front();
  }
}

}  // namespace

Accepted FindAccepted(DescriptorView descriptors1, DescriptorView descriptors2,
                      InstructionSet set, const AcceptanceTest& accepts,
                      const TileSelection* tiles) {
  auto decisions =
      DecideRoughly(descriptors1, descriptors2, set, accepts, tiles);
  if (!decisions) {
    const auto [of_1, of_2] =
        FindTwoNearest(descriptors1, descriptors2, set, tiles);
    return {DecideExactly(of_1, accepts), DecideExactly(of_2, accepts)};
  }
  const auto are_compared = [&](size_t i, size_t j) {
    return tiles->IsSelected(i / kTileRows, j / kTileColumns);
  };
  if (tiles == nullptr) {
    SettleUnsure(descriptors1, descriptors2, set, accepts, &decisions->of_1);
  } else {
    SettleUnsureAmong(descriptors1, descriptors2, are_compared, accepts,
                      &decisions->of_1);
  }
  std::vector<int32_t> of_2(descriptors2.size, TwoNearest::kNone);
  for (const int32_t j : decisions->of_1) {
    if (j != TwoNearest::kNone) of_2[j] = decisions->of_2[j];
  }
  if (tiles == nullptr) {
    SettleUnsure(descriptors2, descriptors1, set, accepts, &of_2);
  } else {
    SettleUnsureAmong(
        descriptors2, descriptors1,
        [&](size_t j, size_t i) { return are_compared(i, j); }, accepts, &of_2);
  }
  return {std::move(decisions->of_1), std::move(of_2)};
}

}  // namespace mgsfm
