// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <map>

#include "report_page/chart_parts.h"
#include "report_page/charts.h"
#include "report_page/seams.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
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
    std::sort(bins.begin(), bins.end());
    bins.erase(std::unique(bins.begin(), bins.end()), bins.end());
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
  std::map<std::string, int> frame_of_name;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    frame_of_name[scene.frames[i].name] = static_cast<int>(i);
  }
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
  SvgDrawing drawing(960.0, kTop + kSize + 44.0);
  const Vector2d corner(kLeft, kTop), size(kSize, kSize);
  drawing.Pixels(corner, size, MatrixUrl(MakeMatrix(model)));
  DrawRejectedGroups(model, corner, kSize, &drawing);
  const auto seams = SeamPlaces(model);
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
  double y = kTop + 16.0;
  const auto add_legend = [&](const std::string& style,
                              const std::string& text) {
    drawing.Box({kLeft + kSize + 24.0, y - 11.0}, {14.0, 14.0}, style);
    drawing.Text({kLeft + kSize + 46.0, y}, text, kTextStyle);
    y += 26.0;
  };
  add_legend("fill='#fde725' stroke='#888'", "many points in common");
  add_legend("fill='#3b518b'", "few points in common");
  if (model.input.view_graph) {
    add_legend("fill='#d1495b'", "verified matches, but no common point");
  }
  add_legend("fill='none' stroke='#d1495b' stroke-width='1.5'",
             "group of rejected pairs");
  add_legend("fill='#969696'", "frames that are not registered");
  if (!seams.empty()) add_legend("fill='#e69f00'", "seam (dashed lines)");
  return drawing.ToString();
}

}  // namespace mgsfm
