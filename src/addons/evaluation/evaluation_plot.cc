// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/evaluation_plot.h"

#include <algorithm>

#include "evaluation/svg.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Sizes of the parts of the drawing, in its units.
constexpr double kWidth = 960.0, kLeft = 76.0, kRight = 24.0;
constexpr double kHeader = 84.0, kMinMap = 220.0, kMaxMap = 620.0;
constexpr double kErrorPanel = 150.0, kGap = 62.0;
constexpr double kPlotWidth = kWidth - kLeft - kRight;

constexpr const char* kTrueStyle =
    "stroke='#9a9a9a' stroke-width='5' "
    "stroke-linecap='round' "
    "stroke-linejoin='round'";
constexpr const char* kModelStyle =
    "stroke='#0b62b0' stroke-width='1.6' "
    "stroke-linejoin='round'";
constexpr const char* kMissingStyle = "stroke='#d1495b' stroke-width='1.6'";

// A frame, represented by its reference image.
struct PathPoint {
  double distance_m = 0.0;     // traveled so far
  bool begins_segment = true;  // far from the previous frame
  Vector3d true_center = Vector3d::Zero();
  bool is_registered = false;
  Vector3d center = Vector3d::Zero();  // aligned estimate
  double position_m = 0.0;             // error
  double rotation_deg = 0.0;           // error
};

std::vector<PathPoint> CollectPath(const std::vector<ImagePoses>& images,
                                   const Evaluation& evaluation) {
  std::vector<PathPoint> path;
  for (const ImagePoses& image : images) {
    if (!image.is_reference) continue;
    PathPoint point;
    point.true_center = image.cam_from_world.Center();
    if (image.cam_from_model && evaluation.world_from_model) {
      const Rigid3 pose =
          TransformWorld(*evaluation.world_from_model, *image.cam_from_model);
      point.is_registered = true;
      point.center = pose.Center();
      point.position_m = (point.center - point.true_center).norm();
      point.rotation_deg =
          RadToDeg(AngleBetween(pose.rotation, image.cam_from_world.rotation));
    }
    path.push_back(point);
  }
  std::vector<double> steps;
  for (size_t i = 1; i < path.size(); ++i) {
    steps.push_back((path[i].true_center - path[i - 1].true_center).norm());
  }
  if (steps.empty()) return path;
  // Consecutive sequences need not be connected: steps of many times the median
  // step begin a new segment. Only the drawing depends on it.
  constexpr double kFarInSteps = 20.0;
  const double far = kFarInSteps * std::max(Median(steps), 1e-6);
  for (size_t i = 1; i < path.size(); ++i) {
    path[i].begins_segment = steps[i - 1] > far;
    path[i].distance_m =
        path[i - 1].distance_m + (path[i].begins_segment ? 0.0 : steps[i - 1]);
  }
  return path;
}

TopView ViewOf(const std::vector<ImagePoses>& images,
               const std::vector<PathPoint>& path) {
  Vector3d upward = Vector3d::Zero(), mean = Vector3d::Zero();
  for (const ImagePoses& image : images) {
    upward -= image.cam_from_world.rotation.conjugate() * Vector3d::UnitY();
  }
  for (const PathPoint& point : path) {
    mean += point.true_center / static_cast<double>(path.size());
  }
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const PathPoint& point : path) {
    const Vector3d offset = point.true_center - mean;
    scatter += offset * offset.transpose();
  }
  return ViewFromAbove(upward, images.size(), scatter,
                       path.back().true_center - path.front().true_center);
}

// A rectangular plot with its axes.
struct Panel {
  Vector2d corner, size;  // upper left, in px
  Vector2d min, max;      // data range

  Vector2d ToPage(const Vector2d& value) const {
    const Vector2d share = (value - min).cwiseQuotient(max - min);
    return {corner.x() + share.x() * size.x(),
            corner.y() + (1.0 - share.y()) * size.y()};
  }
};

