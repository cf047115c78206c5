// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/svg.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iomanip>

#include "base/text_streams.h"
#include "base/text_tools.h"
#include "geometry/decompositions.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;

std::string Attribute(const char* name, double value) {
  return std::string(" ") + name + "='" + FormatNumber(value, 2) + "'";
}

std::string RectangleAttributes(const Vector2d& corner, const Vector2d& size) {
  return Attribute("x", corner.x()) + Attribute("y", corner.y()) +
         Attribute("width", size.x()) + Attribute("height", size.y());
}

}  // namespace

std::string FormatNumber(double value, int digits) {
  TextOutput stream;
  stream << std::fixed << std::setprecision(digits) << value;
  std::string text = stream.str();
  if (text.find('.') != std::string::npos) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
  }
  return text == "-0" ? "0" : text;
}

Ticks MakeTicks(double min, double max, int target) {
  const double rough = std::max(max - min, 1e-12) / target;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  Ticks ticks;
  ticks.step = 10.0 * power;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * power >= rough * (1.0 - 1e-9)) ticks.step = factor * power;
  }
  ticks.digits =
      std::max(0, static_cast<int>(-std::floor(std::log10(ticks.step))));
  const double first = std::ceil(min / ticks.step - 1e-9);
  for (double k = first; k * ticks.step <= max + 1e-9 * ticks.step; ++k) {
    ticks.values.push_back(k * ticks.step);
  }
  return ticks;
}

TopView ViewFromAbove(const Eigen::Vector3d& sum_of_upward, size_t num_cameras,
                      const Eigen::Matrix3d& scatter,
                      const Eigen::Vector3d& travel) {
  using Axes = SymmetricEigen<Eigen::Matrix3d>;
  // The mean of random axes has a norm of about 1 / sqrt(cameras).
  constexpr double kUpright = 0.3;
  const Eigen::Vector3d normal =
      sum_of_upward.norm() > kUpright * static_cast<double>(num_cameras)
          ? sum_of_upward.normalized()
          : Eigen::Vector3d(Axes(scatter).V.col(0));
  const Eigen::Matrix3d in_plane =
      Eigen::Matrix3d::Identity() - normal * normal.transpose();
  const Axes axes(in_plane * scatter * in_plane);
  Eigen::Vector3d right = in_plane * axes.V.col(2);
  if (!(right.norm() > 0.5)) right = normal.unitOrthogonal();
  right.normalize();
  if (right.dot(travel) < 0.0) right = -right;
  return {right, normal.cross(right)};
}

void SvgDrawing::Line(const Vector2d& from, const Vector2d& to,
                      const std::string& style) {
  body_ += "<line" + Attribute("x1", from.x()) + Attribute("y1", from.y()) +
           Attribute("x2", to.x()) + Attribute("y2", to.y()) + " " + style +
           "/>\n";
}

void SvgDrawing::Path(const std::vector<Vector2d>& points,
                      const std::string& style) {
  body_ += "<polyline fill='none' " + style + " points='";
  for (size_t i = 0; i < points.size(); ++i) {
    if (i > 0) body_ += ' ';
    body_ +=
        FormatNumber(points[i].x(), 2) + "," + FormatNumber(points[i].y(), 2);
  }
  body_ += "'/>\n";
}

void SvgDrawing::Dot(const Vector2d& center, double radius,
                     const std::string& style) {
  body_ += "<circle" + Attribute("cx", center.x()) +
           Attribute("cy", center.y()) + Attribute("r", radius) + " " + style +
           "/>\n";
}

void SvgDrawing::Cross(const Vector2d& center, double radius,
                       const std::string& style) {
  const Vector2d diagonal(radius, radius), other(radius, -radius);
  Line(center - diagonal, center + diagonal, style);
  Line(center - other, center + other, style);
}

void SvgDrawing::Frame(const Vector2d& corner, const Vector2d& size,
                       const std::string& style) {
  body_ += "<rect fill='none'" + RectangleAttributes(corner, size) + " " +
           style + "/>\n";
}

void SvgDrawing::Box(const Vector2d& corner, const Vector2d& size,
                     const std::string& style) {
  body_ += "<rect" + RectangleAttributes(corner, size) + " " + style + "/>\n";
}

void SvgDrawing::Ellipse(const Vector2d& center, const Vector2d& radii,
                         double rotation_deg, const std::string& style) {
  body_ += "<ellipse" + Attribute("rx", radii.x()) +
           Attribute("ry", radii.y()) + " transform='translate(" +
           FormatNumber(center.x(), 2) + " " + FormatNumber(center.y(), 2) +
           ") rotate(" + FormatNumber(rotation_deg, 2) + ")' " + style + "/>\n";
}

void SvgDrawing::Pixels(const Vector2d& corner, const Vector2d& size,
                        const std::string& url) {
  body_ += "<image" + RectangleAttributes(corner, size) +
           " preserveAspectRatio='none' style='image-rendering:pixelated' "
           "href='" +
           url + "'/>\n";
}

void SvgDrawing::Text(const Vector2d& at, const std::string& text,
                      const std::string& style) {
  body_ += "<text" + Attribute("x", at.x()) + Attribute("y", at.y()) + " " +
           style + ">" + EscapeMarkup(text) + "</text>\n";
}

void SvgDrawing::BeginClip(const Vector2d& corner, const Vector2d& size) {
  const std::string id = "clip" + std::to_string(++num_clips_);
  body_ += "<clipPath id='" + id + "'><rect" +
           RectangleAttributes(corner, size) +
           "/></clipPath>\n<g clip-path='url(#" + id + ")'>\n";
}

std::string SvgDrawing::ToString() const {
  const std::string width = FormatNumber(width_, 2);
  const std::string height = FormatNumber(height_, 2);
  return "<svg xmlns='http://www.w3.org/2000/svg' width='" + width +
         "' height='" + height + "' viewBox='0 0 " + width + " " + height +
         "' font-family='sans-serif' font-size='13' fill='#222'>\n"
         "<rect width='100%' height='100%' fill='white'/>\n" +
         body_ + "</svg>\n";
}

}  // namespace mgsfm
