// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/trajectory_chart.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "math/statistics.h"
#include "report_page/chart_parts.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Pixels of the page.
constexpr double kWidth = 960.0, kLeft = 70.0, kTop = 24.0;
constexpr double kPlotWidth = 860.0;
// Limits of the height of the plot, whatever the shape of the path.
constexpr double kMinHeight = 160.0, kMaxHeight = 760.0;
// Steps beyond this are gaps in the drawn path, as in
// priors/position_files.cc.
constexpr double kMaxGapInMedians = 10.0;
constexpr size_t kMaxLegendRows = 8;

// A path, by the centers of its frames in their order.
using Paths = std::map<std::string, std::vector<Vector3d>>;

Paths CollectPaths(const PageModel& model) {
  const Scene& scene = model.input.scene;
  Paths paths;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const auto& pose = model.input.reconstruction.rig_from_world[i];
    if (!pose) continue;
    const Frame& frame = scene.frames[i];
    std::string name = frame.name.substr(0, frame.name.rfind('/') + 1);
    if (scene.rigs.size() > 1) {
      name += scene.sensors[scene.rigs[frame.rig_idx].ref_sensor_idx].name;
    }
    paths[name].push_back(pose->Center());
  }
  return paths;
}

struct TopView {
  Vector3d right, up, mean;

  Vector2d Project(const Vector3d& x) const {
    return {right.dot(x - mean), up.dot(x - mean)};
  }
};

TopView ViewFromAbove(const PageModel& model, const Paths& paths) {
  Vector3d upward = Vector3d::Zero(), mean = Vector3d::Zero();
  double num_frames = 0.0;
  for (const auto& pose : model.input.reconstruction.rig_from_world) {
    if (!pose) continue;
    upward -= pose->rotation.conjugate() * Vector3d::UnitY();
    mean += pose->Center();
    num_frames += 1.0;
  }
  mean /= num_frames;
  Matrix3d scatter = Matrix3d::Zero();
  for (const auto& [name, path] : paths) {
    for (const Vector3d& center : path) {
      scatter += (center - mean) * (center - mean).transpose();
    }
  }
  // The mean of random axes has a norm of about 1 / sqrt(frames).
  constexpr double kUpright = 0.3;
  const Vector3d normal =
      upward.norm() > kUpright * num_frames
          ? upward.normalized()
          : Vector3d(Eigen::SelfAdjointEigenSolver<Matrix3d>(scatter)
                         .eigenvectors()
                         .col(0));
  const Matrix3d in_plane = Matrix3d::Identity() - normal * normal.transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(in_plane * scatter *
                                                     in_plane);
  Vector3d right = in_plane * axes.eigenvectors().col(2);
  if (!(right.norm() > 0.5)) right = normal.unitOrthogonal();
  right.normalize();
  const std::vector<Vector3d>& first = paths.begin()->second;
  if (right.dot(first.back() - first.front()) < 0.0) right = -right;
  return {right, normal.cross(right), mean};
}

// The part of the plane that is drawn, and its place.
struct Plot {
  Vector2d min, max;
  double px_per_unit = 1.0;

  Vector2d size() const { return px_per_unit * (max - min); }
  Vector2d ToPage(const Vector2d& x) const {
    return {kLeft + px_per_unit * (x.x() - min.x()),
            kTop + px_per_unit * (max.y() - x.y())};
  }
};

Plot MakePlot(const Paths& paths, const TopView& view) {
  Eigen::AlignedBox2d box;
  for (const auto& [name, path] : paths) {
    for (const Vector3d& center : path) box.extend(view.Project(center));
  }
  // Points beside the path are shown up to a tenth of its length.
  const double margin = std::max(0.1 * box.diagonal().norm(), 1e-9);
  const Vector2d size = box.sizes() + Vector2d(2.0 * margin, 2.0 * margin);
  Plot plot;
  plot.px_per_unit = std::min(kPlotWidth / size.x(), kMaxHeight / size.y());
  const Vector2d half(0.5 * kPlotWidth / plot.px_per_unit,
                      0.5 * std::max(size.y(), kMinHeight / plot.px_per_unit));
  plot.min = box.center() - half;
  plot.max = box.center() + half;
  return plot;
}

