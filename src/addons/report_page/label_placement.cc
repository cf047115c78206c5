// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/label_placement.h"

#include <algorithm>
#include <iterator>

namespace mgsfm {
namespace {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;

// Sans-serif fonts of 12 px have a mean advance of 6 to 6.8 px.
constexpr double kCharWidthPx = 6.8;
constexpr double kLineHeightPx = 14.0;
// Directions to the label: below, above, beside, and between them.
const Vector2d kDirections[] = {{0.0, 1.0},  {0.0, -1.0}, {1.0, 0.0},
                                {-1.0, 0.0}, {1.0, 1.0},  {-1.0, 1.0},
                                {1.0, -1.0}, {-1.0, -1.0}};

// Bytes that continue a character of UTF-8 take no space.
size_t CountCharacters(const std::string& text) {
  return static_cast<size_t>(std::count_if(
      text.begin(), text.end(),
      [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

AlignedBox2d BoxAround(const Vector2d& middle, const Vector2d& size) {
  return {middle - 0.5 * size, middle + 0.5 * size};
}

double AreaOfIntersection(const AlignedBox2d& a, const AlignedBox2d& b) {
  const AlignedBox2d common = a.intersection(b);
  return common.isEmpty() ? 0.0 : common.volume();
}

}  // namespace

Vector2d LabelPlacement::SizeOf(const std::string& text) {
  return {kCharWidthPx * static_cast<double>(CountCharacters(text)),
          kLineHeightPx};
}

double LabelPlacement::Overlap(const AlignedBox2d& box) const {
  double area = box.volume() - AreaOfIntersection(box, bounds_);
  for (const AlignedBox2d& other : occupied_) {
    area += AreaOfIntersection(box, other);
  }
  return area;
}

Vector2d LabelPlacement::Place(const Vector2d& point, const Vector2d& preferred,
                               const std::string& text) {
  const Vector2d size = SizeOf(text);
  Vector2d best = preferred;
  double least = Overlap(BoxAround(preferred, size));
  const auto search = [&](size_t num_directions, double max_distance) {
    for (double distance = 16.0; distance <= max_distance; distance += 10.0) {
      for (size_t k = 0; k < num_directions; ++k) {
        const Vector2d reach(0.5 * size.x() + distance - 8.0, distance);
        const Vector2d middle = point + kDirections[k].cwiseProduct(reach);
        const double overlap = Overlap(BoxAround(middle, size));
        if (overlap >= least) continue;
        best = middle;
        least = overlap;
      }
      if (least == 0.0) return;
    }
  };
  // A label below or above a point is hardly taken for that of another.
  if (least > 0.0) search(2, 36.0);
  if (least > 0.0) search(std::size(kDirections), 96.0);
  Avoid(BoxAround(best, size));
  return best;
}

}  // namespace mgsfm
