// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "eval/svg.h"
#include "report/axes.h"
#include "report/growth.h"

namespace mgsfm {
namespace {

constexpr double kWidth = 740.0;
constexpr double kHeight = 590.0;
constexpr double kLeft = 80.0;
constexpr double kPlotWidth = 400.0;
constexpr double kMargin = 0.1;       // of logarithms
constexpr double kMinSeconds = 0.01;  // shorter stages are not drawn
constexpr const char* kColors[] = {"#1f77b4", "#d62728", "#2ca02c", "#9467bd",
                                   "#8c564b", "#e377c2", "#bcbd22", "#17becf"};

struct Curve {
  std::string name;
  std::string color;
  std::vector<Eigen::Vector2d> points;  // logarithms
};

Curve MakeCurve(const std::vector<GrowthRun>& runs, const std::string& name,
                double StageCost::*value, double min_value) {
  Curve curve{name, "#222", {}};
  for (const GrowthRun& run : runs) {
    const double v = FindStage(run, name).*value;
    if (v < min_value || run.num_observations <= 0.0) continue;
    curve.points.emplace_back(std::log10(run.num_observations), std::log10(v));
  }
  return curve;
}

Eigen::AlignedBox2d Bounds(const std::vector<Curve>& curves) {
  Eigen::AlignedBox2d box;
  for (const Curve& curve : curves) {
    for (const Eigen::Vector2d& point : curve.points) box.extend(point);
  }
  if (box.isEmpty()) box.extend(Eigen::Vector2d::Zero());
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(kMargin);
  return {box.min() - margin, box.max() + margin};
}

void Draw(const Axes& axes, const Curve& curve, SvgDrawing* drawing) {
  std::vector<Eigen::Vector2d> places;
  for (const Eigen::Vector2d& point : curve.points) {
    places.push_back(axes.Place(point.x(), point.y()));
  }
  drawing->Path(places, "stroke-width='2' stroke='" + curve.color + "'");
  for (const Eigen::Vector2d& place : places) {
    drawing->Dot(place, 3.0, "fill='" + curve.color + "'");
  }
}

void DrawPlot(const std::vector<Curve>& curves, double top, double height,
              SvgDrawing* drawing) {
  const Axes axes{Bounds(curves), {kLeft, top}, {kPlotWidth, height}};
  DrawLogXAxis(axes, drawing);
  DrawLogYAxis(axes, drawing);
  DrawXLabel(axes, "observations", drawing);
  DrawFrame(axes, drawing);
  for (const Curve& curve : curves) Draw(axes, curve, drawing);
}

void DrawLegend(const std::vector<Curve>& curves,
                const std::vector<GrowthRun>& runs, SvgDrawing* drawing) {
  const double x = kLeft + kPlotWidth + 16.0;
  double y = 60.0;
  for (const Curve& curve : curves) {
    const double exponent =
        FitExponent(runs, curve.name, &StageCost::processor_seconds);
    drawing->Line({x, y - 4.0}, {x + 20.0, y - 4.0},
                  "stroke-width='2' stroke='" + curve.color + "'");
    drawing->Text({x + 26.0, y}, curve.name + ", " + FormatNumber(exponent, 2));
    y += 20.0;
  }
  drawing->Text({x, y + 4.0}, "with exponents");
}

}  // namespace

std::string GrowthToSvg(const std::vector<GrowthRun>& runs) {
  std::vector<Curve> times = {
      MakeCurve(runs, kTotalName, &StageCost::processor_seconds, kMinSeconds)};
  if (!runs.empty()) {
    for (const StageCost& stage : runs.back().stages) {
      times.push_back(MakeCurve(runs, stage.name, &StageCost::processor_seconds,
                                kMinSeconds));
      times.back().color = kColors[(times.size() - 2) % std::size(kColors)];
    }
  }
  const double memory_exponent =
      FitExponent(runs, kTotalName, &StageCost::peak_memory_mib);
  SvgDrawing drawing(kWidth, kHeight);
  drawing.Text({8.0, 30.0}, "processor time of the mapper, s");
  DrawPlot(times, 40.0, 280.0, &drawing);
  DrawLegend(times, runs, &drawing);
  drawing.Text({8.0, 390.0}, "peak memory, MiB; exponent " +
                                 FormatNumber(memory_exponent, 2));
  DrawPlot({MakeCurve(runs, kTotalName, &StageCost::peak_memory_mib, 1.0)},
           400.0, 130.0, &drawing);
  return drawing.ToString();
}

}  // namespace mgsfm
