// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/ray_grid.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

constexpr double kMaxNumCells = 1 << 22;  // bounds memory to some 10 MB

}  // namespace

CellGrid::CellGrid(const Eigen::AlignedBox2d& box, double cell_size_m)
    : min_(box.min()), cell_size_m_(cell_size_m) {
  const Eigen::Vector2d extent = box.sizes().cwiseMax(0.0);
  const auto num_cells = [&] {
    return (std::floor(extent.x() / cell_size_m_) + 1.0) *
           (std::floor(extent.y() / cell_size_m_) + 1.0);
  };
  while (num_cells() > kMaxNumCells) cell_size_m_ *= 1.5;
  num_columns_ = static_cast<int>(extent.x() / cell_size_m_) + 1;
  num_rows_ = static_cast<int>(extent.y() / cell_size_m_) + 1;
  Fill({});
}

CellGrid CellGrid::OfPoints(const std::vector<Eigen::Vector2d>& positions,
                            double cell_size_m) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& position : positions) box.extend(position);
  if (positions.empty()) box.extend(Eigen::Vector2d(0.0, 0.0));
  CellGrid grid(box, cell_size_m);
  std::vector<std::pair<int, int>> items;
  items.reserve(positions.size());
  for (size_t i = 0; i < positions.size(); ++i) {
    items.emplace_back(grid.CellOf(positions[i]), static_cast<int>(i));
  }
  grid.Fill(items);
  return grid;
}

void CellGrid::Fill(const std::vector<std::pair<int, int>>& cells_and_items) {
  items_ = GroupItems<int, int>(
      static_cast<size_t>(num_columns_) * num_rows_, [&](const auto& add) {
        for (const auto& [cell, item] : cells_and_items) add(cell, item);
      });
}

int CellGrid::Clamp(double offset_m, int size) const {
  const double cell = std::floor(offset_m / cell_size_m_);
  return static_cast<int>(std::clamp(cell, 0.0, size - 1.0));
}

}  // namespace mgsfm
