// SPDX-License-Identifier: BSD-3-Clause
#include "report/curve_plot.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>

#include "eval/svg.h"
#include "math/statistics.h"
#include "report/axes.h"

namespace mgsfm {
namespace {

constexpr double kWidth = 640.0;
constexpr double kHeight = 560.0;
constexpr double kLeft = 80.0;
constexpr double kPlotWidth = 400.0;
constexpr const char* kColors[] = {"#1f77b4", "#d62728", "#2ca02c", "#9467bd"};

// y over x, by x.
using Curve = std::map<double, std::vector<double>>;

struct Series {
  std::string rig;
  Curve mapper_m, full_oracle_m, registered_percent;
};

std::vector<Series> GroupByRig(const std::vector<BenchmarkRun>& runs,
                               const CurveOptions& options) {
  std::map<std::string, Series> series;
  for (const BenchmarkRun& run : runs) {
    Series& of_rig = series[run.Rig()];
    of_rig.rig = run.Rig();
    const double x = options.x_factor * run.Setting(options.setting);
    of_rig.registered_percent[x].push_back(run.RegisteredPercent());
    if (!run.HasModel()) continue;
    of_rig.mapper_m[x].push_back(run.PositionM("mapper"));
    of_rig.full_oracle_m[x].push_back(run.PositionM("full_oracle"));
  }
  std::vector<Series> sorted;
  for (auto& [rig, of_rig] : series) sorted.push_back(std::move(of_rig));
  return sorted;
}

void DrawCurve(const Axes& axes, const Curve& curve, bool is_log,
               const std::string& color, bool is_dashed, SvgDrawing* drawing) {
  std::vector<Eigen::Vector2d> places;
  for (const auto& [x, y] : curve) {
    const double median = Median(y);
    places.push_back(axes.Place(x, is_log ? std::log10(median) : median));
  }
  drawing->Path(places, "stroke='" + color + "' stroke-width='2'" +
                            (is_dashed ? " stroke-dasharray='5 4'" : ""));
  if (is_dashed) return;
  for (const Eigen::Vector2d& place : places) {
    drawing->Dot(place, 3.0, "fill='" + color + "'");
  }
}

void DrawXAxis(const Axes& axes, const CurveOptions& options,
               SvgDrawing* drawing) {
  const Ticks ticks =
      MakeTicks(axes.values.min().x(), axes.values.max().x(), 8);
  for (const double x : ticks.values) {
    DrawXTick(axes, x, FormatNumber(x, ticks.digits), drawing);
  }
  DrawXLabel(axes, options.x_label, drawing);
}

// Of the logarithms of all errors.
Eigen::Vector2d LogRange(const std::vector<Series>& all) {
  constexpr double kMargin = 0.1;
  double min = std::numeric_limits<double>::infinity(), max = -min;
  for (const Series& series : all) {
    for (const Curve* curve : {&series.mapper_m, &series.full_oracle_m}) {
      for (const auto& [x, y] : *curve) {
        const double error = std::log10(Median(y));
        min = std::min(min, error);
        max = std::max(max, error);
      }
    }
  }
  if (min > max) return {0.0, 1.0};
  return {min - kMargin, max + kMargin};
}

Eigen::Vector2d XRange(const std::vector<Series>& all) {
  double min = std::numeric_limits<double>::infinity(), max = -min;
  for (const Series& series : all) {
    if (series.registered_percent.empty()) continue;
    min = std::min(min, series.registered_percent.begin()->first);
    max = std::max(max, series.registered_percent.rbegin()->first);
  }
  return {min, std::max(max, min + 1e-9)};
}

void DrawLegend(const std::vector<Series>& all, SvgDrawing* drawing) {
  const double x = kLeft + kPlotWidth + 16.0;
  double y = 60.0;
  const auto entry = [&](const std::string& text, const std::string& style) {
    drawing->Line({x, y - 4.0}, {x + 24.0, y - 4.0},
                  "stroke-width='2' " + style);
    drawing->Text({x + 30.0, y}, text);
    y += 20.0;
  };
  for (size_t i = 0; i < all.size(); ++i) {
    entry(all[i].rig,
          std::string("stroke='") + kColors[i % std::size(kColors)] + "'");
  }
  entry("mapper", "stroke='#444'");
  entry("full oracle", "stroke='#444' stroke-dasharray='5 4'");
}

}  // namespace

std::string CurvesToSvg(const std::vector<BenchmarkRun>& runs,
                        const CurveOptions& options) {
  const std::vector<Series> all = GroupByRig(runs, options);
  const Eigen::Vector2d x_range = XRange(all);
  const Eigen::Vector2d log_range = LogRange(all);
  const Axes errors{{Eigen::Vector2d(x_range[0], log_range[0]),
                     Eigen::Vector2d(x_range[1], log_range[1])},
                    {kLeft, 40.0},
                    {kPlotWidth, 250.0}};
  const Axes shares{
      {Eigen::Vector2d(x_range[0], 0.0), Eigen::Vector2d(x_range[1], 105.0)},
      {kLeft, 370.0},
      {kPlotWidth, 130.0}};
  SvgDrawing drawing(kWidth, kHeight);
  drawing.Text({kLeft + 0.5 * kPlotWidth, 22.0}, options.title,
               "text-anchor='middle' font-weight='bold'");
  drawing.Text({8.0, 34.0}, "position error, mean, m");
  drawing.Text({8.0, 362.0}, "registered images, %");
  DrawLogYAxis(errors, &drawing);
  for (const double y : {0.0, 25.0, 50.0, 75.0, 100.0}) {
    DrawYTick(shares, y, FormatNumber(y, 0), &drawing);
  }
  for (const Axes* axes : {&errors, &shares}) {
    DrawXAxis(*axes, options, &drawing);
    DrawFrame(*axes, &drawing);
  }
  for (size_t i = 0; i < all.size(); ++i) {
    const std::string color = kColors[i % std::size(kColors)];
    DrawCurve(errors, all[i].full_oracle_m, true, color, true, &drawing);
    DrawCurve(errors, all[i].mapper_m, true, color, false, &drawing);
    DrawCurve(shares, all[i].registered_percent, false, color, false, &drawing);
  }
  DrawLegend(all, &drawing);
  return drawing.ToString();
}

}  // namespace mgsfm
