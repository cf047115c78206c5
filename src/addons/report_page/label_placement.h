// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

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

}  // namespace mgsfm
