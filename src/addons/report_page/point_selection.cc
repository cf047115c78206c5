// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/point_selection.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/random.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

// Extends the box by the range of the coordinates between two quantiles,
// widened by its own length on both sides.
void ExtendByMost(const std::vector<Vector3d>& places, double quantile,
                  AlignedBox3d* box) {
  if (places.empty()) return;
  Vector3d min, max;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    values.reserve(places.size());
    for (const Vector3d& place : places) values.push_back(place[axis]);
    min[axis] = Quantile(values, quantile);
    max[axis] = Quantile(std::move(values), 1.0 - quantile);
  }
  const Vector3d margin = max - min;
  AlignedBox3d most;
  for (const Vector3d& place : places) {
    const bool is_near = ((place - min + margin).array() >= 0.0).all() &&
                         ((max + margin - place).array() >= 0.0).all();
    if (is_near) most.extend(place);
  }
  if (!most.isEmpty()) box->extend(most);
}

// Cubes, so many along the longest side of the box.
constexpr int kNumCells = 256;

uint32_t CellOf(const Vector3d& point, const AlignedBox3d& box) {
  const double cells_per_unit =
      kNumCells / std::max(box.sizes().maxCoeff(), 1e-300);
  const Eigen::Array3i cell = ((point - box.min()).array() * cells_per_unit)
                                  .min(kNumCells - 1.0)
                                  .cast<int>();
  return static_cast<uint32_t>((cell.x() * kNumCells + cell.y()) * kNumCells +
                               cell.z());
}

double Weight(const Point3D& point, uint32_t num_in_cell) {
  // Longer tracks are not shown before points of other places.
  constexpr double kMaxLength = 12.0;
  const double length =
      std::min(static_cast<double>(point.track.size()), kMaxLength);
  return std::max(length, 1.0) / (1.0 + point.error_px.value_or(0.0)) /
         std::sqrt(static_cast<double>(num_in_cell));
}

}  // namespace

AlignedBox3d ShownBox(const Reconstruction& reconstruction) {
  // Most wrong points lie far outside, in the direction of a ray.
  constexpr double kPointQuantile = 0.005, kFrameQuantile = 0.01;
  std::vector<Vector3d> centers, points;
  for (const auto& pose : reconstruction.rig_from_world) {
    if (pose && pose->Center().allFinite()) centers.push_back(pose->Center());
  }
  for (const Point3D& point : reconstruction.points) {
    if (point.point_in_world.allFinite()) {
      points.push_back(point.point_in_world);
    }
  }
  AlignedBox3d box;
  ExtendByMost(centers, kFrameQuantile, &box);
  ExtendByMost(points, kPointQuantile, &box);
  if (box.isEmpty()) box.extend(Vector3d::Zero());
  return box;
}

std::vector<size_t> SelectPoints(const Reconstruction& reconstruction,
                                 const AlignedBox3d& box, size_t max_points) {
  const std::vector<Point3D>& points = reconstruction.points;
  std::unordered_map<uint32_t, uint32_t> num_in_cell;
  for (const Point3D& point : points) {
    if (box.contains(point.point_in_world)) {
      ++num_in_cell[CellOf(point.point_in_world, box)];
    }
  }
  // The points with the largest u^(1/weight), u uniform in (0, 1).
  Random random(0);
  std::vector<std::pair<double, size_t>> keys;
  for (size_t i = 0; i < points.size(); ++i) {
    const double uniform = random.Uniform();
    if (!box.contains(points[i].point_in_world)) continue;
    const uint32_t count = num_in_cell[CellOf(points[i].point_in_world, box)];
    keys.emplace_back(-std::log(uniform) / Weight(points[i], count), i);
  }
  const size_t num_selected = std::min(max_points, keys.size());
  const auto end = keys.begin() + static_cast<std::ptrdiff_t>(num_selected);
  std::partial_sort(keys.begin(), end, keys.end());
  std::vector<size_t> selected;
  for (auto key = keys.begin(); key != end; ++key) {
    selected.push_back(key->second);
  }
  return selected;
}

}  // namespace mgsfm
