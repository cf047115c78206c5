// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/ray_grid.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

constexpr double kMaxNumCells = 1 << 22;  // bounds memory to some 10 MB

}  // namespace

CellGrid::CellGrid(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                   double cell_size_m)
    : min_(min), cell_size_m_(cell_size_m) {
  const Eigen::Vector2d extent = (max - min).cwiseMax(0.0);
  const auto num_cells = [&] {
    return (std::floor(extent.x() / cell_size_m_) + 1.0) *
           (std::floor(extent.y() / cell_size_m_) + 1.0);
  };
  while (num_cells() > kMaxNumCells) cell_size_m_ *= 1.5;
  num_columns_ = static_cast<int>(extent.x() / cell_size_m_) + 1;
  num_rows_ = static_cast<int>(extent.y() / cell_size_m_) + 1;
  offsets_.assign(static_cast<size_t>(num_columns_) * num_rows_ + 1, 0);
}

CellGrid CellGrid::OfPoints(const std::vector<Eigen::Vector2d>& positions,
                            double cell_size_m) {
  Eigen::Vector2d min = Eigen::Vector2d::Zero();
  Eigen::Vector2d max = Eigen::Vector2d::Zero();
  for (size_t i = 0; i < positions.size(); ++i) {
    min = i == 0 ? positions[i] : min.cwiseMin(positions[i]);
    max = i == 0 ? positions[i] : max.cwiseMax(positions[i]);
  }
  CellGrid grid(min, max, cell_size_m);
  std::vector<std::pair<int, int>> items;
  items.reserve(positions.size());
  for (size_t i = 0; i < positions.size(); ++i) {
    items.emplace_back(grid.CellOf(positions[i]), static_cast<int>(i));
  }
  grid.Fill(items);
  return grid;
}

void CellGrid::Fill(const std::vector<std::pair<int, int>>& cells_and_items) {
  std::fill(offsets_.begin(), offsets_.end(), 0);
  for (const auto& [cell, item] : cells_and_items) ++offsets_[cell + 1];
  for (size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
  std::vector<int> next(offsets_.begin(), offsets_.end() - 1);
  items_.resize(cells_and_items.size());
  for (const auto& [cell, item] : cells_and_items) items_[next[cell]++] = item;
}

int CellGrid::Clamp(double offset_m, int size) const {
  const double cell = std::floor(offset_m / cell_size_m_);
  return static_cast<int>(std::clamp(cell, 0.0, size - 1.0));
}

}  // namespace mgsfm
