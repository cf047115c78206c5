// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "report_page/chart_parts.h"
#include "report_page/charts.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Json = nlohmann::ordered_json;

// Pixels of the page.
constexpr double kWidth = 960.0, kPanelWidth = 450.0, kPanelHeight = 300.0;
constexpr size_t kMaxRigs = 4;  // bounds the height of the chart

struct DrawnSensor {
  int sensor_idx;
  Vector3d center;  // in the rig
  Vector3d forward;
  std::optional<Matrix3d> covariance;  // of the center
};

// The covariances of the translations of sensors, from the standard deviations
// along the axes of the camera that the report has.
std::map<std::string, Vector3d> ReadSigmas(const PageModel& model) {
  std::map<std::string, Vector3d> sigmas;
  for (const Json& rig : GetArray(model.model_report, "rigs")) {
    for (const Json& sensor : GetArray(rig, "sensors")) {
      const Json& values = Get(Get(sensor, "sigma"), "translations");
      const bool is_vector = values.is_array() && values.size() == 3 &&
                             values[0].is_number() && values[1].is_number() &&
                             values[2].is_number();
      if (!is_vector) continue;
      sigmas[GetText(sensor, "name")] = {values[0].get<double>(),
                                         values[1].get<double>(),
                                         values[2].get<double>()};
    }
  }
  return sigmas;
}

std::vector<DrawnSensor> CollectSensors(const PageModel& model,
                                        const Rig& rig) {
  const auto sigmas = ReadSigmas(model);
  std::vector<DrawnSensor> sensors;
  for (const int i : rig.sensor_idxs) {
    const auto& pose = model.input.reconstruction.sensor_from_rig[i];
    if (!pose) continue;
    const Matrix3d rig_from_sensor =
        pose->rotation.conjugate().toRotationMatrix();
    DrawnSensor sensor{i, pose->Center(), rig_from_sensor.col(2), {}};
    const auto sigma = sigmas.find(model.input.scene.sensors[i].name);
    if (sigma != sigmas.end()) {
      sensor.covariance = rig_from_sensor *
                          sigma->second.cwiseAbs2().asDiagonal() *
                          rig_from_sensor.transpose();
    }
    sensors.push_back(std::move(sensor));
  }
  return sensors;
}

// Two axes of the rig, which point to the right and up in the drawing.
struct Axes {
  const char* title;
  Vector3d right, up;

  Vector2d Project(const Vector3d& x) const {
    return {right.dot(x), -up.dot(x)};
  }
};

struct Panel {
  Axes axes;
  Vector2d middle_px;
  Vector3d middle;
  double px_per_unit;
  double ellipse_factor;

  Vector2d ToPage(const Vector3d& x) const {
    return middle_px + px_per_unit * axes.Project(x - middle);
  }
};

// A standard deviation of any size is drawn with at most this radius.
constexpr double kMaxRadiusPx = 26.0;

// 1, 2 or 5 times a power of ten, so that sizes can be read off.
double EllipseFactor(double max_radius_px) {
  if (!(max_radius_px > 0.0)) return 1.0;
  const double limit = kMaxRadiusPx / max_radius_px;
  const double power = std::pow(10.0, std::floor(std::log10(limit)));
  for (const double step : {5.0, 2.0}) {
    if (step * power <= limit) return step * power;
  }
  return power;
}

double MaxSigma(const std::vector<DrawnSensor>& sensors) {
  double max = 0.0;
  for (const DrawnSensor& sensor : sensors) {
    if (sensor.covariance) {
      max = std::max(max, sensor.covariance->trace());
    }
  }
  return std::sqrt(max);
}

double ExtentOf(const std::vector<DrawnSensor>& sensors, const Vector3d& mean) {
  double extent = 0.0;
  for (const DrawnSensor& sensor : sensors) {
    extent = std::max(extent, (sensor.center - mean).norm());
  }
  return extent > 0.0 ? extent : 1.0;
}

