// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "base/ranges.h"
#include "math/statistics.h"
#include "report_page/chart_parts.h"
#include "report_page/charts.h"
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

// The view of the centers relative to their mean.
struct CenteredView {
  TopView axes;
  Vector3d mean;

  Vector2d Project(const Vector3d& x) const { return axes.Project(x - mean); }
};

CenteredView ViewOf(const PageModel& model, const Paths& paths) {
  Vector3d upward = Vector3d::Zero(), mean = Vector3d::Zero();
  size_t num_frames = 0;
  for (const auto& pose : model.input.reconstruction.rig_from_world) {
    if (!pose) continue;
    upward -= pose->rotation.conjugate() * Vector3d::UnitY();
    mean += pose->Center();
    ++num_frames;
  }
  mean /= static_cast<double>(num_frames);
  Matrix3d scatter = Matrix3d::Zero();
  for (const auto& [name, path] : paths) {
    for (const Vector3d& center : path) {
      scatter += (center - mean) * (center - mean).transpose();
    }
  }
  const std::vector<Vector3d>& first = paths.begin()->second;
  return {
      ViewFromAbove(upward, num_frames, scatter, first.back() - first.front()),
      mean};
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

Plot MakePlot(const Paths& paths, const CenteredView& view) {
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
std::string DensityUrl(const PageModel& model, const CenteredView& view,
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
              const CenteredView& view, const Plot& plot, SvgDrawing* drawing) {
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
  const CenteredView view = ViewOf(model, paths);
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

namespace {

using Json = nlohmann::ordered_json;

// The chart has 560 px, so that a bin has more than one.
constexpr size_t kMaxBins = 480;
constexpr char kSeamStyle[] = "stroke='#e69f00' stroke-dasharray='5 4'";

// Frames in equal bins along both axes.
struct FrameMatrix {
  size_t num_bins;
  size_t num_frames;
  std::vector<size_t> num_common_points;
  std::vector<size_t> num_matches;
  std::vector<size_t> num_registered;  // frames per bin

  size_t BinOf(int frame_idx) const {
    return static_cast<size_t>(frame_idx) * num_bins / num_frames;
  }
};

void Count(size_t a, size_t b, size_t count, size_t num_bins,
           std::vector<size_t>* counts) {
  (*counts)[a * num_bins + b] += count;
  if (a != b) (*counts)[b * num_bins + a] += count;
}

// Long tracks are represented by some bins at equal steps: without a bound, the
// cost is quadratic in the length of a track.
void CountCommonPoints(const PageModel& model, FrameMatrix* matrix) {
  constexpr size_t kMaxBinsPerTrack = 64;  // at most 2080 pairs of bins
  for (const Point3D& point : model.input.reconstruction.points) {
    std::vector<size_t> bins;
    for (const Observation& observation : point.track) {
      bins.push_back(matrix->BinOf(
          model.input.scene.images[observation.image_idx].frame_idx));
    }
    SortUnique(&bins);
    const size_t step = 1 + bins.size() / kMaxBinsPerTrack;
    for (size_t i = 0; i < bins.size(); i += step) {
      for (size_t j = i; j < bins.size(); j += step) {
        Count(bins[i], bins[j], 1, matrix->num_bins,
              &matrix->num_common_points);
      }
    }
  }
}

FrameMatrix MakeMatrix(const PageModel& model) {
  const Scene& scene = model.input.scene;
  const size_t num_bins = std::min(scene.frames.size(), kMaxBins);
  FrameMatrix matrix{
      num_bins, scene.frames.size(), std::vector<size_t>(num_bins * num_bins),
      std::vector<size_t>(num_bins * num_bins), std::vector<size_t>(num_bins)};
  CountCommonPoints(model, &matrix);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (model.input.reconstruction.rig_from_world[i]) {
      ++matrix.num_registered[matrix.BinOf(static_cast<int>(i))];
    }
  }
  if (!model.input.view_graph) return matrix;
  for (const ImagePair& pair : model.input.view_graph->pairs) {
    Count(matrix.BinOf(scene.images[pair.image_idx1].frame_idx),
          matrix.BinOf(scene.images[pair.image_idx2].frame_idx),
          pair.matches.size(), num_bins, &matrix.num_matches);
  }
  return matrix;
}

void AppendPixel(const Eigen::Vector3d& color, std::vector<uint8_t>* rgba) {
  for (int c = 0; c < 3; ++c) rgba->push_back(static_cast<uint8_t>(color[c]));
  rgba->push_back(255);
}

std::string MatrixUrl(const FrameMatrix& matrix) {
  const double max = static_cast<double>(
      std::max<size_t>(1, *std::max_element(matrix.num_common_points.begin(),
                                            matrix.num_common_points.end())));
  std::vector<uint8_t> rgba;
  for (size_t row = 0; row < matrix.num_bins; ++row) {
    for (size_t column = 0; column < matrix.num_bins; ++column) {
      const size_t cell = row * matrix.num_bins + column;
      const size_t num_points = matrix.num_common_points[cell];
      if (num_points > 0) {
        AppendPixel(SequentialColor(0.15 + 0.85 * std::log1p(num_points) /
                                               std::log1p(max)),
                    &rgba);
      } else if (matrix.num_matches[cell] > 0) {
        AppendPixel({209, 73, 91}, &rgba);
      } else if (matrix.num_registered[row] == 0 ||
                 matrix.num_registered[column] == 0) {
        AppendPixel({150, 150, 150}, &rgba);
      } else {
        rgba.insert(rgba.end(), 4, 0);
      }
    }
  }
  const int size = static_cast<int>(matrix.num_bins);
  return PngUrl(size, size, rgba);
}

void DrawRejectedGroups(const PageModel& model, const Vector2d& corner,
                        double size, SvgDrawing* drawing) {
  const Json& groups = GetArray(model.model_report, "rejected_groups");
  const Scene& scene = model.input.scene;
  const auto frame_of_name = FramesByName(scene);
  const double px_per_frame = size / static_cast<double>(scene.frames.size());
  for (const Json& group : groups) {
    const auto range1 = FrameRange(Get(group, "frames1"), frame_of_name);
    const auto range2 = FrameRange(Get(group, "frames2"), frame_of_name);
    if (!range1 || !range2) continue;
    const auto draw = [&](std::pair<int, int> x, std::pair<int, int> y) {
      drawing->Frame(corner + px_per_frame * Vector2d(x.first, y.first) -
                         Vector2d(2.0, 2.0),
                     px_per_frame * Vector2d(x.second - x.first + 1,
                                             y.second - y.first + 1) +
                         Vector2d(4.0, 4.0),
                     "stroke='#d1495b' stroke-width='1.5'");
    };
    draw(*range1, *range2);
    draw(*range2, *range1);
  }
}

// Lines across the matrix at the seams.
void DrawSeams(const std::set<std::pair<int, int>>& seams,
               const Vector2d& corner, double size, size_t num_frames,
               SvgDrawing* drawing) {
  for (const auto& [before, after] : seams) {
    const double at =
        size * (0.5 * (before + after) + 0.5) / static_cast<double>(num_frames);
    drawing->Line(corner + Vector2d(at, 0.0), corner + Vector2d(at, size),
                  kSeamStyle);
    drawing->Line(corner + Vector2d(0.0, at), corner + Vector2d(size, at),
                  kSeamStyle);
  }
}

}  // namespace

std::string ViewGraphChart(const PageModel& model) {
  if (model.input.scene.frames.size() < 2) return "";
  // Pixels of the page.
  constexpr double kSize = 560.0, kLeft = 60.0, kTop = 12.0;
  constexpr double kLegendRow = 26.0;
  const auto seams = SeamPlaces(model);
  const bool has_matches = model.input.view_graph != nullptr;
  const double num_rows =
      4.0 + (has_matches ? 1.0 : 0.0) + (seams.empty() ? 0.0 : 1.0);
  SvgDrawing drawing(kLeft + kSize + 20.0,
                     kTop + kSize + 50.0 + kLegendRow * num_rows);
  const Vector2d corner(kLeft, kTop), size(kSize, kSize);
  drawing.Pixels(corner, size, MatrixUrl(MakeMatrix(model)));
  DrawRejectedGroups(model, corner, kSize, &drawing);
  DrawSeams(seams, corner, kSize, model.input.scene.frames.size(), &drawing);
  drawing.Frame(corner, size, kFrameStyle);
  const auto num_frames = static_cast<double>(model.input.scene.frames.size());
  const Ticks ticks = MakeTicks(0.0, num_frames, 6);
  for (const double value : ticks.values) {
    const double at = kSize * value / num_frames;
    drawing.Text({kLeft + at, kTop + kSize + 16.0},
                 FormatNumber(value, ticks.digits), kCenterStyle);
    drawing.Text({kLeft - 8.0, kTop + at + 4.0},
                 FormatNumber(value, ticks.digits), kRightStyle);
  }
  drawing.Text({kLeft + 0.5 * kSize, kTop + kSize + 34.0}, "frame",
               kCenterStyle);
  double y = kTop + kSize + 64.0;
  const auto add_legend = [&](const std::string& style,
                              const std::string& text) {
    drawing.Box({kLeft, y - 11.0}, {14.0, 14.0}, style);
    drawing.Text({kLeft + 22.0, y}, text, kTextStyle);
    y += kLegendRow;
  };
  add_legend("fill='#fde725' stroke='#888'", "many points in common");
  add_legend("fill='#3b518b'", "few points in common");
  if (has_matches) {
    add_legend("fill='#d1495b'", "verified matches, but no common point");
  }
  add_legend("fill='none' stroke='#d1495b' stroke-width='1.5'",
             "group of rejected pairs");
  add_legend("fill='#969696'", "frames that are not registered");
  if (!seams.empty()) add_legend("fill='#e69f00'", "seam (dashed lines)");
  return drawing.ToString();
}

}  // namespace mgsfm
