// SPDX-License-Identifier: BSD-3-Clause
#include "matching/nearest_two.h"

#include <algorithm>

namespace mgsfm {
namespace internal {
namespace {

// Rows multiplied with one block of columns while both are in the L1 cache: 64
// rows and 16 columns of 128 values of 16 bits take 20 KiB of usually 32.
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

  // Padding rows and columns must not be found.
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

}  // namespace internal

void FindTwoNearest(DescriptorView descriptors1, DescriptorView descriptors2,
                    std::vector<TwoNearest>* nearest_of_1,
                    std::vector<TwoNearest>* nearest_of_2) {
  internal::FindTwoNearestOfPacked(
      internal::FastestTileFunctions(),
      internal::PackRows<int16_t>(descriptors1), descriptors1.size,
      internal::PackColumns<internal::ExactTileFunctions, int16_t>(
          descriptors2.size,
          [&](size_t i, size_t k) { return descriptors2.Row(i)[k]; }),
      descriptors2.size, nearest_of_1, nearest_of_2);
}

}  // namespace mgsfm
