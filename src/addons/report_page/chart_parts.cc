// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/chart_parts.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "files/image_writing.h"
#include "report_page/encoding.h"

namespace mgsfm {

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

void DrawHorizontalAxis(const Eigen::Vector2d& corner, double width,
                        double height, double max, int num_ticks,
                        const std::string& label, SvgDrawing* drawing) {
  const Ticks ticks = MakeTicks(0.0, max, num_ticks);
  const double bottom = corner.y() + height;
  for (const double value : ticks.values) {
    const double x = corner.x() + width * value / max;
    drawing->Line({x, corner.y()}, {x, bottom}, kGridStyle);
    drawing->Text({x, bottom + 15.0}, FormatNumber(value, ticks.digits),
                  kCenterStyle);
  }
  drawing->Line({corner.x(), bottom}, {corner.x() + width, bottom},
                kFrameStyle);
  drawing->Text({corner.x() + 0.5 * width, bottom + 31.0}, label, kCenterStyle);
}

}  // namespace mgsfm