void DrawUncertainty(const DrawnSensor& sensor, const Panel& panel,
                     const std::string& color, SvgDrawing* drawing) {
  if (!sensor.covariance) return;
  Eigen::Matrix<double, 2, 3> projection;
  projection << panel.axes.right.transpose(), -panel.axes.up.transpose();
  const Eigen::Matrix2d covariance =
      projection * *sensor.covariance * projection.transpose();
  const SymmetricEigen<Eigen::Matrix2d> axes(covariance);
  const Vector2d radii = panel.px_per_unit * panel.ellipse_factor *
                         axes.values.cwiseMax(0.0).cwiseSqrt();
  const Vector2d major = axes.V.col(0);
  drawing->Ellipse(
      panel.ToPage(sensor.center), radii,
      RadToDeg(std::atan2(major.y(), major.x())),
      "fill='" + color + "' fill-opacity='0.25' stroke='" + color + "'");
}

// The optical axis, of the length of the symbol.
Vector2d ForwardPx(const DrawnSensor& sensor, const Panel& panel) {
  return 30.0 * panel.axes.Project(sensor.forward);
}

// The field of view, as a wedge that hints at the direction; empty if the
// camera looks along the view.
std::vector<Vector2d> Wedge(const DrawnSensor& sensor, const Panel& panel) {
  const Vector2d center = panel.ToPage(sensor.center);
  const Vector2d forward = ForwardPx(sensor, panel);
  if (!(forward.norm() > 4.0)) return {};
  const Vector2d side = 0.45 * Vector2d(-forward.y(), forward.x());
  return {center, center + forward + side, center + forward - side, center};
}

void DrawSensor(const DrawnSensor& sensor, const Panel& panel,
                SvgDrawing* drawing) {
  const std::string color = SensorColor(sensor.sensor_idx);
  const std::string stroke = "stroke='" + color + "' stroke-width='2'";
  DrawUncertainty(sensor, panel, color, drawing);
  const Vector2d center = panel.ToPage(sensor.center);
  drawing->Line(
      panel.middle_px + panel.px_per_unit * panel.axes.Project(-panel.middle),
      center, "stroke='#888' stroke-dasharray='3 3'");
  const std::vector<Vector2d> wedge = Wedge(sensor, panel);
  if (!wedge.empty()) drawing->Path(wedge, stroke);
  drawing->Dot(center, 4.0, "fill='" + color + "'");
}

// The labels avoid the cameras and each other; a line leads to one that is not
// beside its camera.
void DrawLabels(const PageModel& model, const std::vector<DrawnSensor>& sensors,
                const Panel& panel, LabelPlacement placement,
                SvgDrawing* drawing) {
  const Vector2d half(7.0, 7.0);
  for (const DrawnSensor& sensor : sensors) {
    const Vector2d center = panel.ToPage(sensor.center);
    Eigen::AlignedBox2d symbol(center - half, center + half);
    for (const Vector2d& corner : Wedge(sensor, panel)) symbol.extend(corner);
    placement.Avoid(symbol);
  }
  for (const DrawnSensor& sensor : sensors) {
    const Vector2d center = panel.ToPage(sensor.center);
    const Vector2d forward = ForwardPx(sensor, panel);
    const std::string name = model.input.scene.sensors[sensor.sensor_idx].name;
    const std::string text = name.empty() ? "images" : Shorten(name, 24);
    const Vector2d size = LabelPlacement::SizeOf(text);
    // Behind the camera, or below one that looks along the view.
    const Vector2d behind = forward.norm() > 4.0
                                ? Vector2d(-forward.normalized())
                                : Vector2d(0.0, 1.0);
    const Vector2d preferred =
        center + behind.cwiseProduct(Vector2d(0.5 * size.x() + 10.0, 16.0));
    const Vector2d label = placement.Place(center, preferred, text);
    const Vector2d nearest =
        center.cwiseMax(label - 0.5 * size).cwiseMin(label + 0.5 * size);
    if ((nearest - center).norm() > 14.0) {
      drawing->Line(center, nearest,
                    "stroke='" + SensorColor(sensor.sensor_idx) + "'");
    }
    drawing->Text(label + Vector2d(0.0, 4.0), text, kCenterStyle);
  }
}

