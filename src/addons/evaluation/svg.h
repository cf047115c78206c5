// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace mgsfm {

// An SVG drawing. Coordinates are in px from the upper left corner.
class SvgDrawing {
 public:
  SvgDrawing(double width, double height) : width_(width), height_(height) {}

  // `style` contains SVG attributes, e.g. "stroke='#888' stroke-width='2'".
  void Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to,
            const std::string& style);
  void Path(const std::vector<Eigen::Vector2d>& points,
            const std::string& style);
  void Dot(const Eigen::Vector2d& center, double radius,
           const std::string& style);
  void Cross(const Eigen::Vector2d& center, double radius,
             const std::string& style);
  void Frame(const Eigen::Vector2d& corner, const Eigen::Vector2d& size,
             const std::string& style);
  // A filled rectangle; `style` sets fill.
  void Box(const Eigen::Vector2d& corner, const Eigen::Vector2d& size,
           const std::string& style);
  void Ellipse(const Eigen::Vector2d& center, const Eigen::Vector2d& radii,
               double rotation_deg, const std::string& style);
  // An image whose pixels become rectangles.
  void Pixels(const Eigen::Vector2d& corner, const Eigen::Vector2d& size,
              const std::string& url);
  // `at` is the start of the text unless `style` sets text-anchor.
  void Text(const Eigen::Vector2d& at, const std::string& text,
            const std::string& style = "");

  // Clips all elements up to EndClip() to a rectangle.
  void BeginClip(const Eigen::Vector2d& corner, const Eigen::Vector2d& size);
  void EndClip() { body_ += "</g>\n"; }

  std::string ToString() const;

 private:
  std::string body_;
  double width_, height_;
  int num_clips_ = 0;
};

constexpr char kGridStyle[] = "stroke='#e6e6e6'";
constexpr char kFrameStyle[] = "stroke='#888'";

// The axes of a drawing from above.
struct TopView {
  Eigen::Vector3d right, up;

  Eigen::Vector2d Project(const Eigen::Vector3d& x) const {
    return {right.dot(x), up.dot(x)};
  }
};

// The view along the sum of the upward axes of cameras, or along the axis of
// least extent if they point everywhere. The longest extent in the plane is
// horizontal, and `travel` goes to the right.
TopView ViewFromAbove(const Eigen::Vector3d& sum_of_upward, size_t num_cameras,
                      const Eigen::Matrix3d& scatter,
                      const Eigen::Vector3d& travel);

// Formats with at most `digits` decimals and without trailing zeros.
// Independent of the locale.
std::string FormatNumber(double value, int digits);

// Ticks at multiples of 1, 2 or 5 times a power of ten within [min, max], about
// `target` of them.
struct Ticks {
  double step = 1.0;
  int digits = 0;  // decimals that distinguish the ticks
  std::vector<double> values;
};
Ticks MakeTicks(double min, double max, int target);

}  // namespace mgsfm
