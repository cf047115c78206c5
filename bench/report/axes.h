// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <string>

#include "eval/svg.h"

namespace mgsfm {

// From values to places on a drawing.
struct Axes {
  Eigen::AlignedBox2d values;  // as drawn, maybe logarithms
  Eigen::Vector2d corner;      // upper left
  Eigen::Vector2d size;

  Eigen::Vector2d Place(double x, double y) const;
};

// A line across, with its label if there is one.
void DrawXTick(const Axes& axes, double x, const std::string& label,
               SvgDrawing* drawing);
void DrawYTick(const Axes& axes, double y, const std::string& label,
               SvgDrawing* drawing);
// Of logarithms: powers of ten, with lines at twice and five times of them.
void DrawLogXAxis(const Axes& axes, SvgDrawing* drawing);
void DrawLogYAxis(const Axes& axes, SvgDrawing* drawing);
// Below the axis.
void DrawXLabel(const Axes& axes, const std::string& label,
                SvgDrawing* drawing);
void DrawFrame(const Axes& axes, SvgDrawing* drawing);

}  // namespace mgsfm
