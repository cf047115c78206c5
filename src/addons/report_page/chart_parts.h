// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/svg.h"

namespace mgsfm {

// Finds places for the labels of points in a rectangle of a drawing, such that
// they overlap neither each other nor what is drawn there.
class LabelPlacement {
 public:
  explicit LabelPlacement(const Eigen::AlignedBox2d& bounds)
      : bounds_(bounds) {}

  // Labels avoid this box if they can.
  void Avoid(const Eigen::AlignedBox2d& box) { occupied_.push_back(box); }

  // The middle of a label of a point: `preferred` if that is free, else the
  // nearest free place around `point`, else the one that covers least.
  Eigen::Vector2d Place(const Eigen::Vector2d& point,
                        const Eigen::Vector2d& preferred,
                        const std::string& text);

  // The size of a text in the style of charts, which viewers may exceed
  // slightly.
  static Eigen::Vector2d SizeOf(const std::string& text);

 private:
  double Overlap(const Eigen::AlignedBox2d& box) const;

  Eigen::AlignedBox2d bounds_;
  std::vector<Eigen::AlignedBox2d> occupied_;
};

// SVG attributes that the charts share.
constexpr char kTextStyle[] = "font-size='12'";
constexpr char kMutedStyle[] = "font-size='12' opacity='0.7'";
constexpr char kRightStyle[] = "font-size='12' text-anchor='end'";
constexpr char kCenterStyle[] = "font-size='12' text-anchor='middle'";

// Colors of sensors in charts and in the 3D view (web/src/colors.js).
std::string SensorColor(int order);

// A color from light to dark, for a value in [0, 1]: perceptually uniform
// (viridis, Smith & van der Walt 2015), at 9 nodes.
Eigen::Vector3d SequentialColor(double value);

// A PNG of RGBA pixels, row by row, as a data URL.
std::string PngUrl(int width_px, int height_px,
                   const std::vector<uint8_t>& rgba);

}  // namespace mgsfm