// Points per cell of two pixels, darker where there are more.
std::string DensityUrl(const PageModel& model, const TopView& view,
                       const Plot& plot) {
  constexpr double kCellPx = 2.0;
  const int width = static_cast<int>(std::ceil(plot.size().x() / kCellPx));
  const int height = static_cast<int>(std::ceil(plot.size().y() / kCellPx));
  std::vector<int> counts(static_cast<size_t>(width) *
                          static_cast<size_t>(height));
  for (const Point3D& point : model.input.reconstruction.points) {
    const Vector2d at = plot.ToPage(view.Project(point.point_in_world));
    const double x = std::floor((at.x() - kLeft) / kCellPx);
    const double y = std::floor((at.y() - kTop) / kCellPx);
    if (!(x >= 0.0 && y >= 0.0 && x < width && y < height)) continue;
    ++counts[static_cast<size_t>(y) * static_cast<size_t>(width) +
             static_cast<size_t>(x)];
  }
  std::vector<uint8_t> rgba;
  rgba.reserve(4 * counts.size());
  for (const int count : counts) {
    const double darkness = count == 0 ? 0.0 : 1.0 - std::exp2(-0.5 * count);
    const auto gray = static_cast<uint8_t>(235.0 - 115.0 * darkness);
    rgba.insert(rgba.end(),
                {gray, gray, gray, static_cast<uint8_t>(count > 0 ? 255 : 0)});
  }
  return PngUrl(width, height, rgba);
}

void DrawAxes(const Plot& plot, SvgDrawing* drawing) {
  const Vector2d size = plot.size();
  const double bottom = kTop + size.y();
  const double middle_x = 0.5 * (plot.min.x() + plot.max.x());
  const double middle_y = 0.5 * (plot.min.y() + plot.max.y());
  for (const double value :
       MakeTicks(plot.min.x() - middle_x, plot.max.x() - middle_x, 10).values) {
    const double x = plot.ToPage({value + middle_x, 0.0}).x();
    drawing->Line({x, bottom}, {x, bottom + 5.0}, kFrameStyle);
    drawing->Text({x, bottom + 19.0}, FormatNumber(value, 6), kCenterStyle);
  }
  const int num_ticks = std::max(3, static_cast<int>(size.y() / 60.0));
  for (const double value :
       MakeTicks(plot.min.y() - middle_y, plot.max.y() - middle_y, num_ticks)
           .values) {
    const double y = plot.ToPage({0.0, value + middle_y}).y();
    drawing->Line({kLeft - 5.0, y}, {kLeft, y}, kFrameStyle);
    drawing->Text({kLeft - 9.0, y + 4.0}, FormatNumber(value, 6), kRightStyle);
  }
  drawing->Frame({kLeft, kTop}, size, kFrameStyle);
}

void DrawPath(const std::vector<Vector3d>& path, const std::string& color,
              const TopView& view, const Plot& plot, SvgDrawing* drawing) {
  std::vector<double> steps;
  for (size_t i = 1; i < path.size(); ++i) {
    steps.push_back((path[i] - path[i - 1]).norm());
  }
  const double max_step =
      steps.empty() ? 0.0 : kMaxGapInMedians * Median(steps);
  const std::string style =
      "stroke='" + color + "' stroke-width='2' stroke-linejoin='round'";
  std::vector<Vector2d> line;
  for (size_t i = 0; i < path.size(); ++i) {
    const bool is_gap = i > 0 && steps[i - 1] > max_step;
    if (is_gap) {
      if (line.size() > 1) drawing->Path(line, style);
      line.clear();
    }
    line.push_back(plot.ToPage(view.Project(path[i])));
  }
  if (line.size() > 1) drawing->Path(line, style);
  drawing->Dot(plot.ToPage(view.Project(path.front())), 5.0,
               "fill='" + color + "' stroke='#fff'");
}

}  // namespace

std::string TrajectoryChart(const PageModel& model) {
  const Paths paths = CollectPaths(model);
  if (paths.empty()) return "";
  const TopView view = ViewFromAbove(model, paths);
  const Plot plot = MakePlot(paths, view);
  const size_t num_rows =
      paths.size() > 1 ? std::min(paths.size(), kMaxLegendRows) : 0;
  const double bottom = kTop + plot.size().y();
  SvgDrawing drawing(kWidth,
                     bottom + 52.0 + 20.0 * static_cast<double>(num_rows));
  const Vector2d corner(kLeft, kTop);
  drawing.BeginClip(corner, plot.size());
  drawing.Pixels(corner, plot.size(), DensityUrl(model, view, plot));
  int order = 0;
  for (const auto& [name, path] : paths) {
    DrawPath(path, SensorColor(order++), view, plot, &drawing);
  }
  drawing.EndClip();
  DrawAxes(plot, &drawing);
  drawing.Text({kLeft + 0.5 * plot.size().x(), bottom + 38.0},
               "from above [" + LengthUnit(model) + "]; dots mark starts",
               kCenterStyle);
  order = 0;
  for (const auto& [name, path] : paths) {
    if (order == static_cast<int>(num_rows)) break;
    const double y = bottom + 60.0 + 20.0 * order;
    drawing.Line({kLeft, y - 4.0}, {kLeft + 26.0, y - 4.0},
                 "stroke='" + SensorColor(order) + "' stroke-width='2'");
    drawing.Text({kLeft + 34.0, y}, name.empty() ? "images" : Shorten(name, 80),
                 kTextStyle);
    ++order;
  }
  return drawing.ToString();
}

}  // namespace mgsfm