void DrawScaleBar(const Panel& panel, const Vector2d& corner,
                  const std::string& unit, SvgDrawing* drawing) {
  const Ticks ticks = MakeTicks(0.0, 120.0 / panel.px_per_unit, 1);
  const double length = ticks.step;
  drawing->Line(corner, corner + Vector2d(length * panel.px_per_unit, 0.0),
                "stroke='#888' stroke-width='2'");
  drawing->Text(corner + Vector2d(0.0, 16.0),
                FormatNumber(length, ticks.digits) + " " +
                    (length == 1.0 && unit == "units" ? "unit" : unit),
                kTextStyle);
}

void DrawRig(const PageModel& model, const Rig& rig, double top,
             SvgDrawing* drawing) {
  const std::vector<DrawnSensor> sensors = CollectSensors(model, rig);
  Vector3d middle = Vector3d::Zero();
  for (const DrawnSensor& sensor : sensors) {
    middle += sensor.center / static_cast<double>(sensors.size());
  }
  const double px_per_unit = 100.0 / ExtentOf(sensors, middle);
  const double max_radius_px = px_per_unit * MaxSigma(sensors);
  const double factor = EllipseFactor(max_radius_px);
  const Axes views[] = {
      {"from above (forward is up)", Vector3d::UnitX(), Vector3d::UnitZ()},
      {"from behind", Vector3d::UnitX(), -Vector3d::UnitY()}};
  for (size_t k = 0; k < 2; ++k) {
    const Vector2d corner(20.0 + (kPanelWidth + 20.0) * static_cast<double>(k),
                          top);
    const Panel panel{views[k],
                      corner + 0.5 * Vector2d(kPanelWidth, kPanelHeight),
                      middle, px_per_unit, factor};
    drawing->Frame(corner, {kPanelWidth, kPanelHeight - 16.0}, kGridStyle);
    drawing->Text(corner + Vector2d(10.0, 20.0), views[k].title, kMutedStyle);
    for (const DrawnSensor& sensor : sensors) {
      DrawSensor(sensor, panel, drawing);
    }
    const Vector2d scale_bar = corner + Vector2d(12.0, kPanelHeight - 46.0);
    DrawScaleBar(panel, scale_bar, LengthUnit(model), drawing);
    LabelPlacement placement(
        {corner + Vector2d(2.0, 28.0),
         corner + Vector2d(kPanelWidth - 2.0, kPanelHeight - 18.0)});
    placement.Avoid(
        {scale_bar - Vector2d(0.0, 4.0), scale_bar + Vector2d(150.0, 22.0)});
    DrawLabels(model, sensors, panel, std::move(placement), drawing);
    if (max_radius_px > 0.0 && k == 1) {
      drawing->Text(corner + Vector2d(kPanelWidth - 10.0, 20.0),
                    "ellipses: standard deviation x " + FormatNumber(factor, 4),
                    "font-size='12' opacity='0.7' text-anchor='end'");
    }
  }
}

}  // namespace

std::string RigChart(const PageModel& model) {
  std::vector<const Rig*> rigs;
  for (const Rig& rig : model.input.scene.rigs) {
    if (CollectSensors(model, rig).size() > 1) rigs.push_back(&rig);
  }
  StableSortDescendingBy(
      &rigs, [](const Rig* rig) { return rig->sensor_idxs.size(); });
  rigs.resize(std::min(rigs.size(), kMaxRigs));
  if (rigs.empty()) return "";
  SvgDrawing drawing(kWidth,
                     10.0 + kPanelHeight * static_cast<double>(rigs.size()));
  for (size_t i = 0; i < rigs.size(); ++i) {
    DrawRig(model, *rigs[i], 10.0 + kPanelHeight * static_cast<double>(i),
            &drawing);
  }
  return drawing.ToString();
}

}  // namespace mgsfm
