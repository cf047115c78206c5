// SPDX-License-Identifier: BSD-3-Clause
#include "matching/nearest_two.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace mgsfm {
namespace {

// Rows multiplied with one block of columns while both are in the L1 cache: 64
// rows and 16 columns of 128 values of 16 bits take 20 of usually 32 KiB.
constexpr int kPanelRows = 16 * kTileRows;
// Rows and blocks of columns whose positions fit into one code.
constexpr int kCellRows = 4 * kPanelRows;
constexpr int kCellBlocks = kMaxNumPositions;
static_assert(kCellRows <= kMaxNumPositions);

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
       size_t num_columns)
      : functions_(functions),
        num_rows_(static_cast<int>(num_rows)),
        num_columns_(static_cast<int>(num_columns)),
        of_rows_(kCellRows),
        of_columns_(kCellBlocks) {}

  // Computes the cell that starts at this row and block of columns.
  void Multiply(const std::vector<Row>& rows,
                const std::vector<Column>& columns, int first_row,
                int first_block) {
    for (TopTwoLanes& lanes : of_rows_) lanes.Clear();
    for (TopTwoLanes& lanes : of_columns_) lanes.Clear();
    first_row_ = first_row;
    first_block_ = first_block;
    num_cell_rows_ = std::min(kCellRows, num_rows_ - first_row);
    num_cell_blocks_ =
        std::min(kCellBlocks, (num_columns_ + kTileColumns - 1) / kTileColumns -
                                  first_block);
    for (int panel = 0; panel < num_cell_rows_; panel += kPanelRows) {
      const int panel_end = std::min(panel + kPanelRows, num_cell_rows_);
      for (int block = 0; block < num_cell_blocks_; ++block) {
        const Column* block_columns =
            columns.data() + static_cast<size_t>(first_block + block) *
                                 TileFunctions<Row, Column>::kBlockSize;
        for (int row = panel; row < panel_end; row += kTileRows) {
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
    functions_.multiply(rows, columns, tile_);
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

}  // namespace

template <class Row, class Column>
void FindTwoNearestOfPacked(const TileFunctions<Row, Column>& functions,
                            const std::vector<Row>& rows, size_t num_rows,
                            const std::vector<Column>& columns,
                            size_t num_columns,
                            std::vector<TwoNearest>* nearest_of_rows,
                            std::vector<TwoNearest>* nearest_of_columns) {
  nearest_of_rows->assign(num_rows, {});
  nearest_of_columns->assign(num_columns, {});
  Cell<Row, Column> cell(functions, num_rows, num_columns);
  const int last_row = static_cast<int>(num_rows);
  const int num_blocks =
      static_cast<int>(columns.size() / TileFunctions<Row, Column>::kBlockSize);
  for (int row = 0; row < last_row; row += kCellRows) {
    for (int block = 0; block < num_blocks; block += kCellBlocks) {
      cell.Multiply(rows, columns, row, block);
      cell.EnterRows(nearest_of_rows);
      cell.EnterColumns(nearest_of_columns);
    }
  }
}

template void FindTwoNearestOfPacked(const ExactTileFunctions&,
                                     const std::vector<int16_t>&, size_t,
                                     const std::vector<int16_t>&, size_t,
                                     std::vector<TwoNearest>*,
                                     std::vector<TwoNearest>*);
template void FindTwoNearestOfPacked(const RoughTileFunctions&,
                                     const std::vector<uint8_t>&, size_t,
                                     const std::vector<int8_t>&, size_t,
                                     std::vector<TwoNearest>*,
                                     std::vector<TwoNearest>*);

void FindTwoNearest(DescriptorView descriptors1, DescriptorView descriptors2,
                    std::vector<TwoNearest>* nearest_of_1,
                    std::vector<TwoNearest>* nearest_of_2) {
  FindTwoNearestOfPacked(
      FastestTileFunctions(), PackRows<int16_t>(descriptors1),
      descriptors1.size,
      PackColumns<ExactTileFunctions, int16_t>(
          descriptors2.size,
          [&](size_t i, size_t k) { return descriptors2.Row(i)[k]; }),
      descriptors2.size, nearest_of_1, nearest_of_2);
}

namespace {

// c = (b * kMultiplier + 64) / 128 is at most 62, below the limit of 64 of the
// kernel.
constexpr int kMultiplier = 31;
// Largest 16-bit sum.
constexpr double kMaxRoughDot = 65535.0;
// Largest 15-bit factor.
constexpr double kMaxFactor = 32767.0;
// Bound on the rounding errors of a dot product: a rounded factor causes less
// than 2^16 * 2^-kFactorBits / 2 = 8, the division less than 1.
constexpr double kMargin = 10.0;

int8_t RoundedValue(uint8_t value) {
  return static_cast<int8_t>((value * kMultiplier + 64) >> 7);
}

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
  double Factor() const { return std::round(s * (1 << kFactorBits)); }
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

RoughDecision Decide(const TwoNearest& rough, int32_t best_dot,
                     const Bounds& bounds, const AcceptanceTest& accepts) {
  using State = RoughDecision::State;
  if (rough.best_idx == TwoNearest::kNone) {
    return {State::kRejects, std::nullopt};
  }
  double max_second = 0.0, min_second = 0.0;
  if (rough.second_dot >= 0) {
    max_second = std::max(0.0, bounds.Upper(rough.second_dot));
    min_second = std::max(0.0, bounds.Lower(rough.second_dot));
    if (best_dot <= max_second) {
      // Another descriptor may be nearest.
      const bool may_accept =
          accepts(static_cast<int32_t>(std::ceil(max_second)),
                  std::min<double>(best_dot, min_second));
      return {may_accept ? State::kUnsure : State::kRejects, std::nullopt};
    }
  }
  if (!accepts(best_dot, min_second)) return {State::kRejects, rough.best_idx};
  return {accepts(best_dot, max_second) ? State::kAccepts : State::kUnsure,
          rough.best_idx};
}

std::vector<int8_t> PackRounded(DescriptorView descriptors,
                                const std::vector<Rounding>& roundings) {
  std::vector<int8_t> blocks = PackColumns<RoughTileFunctions, int8_t>(
      descriptors.size,
      [&](size_t j, size_t k) { return RoundedValue(descriptors.Row(j)[k]); });
  for (size_t j = 0; j < descriptors.size; ++j) {
    const auto factor = static_cast<int32_t>(roundings[j].Factor());
    int8_t* block =
        blocks.data() + j / kTileColumns * RoughTileFunctions::kBlockSize;
    std::memcpy(block + RoughTileFunctions::kNumValues +
                    j % kTileColumns * sizeof(factor),
                &factor, sizeof(factor));
  }
  return blocks;
}

}  // namespace

std::optional<RoughDecisions> DecideRoughly(DescriptorView descriptors1,
                                            DescriptorView descriptors2,
                                            const AcceptanceTest& accepts) {
  const auto functions = FindRoughTileFunctions();
  if (!functions) return std::nullopt;
  std::vector<double> norms(descriptors1.size);
  std::vector<Rounding> roundings(descriptors2.size);
  Bounds all;
  double max_length_c = 0.0, max_factor = 0.0;
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
  std::vector<TwoNearest> rough_of_1, rough_of_2;
  FindTwoNearestOfPacked(*functions, PackRows<uint8_t>(descriptors1),
                         descriptors1.size,
                         PackRounded(descriptors2, roundings),
                         descriptors2.size, &rough_of_1, &rough_of_2);

  RoughDecisions decisions;
  decisions.of_1.resize(descriptors1.size);
  decisions.of_2.resize(descriptors2.size);
  const auto exact_dot = [&](int32_t i, int32_t j) {
    if (i == TwoNearest::kNone || j == TwoNearest::kNone) {
      return TwoNearest::kNone;
    }
    return ExactDot(descriptors1.Row(i), descriptors2.Row(j));
  };
  for (size_t i = 0; i < descriptors1.size; ++i) {
    Bounds bounds = all;
    bounds.a = norms[i];
    const int32_t j = rough_of_1[i].best_idx;
    decisions.of_1[i] = Decide(
        rough_of_1[i], exact_dot(static_cast<int32_t>(i), j), bounds, accepts);
  }
  for (size_t j = 0; j < descriptors2.size; ++j) {
    const Bounds bounds{all.a, roundings[j].m(), roundings[j].h};
    const int32_t i = rough_of_2[j].best_idx;
    decisions.of_2[j] = Decide(
        rough_of_2[j], exact_dot(i, static_cast<int32_t>(j)), bounds, accepts);
  }
  return decisions;
}

}  // namespace mgsfm
