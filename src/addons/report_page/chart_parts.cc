// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/chart_parts.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "files/image_writing.h"
#include "report_page/encoding.h"

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

AlignedBox2d BoxAround(const Vector2d& middle, const Vector2d& size) {
  return {middle - 0.5 * size, middle + 0.5 * size};
}

double AreaOfIntersection(const AlignedBox2d& a, const AlignedBox2d& b) {
  const AlignedBox2d common = a.intersection(b);
  return common.isEmpty() ? 0.0 : common.volume();
}

}  // namespace

Vector2d LabelPlacement::SizeOf(const std::string& text) {
  const auto num_characters = static_cast<double>(
      std::count_if(text.begin(), text.end(), std::not_fn(IsContinuation)));
  return {kCharWidthPx * num_characters, kLineHeightPx};
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

std::string SensorColor(int order) {
  // Okabe & Ito 2008, distinguishable with color vision deficiencies.
  static constexpr const char* kColors[] = {"#0072b2", "#e69f00", "#009e73",
                                            "#cc79a7", "#56b4e9", "#d55e00",
                                            "#b8a800", "#7f6bb3"};
  return kColors[order % 8];
}

Eigen::Vector3d SequentialColor(double value) {
  static constexpr double kNodes[9][3] = {
      {68, 1, 84},    {71, 44, 122},  {59, 81, 139},
      {44, 113, 142}, {33, 144, 141}, {39, 173, 129},
      {92, 200, 99},  {170, 220, 50}, {253, 231, 37}};
  const double position = 8.0 * std::clamp(value, 0.0, 1.0);
  const int node = std::min(static_cast<int>(position), 7);
  const double share = position - node;
  Eigen::Vector3d color;
  for (int c = 0; c < 3; ++c) {
    color[c] = (1.0 - share) * kNodes[node][c] + share * kNodes[node + 1][c];
  }
  return color;
}

std::string PngUrl(int width_px, int height_px,
                   const std::vector<uint8_t>& rgba) {
  cv::Mat image(height_px, width_px, CV_8UC4);
  for (size_t i = 0; i < rgba.size(); i += 4) {
    image.data[i] = rgba[i + 2];
    image.data[i + 1] = rgba[i + 1];
    image.data[i + 2] = rgba[i];
    image.data[i + 3] = rgba[i + 3];
  }
  return "data:image/png;base64," +
         ToBase64(EncodeImage(".png", image, {cv::IMWRITE_PNG_COMPRESSION, 9}));
}

}  // namespace mgsfm
