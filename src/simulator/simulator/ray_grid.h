// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "math/item_groups.h"

namespace mgsfm {

// Items grouped by the square cells of a plane that they touch, in flat arrays.
class CellGrid {
 public:
  // Covers the box. Cells are larger than requested if there would be too many.
  CellGrid(const Eigen::AlignedBox2d& box, double cell_size_m);

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

  const int* begin(int cell) const { return items_.begin(cell); }
  const int* end(int cell) const { return items_.end(cell); }

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
  ItemGroups<int, int> items_;  // per cell
};

// Visits the cells of a grid along a ray in order (Amanatides and Woo, A fast
// voxel traversal algorithm for ray tracing, 1987).
class CellWalk {
 public:
  CellWalk(const CellGrid& grid, const Eigen::Vector2d& origin,
           const Eigen::Vector2d& direction)
      : grid_(grid) {
    const int sizes[] = {grid.num_columns(), grid.num_rows()};
    double begin = 0.0, end = kNever;
    for (int axis = 0; axis < 2; ++axis) {
      const double low = grid.min()[axis];
      const double high = low + sizes[axis] * grid.cell_size_m();
      Clip(low - origin[axis], high - origin[axis], direction[axis], &begin,
           &end);
    }
    is_inside_ = begin < end;
    entry_ = begin;
    const Eigen::Vector2d start = origin + begin * direction;
    cell_[0] = grid.Column(start.x());
    cell_[1] = grid.Row(start.y());
    for (int axis = 0; axis < 2; ++axis) {
      step_[axis] = direction[axis] > 0.0 ? 1 : -1;
      const double border =
          grid.min()[axis] +
          (cell_[axis] + (step_[axis] > 0 ? 1 : 0)) * grid.cell_size_m();
      const bool is_parallel = std::abs(direction[axis]) < 1e-12;
      next_[axis] =
          is_parallel ? kNever : (border - origin[axis]) / direction[axis];
      delta_[axis] =
          is_parallel ? kNever : grid.cell_size_m() / std::abs(direction[axis]);
    }
  }

  bool IsInside() const { return is_inside_; }
  int Cell() const { return grid_.Cell(cell_[0], cell_[1]); }
  // The distance to the entry point of the cell.
  double Entry() const { return entry_; }

  void Next() {
    const int axis = next_[0] < next_[1] ? 0 : 1;
    entry_ = next_[axis];
    next_[axis] += delta_[axis];
    cell_[axis] += step_[axis];
    const int size = axis == 0 ? grid_.num_columns() : grid_.num_rows();
    is_inside_ = entry_ < kNever && cell_[axis] >= 0 && cell_[axis] < size;
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  static void Clip(double low, double high, double slope, double* begin,
                   double* end) {
    if (std::abs(slope) < 1e-12) {
      if (low > 0.0 || high < 0.0) *end = -kNever;
      return;
    }
    const double t1 = low / slope, t2 = high / slope;
    *begin = std::max(*begin, std::min(t1, t2));
    *end = std::min(*end, std::max(t1, t2));
  }

  const CellGrid& grid_;
  int cell_[2];
  int step_[2];
  double next_[2];
  double delta_[2];
  double entry_;
  bool is_inside_;
};

}  // namespace mgsfm
