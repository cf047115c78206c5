// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/charts.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/ranges.h"
#include "report_page/chart_parts.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Sizes of drawings in this file are in pixels of the page at its full width.
constexpr double kWidth = 960.0;
constexpr size_t kMaxSensors = 12;  // four rows of Grid

std::string SensorLabel(const PageModel& model, int sensor_idx) {
  const std::string& name = model.input.scene.sensors[sensor_idx].name;
  return name.empty() ? "images" : Shorten(name, 36);
}

std::string FillStyle(const std::string& color) {
  return "fill='" + color + "'";
}

std::string RgbHex(const Vector3d& color) {
  return Formatted("#%02lx%02lx%02lx", std::lround(color[0]),
                   std::lround(color[1]), std::lround(color[2]));
}

// Panels of equal size in rows of three.
struct Grid {
  static constexpr int kNumColumns = 3;
  double top, panel_height;
  double panel_width = (kWidth - 40.0) / kNumColumns;

  Vector2d Corner(size_t panel) const {
    return {20.0 + panel_width * static_cast<double>(panel % kNumColumns),
            top + panel_height * static_cast<double>(panel / kNumColumns)};
  }
  double Bottom(size_t num_panels) const {
    return top + panel_height *
                     std::ceil(static_cast<double>(num_panels) / kNumColumns);
  }
};

// Images of a sensor in a range of frames.
struct Bin {
  size_t num_images = 0;
  size_t num_registered = 0;
};

std::string BinColor(const Bin& bin) {
  if (bin.num_registered == bin.num_images) return "#2e8b57";
  return bin.num_registered == 0 ? "#d1495b" : "#e6a532";
}

// Axis labels below a plot that shows [0, max] over `width` px.
void DrawHorizontalAxis(const Eigen::Vector2d& corner, double width,
                        double height, double max, int num_ticks,
                        const std::string& label, SvgDrawing* drawing) {
  const Ticks ticks = MakeTicks(0.0, max, num_ticks);
  const double bottom = corner.y() + height;
  for (const double value : ticks.values) {
    const double x = corner.x() + width * value / max;
    drawing->Line({x, corner.y()}, {x, bottom}, kGridStyle);
    drawing->Text({x, bottom + 15.0}, FormatNumber(value, ticks.digits),
                  kCenterStyle);
  }
  drawing->Line({corner.x(), bottom}, {corner.x() + width, bottom},
                kFrameStyle);
  drawing->Text({corner.x() + 0.5 * width, bottom + 31.0}, label, kCenterStyle);
}

}  // namespace

