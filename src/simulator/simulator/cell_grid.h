// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

namespace mgsfm {

// Items grouped by the square cells of a plane that they touch, in flat arrays.
class CellGrid {
 public:
  // Covers the box. Cells are larger than requested if there would be too many.
  CellGrid(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
           double cell_size_m);

  // Assigns each item to the cell of its position.
  static CellGrid OfPoints(const std::vector<Eigen::Vector2d>& positions,
                           double cell_size_m);

  // Replaces all items by (cell, item) pairs. Cells keep their order.
  void Fill(const std::vector<std::pair<int, int>>& cells_and_items);

  double cell_size_m() const { return cell_size_m_; }
  int num_columns() const { return num_columns_; }
  int num_rows() const { return num_rows_; }
  // The nearest cell for points outside the grid.
  int Column(double x) const { return Clamp(x - min_.x(), num_columns_); }
  int Row(double y) const { return Clamp(y - min_.y(), num_rows_); }
  int Cell(int column, int row) const { return row * num_columns_ + column; }
  int CellOf(const Eigen::Vector2d& position) const {
    return Cell(Column(position.x()), Row(position.y()));
  }
  const Eigen::Vector2d& min() const { return min_; }

  const int* begin(int cell) const { return items_.data() + offsets_[cell]; }
  const int* end(int cell) const { return items_.data() + offsets_[cell + 1]; }

  // Calls function(item) for all items of the cells within `radius_m`.
  template <class Function>
  void ForEachNear(const Eigen::Vector2d& position, double radius_m,
                   const Function& function) const {
    const int column_end = Column(position.x() + radius_m);
    const int row_end = Row(position.y() + radius_m);
    const int column_begin = Column(position.x() - radius_m);
    for (int row = Row(position.y() - radius_m); row <= row_end; ++row) {
      for (int column = column_begin; column <= column_end; ++column) {
        const int cell = Cell(column, row);
        for (const int* item = begin(cell); item != end(cell); ++item) {
          function(*item);
        }
      }
    }
  }

 private:
  int Clamp(double offset_m, int size) const;

  Eigen::Vector2d min_;
  double cell_size_m_;
  int num_columns_;
  int num_rows_;
  std::vector<int> offsets_;
  std::vector<int> items_;
};

}  // namespace mgsfm