void DrawAxes(const Panel& panel, const std::string& x_label,
              const std::string& y_label, SvgDrawing* drawing) {
  const Ticks x_ticks = MakeTicks(panel.min.x(), panel.max.x(), 10);
  const Ticks y_ticks =
      MakeTicks(panel.min.y(), panel.max.y(),
                std::max(2, static_cast<int>(panel.size.y() / 32.0)));
  const double bottom = panel.corner.y() + panel.size.y();
  const double left = panel.corner.x();
  for (const double x : x_ticks.values) {
    const double at = panel.ToPage({x, panel.min.y()}).x();
    drawing->Line({at, panel.corner.y()}, {at, bottom}, kGridStyle);
    drawing->Text({at, bottom + 17.0}, FormatNumber(x, x_ticks.digits),
                  "text-anchor='middle'");
  }
  for (const double y : y_ticks.values) {
    const double at = panel.ToPage({panel.min.x(), y}).y();
    drawing->Line({left, at}, {left + panel.size.x(), at}, kGridStyle);
    drawing->Text({left - 7.0, at + 4.5}, FormatNumber(y, y_ticks.digits),
                  "text-anchor='end'");
  }
  drawing->Frame(panel.corner, panel.size, kFrameStyle);
  drawing->Text({left + 0.5 * panel.size.x(), bottom + 36.0}, x_label,
                "text-anchor='middle'");
  drawing->Text({left, panel.corner.y() - 8.0}, y_label);
}

// The positions of all points, or of registered ones, as a line per segment.
template <class Value>
void DrawPath(const std::vector<PathPoint>& path, bool only_registered,
              const Value& value, const Panel& panel, const std::string& style,
              SvgDrawing* drawing) {
  std::vector<Vector2d> line;
  const auto finish_line = [&] {
    // A line with a single point is invisible.
    if (line.size() == 1) line.emplace_back(line[0] + Vector2d(0.5, 0.0));
    if (!line.empty()) drawing->Path(line, style);
    line.clear();
  };
  for (const PathPoint& point : path) {
    const bool is_drawn = !only_registered || point.is_registered;
    if (point.begins_segment || !is_drawn) finish_line();
    if (is_drawn) line.push_back(panel.ToPage(value(point)));
  }
  finish_line();
}

// The true path with a margin and equal scale on both axes.
Panel MakeMapPanel(const std::vector<PathPoint>& path, const TopView& view) {
  Vector2d min = view.Project(path[0].true_center), max = min;
  for (const PathPoint& point : path) {
    const Vector2d place = view.Project(point.true_center);
    min = min.cwiseMin(place);
    max = max.cwiseMax(place);
  }
  const double extent = std::max((max - min).maxCoeff(), 1e-3);
  min.array() -= 0.06 * extent;
  max.array() += 0.06 * extent;
  const Vector2d size = max - min;
  const double height =
      std::clamp(kPlotWidth * size.y() / size.x(), kMinMap, kMaxMap);
  const double px_per_m = std::min(kPlotWidth / size.x(), height / size.y());
  const Vector2d center = 0.5 * (min + max);
  const Vector2d half = 0.5 * Vector2d(kPlotWidth, height) / px_per_m;
  return {{kLeft, kHeader}, {kPlotWidth, height}, center - half, center + half};
}

void DrawLegend(const EvaluationLabels& labels, double y, SvgDrawing* drawing) {
  double x = kLeft;
  const auto text = [&](const std::string& label) {
    drawing->Text({x + 34.0, y + 4.5}, label);
    x += 0.25 * kPlotWidth;
  };
  drawing->Line({x, y}, {x + 26.0, y}, kTrueStyle);
  text(labels.reference);
  drawing->Line({x, y}, {x + 26.0, y}, kModelStyle);
  text(labels.compared);
  drawing->Cross({x + 13.0, y}, 4.0, kMissingStyle);
  text("not registered");
  drawing->Dot({x + 20.0, y}, 5.0, "fill='#2e8b57'");
  text("start");
}

void DrawMap(const std::vector<PathPoint>& path, const TopView& view,
             const EvaluationLabels& labels, const Panel& panel,
             SvgDrawing* drawing) {
  DrawAxes(panel, labels.length_unit,
           "path from above [" + labels.length_unit + "]", drawing);
  const auto true_place = [&](const PathPoint& p) {
    return view.Project(p.true_center);
  };
  const auto place = [&](const PathPoint& p) { return view.Project(p.center); };
  drawing->BeginClip(panel.corner, panel.size);
  DrawPath(path, false, true_place, panel, kTrueStyle, drawing);
  DrawPath(path, true, place, panel, kModelStyle, drawing);
  for (const PathPoint& point : path) {
    if (point.is_registered) continue;
    drawing->Cross(panel.ToPage(true_place(point)), 4.0, kMissingStyle);
  }
  drawing->Dot(panel.ToPage(true_place(path.front())), 5.0, "fill='#2e8b57'");
  drawing->EndClip();
}

