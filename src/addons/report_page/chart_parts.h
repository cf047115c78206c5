// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/svg.h"

namespace mgsfm {

// SVG attributes that the charts share.
constexpr char kTextStyle[] = "font-size='12'";
constexpr char kMutedStyle[] = "font-size='12' opacity='0.7'";
constexpr char kRightStyle[] = "font-size='12' text-anchor='end'";
constexpr char kCenterStyle[] = "font-size='12' text-anchor='middle'";
constexpr char kGridStyle[] = "stroke='#e6e6e6'";
constexpr char kFrameStyle[] = "stroke='#888'";

// Colors of sensors in charts and in the 3D view (web/src/colors.js).
std::string SensorColor(int order);

// A color from light to dark, for a value in [0, 1]: perceptually uniform
// (viridis, Smith & van der Walt 2015), at 9 nodes.
Eigen::Vector3d SequentialColor(double value);

// A PNG of RGBA pixels, row by row, as a data URL.
std::string PngUrl(int width_px, int height_px,
                   const std::vector<uint8_t>& rgba);

// Axis labels below a plot that shows [0, max] over `width` px.
void DrawHorizontalAxis(const Eigen::Vector2d& corner, double width,
                        double height, double max, int num_ticks,
                        const std::string& label, SvgDrawing* drawing);

}  // namespace mgsfm