std::vector<int> ChartSensors(const PageModel& model) {
  const auto& sensors = model.statistics.sensors;
  std::vector<int> chosen = Indices(sensors.size());
  StableSortDescendingBy(&chosen, [&](int a) { return sensors[a].num_images; });
  chosen.resize(std::min(chosen.size(), kMaxSensors));
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

std::string RegistrationBars(const PageModel& model) {
  const Scene& scene = model.input.scene;
  if (scene.frames.empty()) return "";
  const size_t num_bins = std::min<size_t>(scene.frames.size(), 700);
  std::string html;
  for (const int sensor : ChartSensors(model)) {
    std::vector<Bin> bins(num_bins);
    for (size_t i = 0; i < scene.images.size(); ++i) {
      if (scene.images[i].sensor_idx != sensor) continue;
      const auto frame = static_cast<size_t>(scene.images[i].frame_idx);
      Bin& bin = bins[frame * num_bins / scene.frames.size()];
      ++bin.num_images;
      if (model.projector.CamFromWorld(static_cast<int>(i))) {
        ++bin.num_registered;
      }
    }
    SvgDrawing drawing(static_cast<double>(num_bins), 1.0);
    for (size_t begin = 0; begin < num_bins;) {
      size_t end = begin + 1;
      const auto is_equal = [&](const Bin& bin) {
        return (bin.num_images == 0) == (bins[begin].num_images == 0) &&
               BinColor(bin) == BinColor(bins[begin]);
      };
      while (end < num_bins && is_equal(bins[end])) ++end;
      if (bins[begin].num_images > 0) {
        drawing.Box({static_cast<double>(begin), 0.0},
                    {static_cast<double>(end - begin), 1.0},
                    FillStyle(BinColor(bins[begin])));
      }
      begin = end;
    }
    const SensorStatistics& statistics = model.statistics.sensors[sensor];
    const double share = 100.0 *
                         static_cast<double>(statistics.num_registered) /
                         static_cast<double>(statistics.num_images);
    html += "<div class=\"bar\"><bdi>" +
            EscapeHtml(SensorLabel(model, sensor)) + "</bdi><span>" +
            FormatNumber(share, 1) + "&nbsp;%</span></div>\n" +
            drawing.ToString().replace(
                0, 4, "<svg class='strip' preserveAspectRatio='none'");
  }
  return html;
}

std::string ErrorHistogramChart(const PageModel& model) {
  if (model.statistics.errors.num_errors == 0) return "";
  const std::vector<int> sensors = ChartSensors(model);
  constexpr double kPlotHeight = 110.0;
  const Grid grid{kHistogramColumns.top, kPlotHeight + 72.0};
  SvgDrawing drawing(kWidth, grid.Bottom(sensors.size()));
  for (size_t panel = 0; panel < sensors.size(); ++panel) {
    const SensorStatistics& sensor = model.statistics.sensors[sensors[panel]];
    const Vector2d corner = grid.Corner(panel) + Vector2d(0.0, 22.0);
    const double width = grid.panel_width - 24.0;
    const auto& histogram = sensor.error_histogram;
    const double max = static_cast<double>(std::max<size_t>(
        1, *std::max_element(histogram.begin(), histogram.end())));
    DrawHorizontalAxis(corner, width, kPlotHeight,
                       SensorStatistics::kBinPx * SensorStatistics::kNumBins, 4,
                       "reprojection error [px]", &drawing);
    const double bar = width / static_cast<double>(histogram.size());
    for (size_t i = 0; i < histogram.size(); ++i) {
      const double height =
          kPlotHeight * static_cast<double>(histogram[i]) / max;
      drawing.Box({corner.x() + bar * static_cast<double>(i),
                   corner.y() + kPlotHeight - height},
                  {bar - 0.6, height}, FillStyle(SensorColor(sensors[panel])));
    }
    std::string title = SensorLabel(model, sensors[panel]);
    if (const auto mean = sensor.errors.MeanErrorPx()) {
      title += ": mean " + FormatNumber(*mean, 2) + " px";
    }
    drawing.Text(corner - Vector2d(0.0, 8.0), title, kTextStyle);
  }
  return drawing.ToString();
}

namespace {

// Cells colored by their mean error; those without observations are empty.
std::string ErrorMapUrl(const SensorStatistics& sensor, double max_error_px) {
  std::vector<uint8_t> rgba;
  for (const ImageCell& cell : sensor.cells) {
    const double mean_px =
        cell.sum_errors_px /
        static_cast<double>(std::max<size_t>(cell.num_residuals, 1));
    const Vector3d color = SequentialColor(mean_px / max_error_px);
    for (int c = 0; c < 3; ++c) {
      rgba.push_back(static_cast<uint8_t>(color[c]));
    }
    rgba.push_back(cell.num_residuals > 0 ? 255 : 0);
  }
  return PngUrl(SensorStatistics::kNumColumns, sensor.num_rows, rgba);
}

// Arrows of the mean residual, where it is significant (three standard errors,
// if residuals were independent) and not of single observations.
void DrawResiduals(const SensorStatistics& sensor, const Vector2d& corner,
                   const Vector2d& size, double max_error_px,
                   SvgDrawing* drawing) {
  const Vector2d cell_size(size.x() / SensorStatistics::kNumColumns,
                           size.y() / sensor.num_rows);
  for (size_t i = 0; i < sensor.cells.size(); ++i) {
    const ImageCell& cell = sensor.cells[i];
    if (cell.num_residuals < 5) continue;
    const auto count = static_cast<double>(cell.num_residuals);
    const Vector2d mean_px = cell.sum_residuals_px / count;
    const double noise_px = cell.sum_errors_px / count;
    if (mean_px.norm() < 3.0 * noise_px / std::sqrt(count)) continue;
    const Vector2d center(
        corner.x() +
            cell_size.x() * (0.5 + static_cast<double>(i % sensor.kNumColumns)),
        corner.y() + cell_size.y() *
                         (0.5 + static_cast<double>(i / sensor.kNumColumns)));
    // An arrow of the length of a cell is a residual of half the maximum.
    const Vector2d arrow = mean_px / max_error_px * 2.0 * cell_size.x();
    drawing->Line(center - 0.5 * arrow, center + 0.5 * arrow,
                  "stroke='#fff' stroke-width='1.4'");
    drawing->Dot(center + 0.5 * arrow, 1.5, FillStyle("#fff"));
  }
}

void DrawColorScale(const Vector2d& corner, const std::string& low,
                    const std::string& high, SvgDrawing* drawing) {
  constexpr int kNumSteps = 60;  // of two pixels, too small to be seen
  for (int i = 0; i < kNumSteps; ++i) {
    drawing->Box(corner + Vector2d(2.0 * i, 0.0), {2.3, 10.0},
                 FillStyle(RgbHex(SequentialColor(i / (kNumSteps - 1.0)))));
  }
  drawing->Text(corner + Vector2d(-8.0, 10.0), low, kRightStyle);
  drawing->Text(corner + Vector2d(2.0 * kNumSteps + 8.0, 10.0), high,
                kTextStyle);
}

}  // namespace

std::string ErrorMapChart(const PageModel& model) {
  const auto mean_px = model.statistics.errors.MeanErrorPx();
  if (!mean_px) return "";
  const double max_error_px = std::max(2.0 * *mean_px, 1e-3);
  const std::vector<int> sensors = ChartSensors(model);
  double max_aspect = 0.2;
  for (const int i : sensors) {
    max_aspect = std::max(
        max_aspect, static_cast<double>(model.statistics.sensors[i].num_rows) /
                        SensorStatistics::kNumColumns);
  }
  Grid grid{kMapColumns.top, 0.0};
  const double width = grid.panel_width - 24.0;
  grid.panel_height = max_aspect * width + 40.0;
  SvgDrawing drawing(kWidth, grid.Bottom(sensors.size()));
  DrawColorScale({70.0, 8.0}, "0 px", FormatNumber(max_error_px, 2) + " px",
                 &drawing);
  for (size_t panel = 0; panel < sensors.size(); ++panel) {
    const SensorStatistics& sensor = model.statistics.sensors[sensors[panel]];
    const Vector2d corner = grid.Corner(panel) + Vector2d(0.0, 22.0);
    const Vector2d size(
        width, width * sensor.num_rows / SensorStatistics::kNumColumns);
    drawing.Text(corner - Vector2d(0.0, 6.0),
                 SensorLabel(model, sensors[panel]), kTextStyle);
    drawing.Pixels(corner, size, ErrorMapUrl(sensor, max_error_px));
    DrawResiduals(sensor, corner, size, max_error_px, &drawing);
    drawing.Frame(corner, size, kFrameStyle);
  }
  return drawing.ToString();
}

std::string TrackLengthChart(const PageModel& model) {
  const auto& counts = model.statistics.num_tracks_of_length;
  if (counts.size() < 3) return "";
  // The last bar holds all longer tracks.
  const size_t max_length = std::min<size_t>(counts.size() - 1, 30);
  std::vector<size_t> bars(max_length + 1);
  for (size_t i = 0; i < counts.size(); ++i) {
    bars[std::min(i, max_length)] += counts[i];
  }
  const double max =
      static_cast<double>(*std::max_element(bars.begin(), bars.end()));
  constexpr double kHeight = 140.0, kLeft = 60.0, kTop = 14.0, kWidth = 480.0;
  SvgDrawing drawing(kWidth, kTop + kHeight + 44.0);
  const Ticks ticks = MakeTicks(0.0, max, 4);
  for (const double value : ticks.values) {
    const double y = kTop + kHeight * (1.0 - value / max);
    drawing.Line({kLeft, y}, {kWidth - 20.0, y}, kGridStyle);
    drawing.Text({kLeft - 8.0, y + 4.0}, Count(static_cast<size_t>(value)),
                 kRightStyle);
  }
  const double bar =
      (kWidth - kLeft - 20.0) / static_cast<double>(max_length - 1);
  for (size_t length = 2; length <= max_length; ++length) {
    const double x = kLeft + bar * static_cast<double>(length - 2);
    const double height = kHeight * static_cast<double>(bars[length]) / max;
    drawing.Box({x + 1.0, kTop + kHeight - height}, {bar - 2.0, height},
                FillStyle("#0b62b0"));
    std::string label = std::to_string(length);
    if (length == max_length && counts.size() - 1 > max_length) label += "+";
    if (max_length <= 16 || length % 2 == 0) {
      drawing.Text({x + 0.5 * bar, kTop + kHeight + 15.0}, label, kCenterStyle);
    }
  }
  drawing.Text({0.5 * (kWidth + kLeft), kTop + kHeight + 34.0},
               "images per point", kCenterStyle);
  return drawing.ToString();
}

}  // namespace mgsfm
