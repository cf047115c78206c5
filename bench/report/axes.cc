// SPDX-License-Identifier: BSD-3-Clause
#include "report/axes.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

constexpr const char* kGrid = "stroke='#ddd'";
constexpr const char* kMiddle = "text-anchor='middle'";

// Calls function(logarithm, label) for 1, 2, 5 times powers of ten.
template <class Function>
void ForLogTicks(double min, double max, const Function& function) {
  for (int power = static_cast<int>(std::floor(min)); power <= max; ++power) {
    for (const int multiple : {1, 2, 5}) {
      const double value = power + std::log10(multiple);
      if (value < min - 1e-9 || value > max + 1e-9) continue;
      function(value, FormatNumber(std::pow(10.0, value), std::max(0, -power)));
    }
  }
}

}  // namespace

Eigen::Vector2d Axes::Place(double x, double y) const {
  const Eigen::Vector2d part =
      (Eigen::Vector2d(x, y) - values.min()).cwiseQuotient(values.sizes());
  return {corner.x() + part.x() * size.x(),
          corner.y() + (1.0 - part.y()) * size.y()};
}

void DrawXTick(const Axes& axes, double x, const std::string& label,
               SvgDrawing* drawing) {
  const double place = axes.Place(x, 0.0).x();
  const double bottom = axes.corner.y() + axes.size.y();
  drawing->Line({place, axes.corner.y()}, {place, bottom}, kGrid);
  drawing->Text({place, bottom + 18.0}, label, kMiddle);
}

void DrawYTick(const Axes& axes, double y, const std::string& label,
               SvgDrawing* drawing) {
  const double place = axes.Place(0.0, y).y();
  drawing->Line({axes.corner.x(), place},
                {axes.corner.x() + axes.size.x(), place}, kGrid);
  if (label.empty()) return;
  drawing->Text({axes.corner.x() - 6.0, place + 4.0}, label,
                "text-anchor='end'");
}

void DrawLogXAxis(const Axes& axes, SvgDrawing* drawing) {
  ForLogTicks(axes.values.min().x(), axes.values.max().x(),
              [&](double x, const std::string& label) {
                DrawXTick(axes, x, label, drawing);
              });
}

void DrawLogYAxis(const Axes& axes, SvgDrawing* drawing) {
  ForLogTicks(axes.values.min().y(), axes.values.max().y(),
              [&](double y, const std::string& label) {
                DrawYTick(axes, y, label, drawing);
              });
}

void DrawXLabel(const Axes& axes, const std::string& label,
                SvgDrawing* drawing) {
  drawing->Text({axes.corner.x() + 0.5 * axes.size.x(),
                 axes.corner.y() + axes.size.y() + 38.0},
                label, kMiddle);
}

void DrawFrame(const Axes& axes, SvgDrawing* drawing) {
  drawing->Frame(axes.corner, axes.size, "stroke='#444'");
}

}  // namespace mgsfm