// Errors of registered frames over distance. The axis excludes a few very large
// errors that would flatten all others.
template <class Error>
void DrawErrors(const std::vector<PathPoint>& path,
                const EvaluationLabels& labels, double top,
                const std::string& what, const std::string& unit,
                const Error& error, SvgDrawing* drawing) {
  std::vector<double> errors;
  for (const PathPoint& point : path) {
    if (point.is_registered) errors.push_back(error(point));
  }
  std::sort(errors.begin(), errors.end());
  double limit = 1.0;
  std::string label = what + " " + labels.difference + " [" + unit + "]";
  if (!errors.empty() && errors.back() > 0.0) {
    const double usual = errors[(errors.size() - 1) * 95 / 100];
    limit = 1.05 * errors.back();
    if (usual > 0.0 && errors.back() > 5.0 * usual) {
      limit = 5.0 * usual;
      label += ", up to " + FormatNumber(errors.back(), 3) + " " + unit +
               " beyond the axis";
    }
  }
  const double length = std::max(path.back().distance_m, 1e-3);
  const Panel panel{
      {kLeft, top}, {kPlotWidth, kErrorPanel}, {0.0, 0.0}, {length, limit}};
  DrawAxes(panel, "distance driven [" + labels.length_unit + "]", label,
           drawing);
  drawing->BeginClip(panel.corner, panel.size);
  DrawPath(
      path, true,
      [&](const PathPoint& p) { return Vector2d(p.distance_m, error(p)); },
      panel, kModelStyle, drawing);
  for (const PathPoint& point : path) {
    if (point.is_registered) continue;
    drawing->Cross(panel.ToPage({point.distance_m, 0.02 * limit}), 3.0,
                   kMissingStyle);
  }
  drawing->EndClip();
}

std::string Title(const Evaluation& evaluation,
                  const EvaluationLabels& labels) {
  std::string title = std::to_string(evaluation.num_registered) + " of " +
                      std::to_string(evaluation.num_images) +
                      " images registered";
  if (const auto& position = evaluation.position_m) {
    title += "; position " + labels.difference + ": mean " +
             FormatNumber(position->mean, 4) + ", median " +
             FormatNumber(position->median, 4) + ", max " +
             FormatNumber(position->max, 4) + " " + labels.length_unit;
  }
  if (const auto& rotation = evaluation.rotation_deg) {
    title += "; rotation: mean " + FormatNumber(rotation->mean, 3) + ", max " +
             FormatNumber(rotation->max, 3) + " deg";
  }
  return title;
}

}  // namespace

std::string EvaluationToSvg(const std::vector<ImagePoses>& images,
                            const Evaluation& evaluation,
                            const EvaluationLabels& given) {
  EvaluationLabels labels = given;
  if (labels.length_unit.empty()) {
    labels.length_unit = LengthUnitName(evaluation);
  }
  const std::vector<PathPoint> path = CollectPath(images, evaluation);
  if (path.empty()) {
    SvgDrawing drawing(kWidth, kHeader);
    drawing.Text({kLeft, 28.0}, "No image has a true pose.");
    return drawing.ToString();
  }
  const TopView view = ViewOf(images, path);
  const Panel map = MakeMapPanel(path, view);
  const double first_top = kHeader + map.size.y() + kGap;
  const double second_top = first_top + kErrorPanel + kGap;
  const bool has_rotations = evaluation.rotation_deg.has_value();
  SvgDrawing drawing(
      kWidth,
      (has_rotations ? second_top + kErrorPanel + kGap : second_top) - 12.0);
  drawing.Text({kLeft, 24.0}, Title(evaluation, labels));
  DrawLegend(labels, 46.0, &drawing);
  DrawMap(path, view, labels, map, &drawing);
  DrawErrors(
      path, labels, first_top, "position", labels.length_unit,
      [](const PathPoint& p) { return p.position_m; }, &drawing);
  if (!has_rotations) return drawing.ToString();
  DrawErrors(
      path, labels, second_top, "rotation", "deg",
      [](const PathPoint& p) { return p.rotation_deg; }, &drawing);
  return drawing.ToString();
}

}  // namespace mgsfm
