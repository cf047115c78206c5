// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/sections.h"

#include <algorithm>
#include <cmath>

#include "base/text_streams.h"
#include "evaluation/evaluation_plot.h"
#include "evaluation/svg.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"
#include "report_page/charts.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;
using Row = std::vector<std::string>;  // HTML of the cells

// Bounds the size of the page; the report and the model have all rows.
constexpr size_t kMaxRows = 60;

std::string Text(const std::string& text) {
  constexpr size_t kMaxBytes = 600;  // a cell of some lines
  return "<bdi>" + EscapeHtml(Shorten(text, kMaxBytes)) + "</bdi>";
}

// "two words" of "two_words".
std::string WithBlanks(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string Number(std::optional<double> value, int digits,
                   const std::string& unit = "") {
  if (!value || !std::isfinite(*value)) return "&ndash;";
  // Tiny and huge values need an exponent.
  const double size = std::abs(*value);
  std::string text = FormatNumber(*value, digits);
  if (size > 0.0 && (size < 0.5 * std::pow(10.0, -digits) || size > 1e9)) {
    TextOutput stream;
    stream.precision(3);
    stream << *value;
    text = stream.str();
  }
  return unit.empty() ? text : text + "&nbsp;" + unit;
}

std::string Count(size_t count) { return std::to_string(count); }

std::string Share(size_t part, size_t all) {
  if (all == 0) return "0 of 0";
  return Count(part) + " of " + Count(all) + " (" +
         FormatNumber(
             100.0 * static_cast<double>(part) / static_cast<double>(all), 1) +
         "&nbsp;%)";
}

// Rows beyond kMaxRows are counted only.
std::string Table(const Row& head, const std::vector<Row>& rows) {
  if (rows.empty()) return "";
  std::string html = "<div class=\"scroll\"><table><thead><tr>";
  for (const std::string& cell : head) {
    html += "<th scope=\"col\">" + cell + "</th>";
  }
  html += "</tr></thead><tbody>\n";
  for (size_t i = 0; i < std::min(rows.size(), kMaxRows); ++i) {
    html += "<tr>";
    for (const std::string& cell : rows[i]) html += "<td>" + cell + "</td>";
    html += "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  if (rows.size() > kMaxRows) {
    html += "<p class=\"muted\">and " + Count(rows.size() - kMaxRows) +
            " more</p>\n";
  }
  return html;
}

std::string Section(const std::string& id, const std::string& title,
                    const std::string& content) {
  if (content.empty()) return "";
  return "<section id=\"" + id + "\"><h2>" + title + "</h2>\n" + content +
         "</section>\n";
}

// SVG files use fixed colors; in the page they follow its theme.
std::string ThemedChart(std::string svg, const std::string& label) {
  if (svg.empty()) return "";
  const std::pair<const char*, const char*> colors[] = {
      {"fill='white'", "fill='none'"},
      {"fill='#222'", "fill='currentColor'"},
      {"'#e6e6e6'", "'var(--grid)'"},
      {"'#888'", "'var(--axis)'"},
      {"'#0b62b0'", "'var(--accent)'"}};
  for (const auto& [color, themed] : colors) {
    const std::string from = color, to = themed;
    for (size_t at = svg.find(from); at != std::string::npos;
         at = svg.find(from, at + to.size())) {
      svg.replace(at, from.size(), to);
    }
  }
  // Clip paths of several charts must not share their ids.
  svg.replace(0, 4, "<svg role='img' aria-label='" + label + "'");
  return "<figure class=\"chart\">" + svg + "</figure>\n";
}

// ------------------------------------------------------------------ summary

std::string Card(const std::string& value, const std::string& label) {
  return "<div class=\"card\"><b>" + value + "</b><span>" + label +
         "</span></div>";
}

std::string Cards(const PageModel& model) {
  const PageStatistics& s = model.statistics;
  const Scene& scene = model.input.scene;
  std::string html = "<div class=\"cards\">";
  html += Card(Count(s.num_registered_images) + "&thinsp;/&thinsp;" +
                   Count(scene.images.size()),
               "images registered");
  html += Card(Count(s.num_registered_frames) + "&thinsp;/&thinsp;" +
                   Count(scene.frames.size()),
               "frames registered");
  html += Card(Count(model.input.reconstruction.points.size()), "points");
  html +=
      Card(Number(s.errors.MeanErrorPx(), 3, "px"), "mean reprojection error");
  if (!model.input.reconstruction.points.empty()) {
    html += Card(Number(static_cast<double>(s.num_observations) /
                            static_cast<double>(
                                model.input.reconstruction.points.size()),
                        1),
                 "images per point");
  }
  if (model.input.truth && model.input.truth->evaluation.position_m) {
    const Evaluation& evaluation = model.input.truth->evaluation;
    html += Card(
        Number(evaluation.position_m->median, 4, LengthUnitName(evaluation)),
        "median error against the truth");
  }
  return html + "</div>\n";
}

// A warning of the report: a text, or an object with texts.
std::string WarningText(const Json& warning) {
  if (warning.is_string()) return Text(warning.get<std::string>());
  std::string html;
  for (const char* key : {"text", "message", "remedy"}) {
    const std::string text = GetText(warning, key);
    if (text.empty()) continue;
    if (!html.empty()) html += "<br>";
    html += Text(text);
  }
  return html;
}

void AppendWarnings(const Json& warnings, std::vector<std::string>* texts) {
  for (const Json& warning : warnings) {
    std::string text = WarningText(warning);
    if (!text.empty()) texts->push_back(std::move(text));
  }
}

std::vector<std::string> Warnings(const PageModel& model) {
  std::vector<std::string> texts;
  AppendWarnings(GetArray(model.report, "warnings"), &texts);
  AppendWarnings(GetArray(model.model_report, "warnings"), &texts);
  const Scene& scene = model.input.scene;
  if (scene.images.empty()) {
    texts.emplace_back("The model has no image.");
  } else if (model.input.reconstruction.points.empty()) {
    texts.emplace_back("The model has no point.");
  }
  const size_t num_missing =
      scene.frames.size() - model.statistics.num_registered_frames;
  if (num_missing > 0) {
    texts.push_back(Share(num_missing, scene.frames.size()) +
                    " frames are not registered; see "
                    "<a href=\"#missing\">the reasons</a>.");
  }
  const size_t num_seams = GetArray(model.model_report, "seams").size();
  if (num_seams > 0) {
    texts.push_back(Count(num_seams) +
                    " seams: the parts beside them are weakly connected; see "
                    "<a href=\"#seams\">the table</a>.");
  }
  const Json& groups = GetArray(model.model_report, "rejected_groups");
  if (!groups.empty()) {
    texts.push_back(Count(groups.size()) +
                    " groups of image pairs contradict the model; see "
                    "<a href=\"#view_graph\">the view graph</a>.");
  }
  const Json& weak =
      Get(Get(model.model_report, "bundle_adjustment"), "weak_frames");
  if (weak.is_array() && !weak.empty()) {
    texts.push_back(Count(weak.size()) + " frames have few observations.");
  }
  return texts;
}

std::string WarningList(const PageModel& model) {
  const std::vector<std::string> warnings = Warnings(model);
  if (warnings.empty()) {
    return "<p class=\"good\">No warning.</p>\n";
  }
  std::string html = "<ul class=\"warnings\">";
  for (const std::string& warning : warnings) {
    html += "<li>" + warning + "</li>\n";
  }
  return html + "</ul>\n";
}

// Whether the cards show this key, too.
bool IsOnCards(const std::string& key) {
  return key == "num_images" || key == "num_registered_images";
}

// "summary" of the report: a text, or values by name.
std::string ReportSummary(const PageModel& model) {
  std::string html;
  for (const Json* report : {&model.report, &model.model_report}) {
    const Json& summary = Get(*report, "summary");
    if (summary.is_string()) {
      html += "<p>" + Text(summary.get<std::string>()) + "</p>\n";
    }
    if (!summary.is_object()) continue;
    std::vector<Row> rows;
    for (const auto& [key, value] : summary.items()) {
      if (value.is_structured() || value.is_null() || IsOnCards(key)) continue;
      rows.push_back(
          {Text(WithBlanks(key)),
           Text(value.is_string() ? value.get<std::string>() : value.dump())});
    }
    html += Table({"", "value"}, rows);
  }
  return html;
}

// ------------------------------------------------------------------- tables

// The focal length of a camera and where it is from, by the report.
std::string FocalLengthCell(const PageModel& model, const Camera& camera) {
  for (const Json& lens : GetArray(model.model_report, "lenses")) {
    if (GetNumber(lens, "camera_id") != camera.id.value()) continue;
    const auto value = GetNumber(lens, "focal_length_px");
    const auto sigma = GetNumber(lens, "relative_sigma");
    const std::string message = GetText(lens, "message");
    if (!value) continue;
    return Number(*value, 5) +
           (sigma ? " &plusmn; " + Number(100.0 * *sigma, 2) + " %" : "") +
           ", " + Text(GetText(lens, "source")) +
           (message.empty() ? "" : "; not determined: " + Text(message));
  }
  return "";
}

std::string SensorTable(const PageModel& model) {
  const Scene& scene = model.input.scene;
  std::vector<Row> rows;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const SensorStatistics& s = model.statistics.sensors[i];
    const Camera& camera =
        model.input.reconstruction.cameras[scene.sensors[i].camera_idx];
    const CameraModelInfo* info =
        FindCameraModel(static_cast<int32_t>(camera.model));
    std::string params;
    for (const double value : camera.params) {
      params += (params.empty() ? "" : ", ") + Number(value, 4);
    }
    rows.push_back(
        {Text(scene.sensors[i].name.empty() ? "images" : scene.sensors[i].name),
         Share(s.num_registered, s.num_images), Count(s.errors.num_points),
         Number(s.errors.MeanErrorPx(), 3),
         std::string(info ? info->name : "?") + " " +
             Count(static_cast<size_t>(camera.width_px)) + "&times;" +
             Count(static_cast<size_t>(camera.height_px)),
         params, FocalLengthCell(model, camera)});
  }
  return Table({"camera", "images registered", "observations",
                "mean error [px]", "model", "parameters", "focal length [px]"},
               rows);
}

std::string MissingTable(const PageModel& model) {
  std::vector<Row> rows;
  for (const Json& frame : GetArray(model.report, "unregistered_frames")) {
    rows.push_back(
        {Text(GetText(frame, "name")), Text(GetText(frame, "reason"))});
  }
  return Table({"frame", "reason"}, rows);
}

// The stretches of frames on one side of a seam.
std::string Stretches(const Json& stretches) {
  std::string text;
  for (const Json& names : stretches) {
    if (!names.is_array() || names.size() != 2 || !names[0].is_string() ||
        !names[1].is_string()) {
      continue;
    }
    if (!text.empty()) text += "; ";
    text += names[0].get<std::string>() + " to " + names[1].get<std::string>();
  }
  return Text(text);
}

std::string SeamTable(const PageModel& model) {
  std::vector<Row> rows;
  for (const Json& seam : GetArray(model.model_report, "seams")) {
    rows.push_back({Text(WithBlanks(GetText(seam, "reason"))),
                    Stretches(GetArray(seam, "frames_before")),
                    Stretches(GetArray(seam, "frames_after")),
                    Number(GetNumber(seam, "num_pairs"), 0),
                    Number(GetNumber(seam, "num_tracks"), 0),
                    Number(GetNumber(seam, "num_ties"), 0),
                    Number(GetNumber(seam, "sigma_position"), 4),
                    Number(GetNumber(seam, "sigma_rotation_deg"), 3)});
  }
  return Table({"seam", "frames before", "frames after", "pairs", "tracks",
                "ties", "sigma of position [" + LengthUnit(model) + "]",
                "sigma of rotation [deg]"},
               rows);
}

// Sigmas of three values as "a, b, c".
std::string Triple(const Json& values, int digits) {
  std::string html;
  if (!values.is_array()) return "&ndash;";
  for (const Json& value : values) {
    if (!html.empty()) html += ", ";
    html += value.is_number() ? Number(value.get<double>(), digits) : "&ndash;";
  }
  return html;
}

// The entry of a sensor in the report; null if there is none.
const Json& SensorReport(const PageModel& model, const std::string& name) {
  static const Json kNull;
  for (const Json& rig : GetArray(model.model_report, "rigs")) {
    for (const Json& sensor : GetArray(rig, "sensors")) {
      if (GetText(sensor, "name") == name) return sensor;
    }
  }
  return kNull;
}

std::string RigTable(const PageModel& model) {
  const Scene& scene = model.input.scene;
  std::vector<Row> rows;
  for (const Rig& rig : scene.rigs) {
    if (rig.sensor_idxs.size() < 2) continue;
    for (const int i : rig.sensor_idxs) {
      const auto& pose = model.input.reconstruction.sensor_from_rig[i];
      const Json& report = SensorReport(model, scene.sensors[i].name);
      const Json& sigma = Get(report, "sigma");
      std::string center = "not estimated", angle = "&ndash;";
      if (pose) {
        const Eigen::Vector3d c = pose->Center();
        center = Number(c.x(), 4) + ", " + Number(c.y(), 4) + ", " +
                 Number(c.z(), 4);
        angle = Number(RadToDeg(AngleBetween(pose->rotation,
                                             Eigen::Quaterniond::Identity())),
                       3);
      }
      rows.push_back({Count(rig.id.value()), Text(scene.sensors[i].name),
                      i == rig.ref_sensor_idx ? "reference" : center, angle,
                      Triple(Get(sigma, "translations"), 5),
                      Triple(Get(sigma, "rotations_deg"), 4)});
    }
  }
  const std::string unit = " [" + LengthUnit(model) + "]";
  return Table({"rig", "camera", "center in the rig" + unit, "rotation [deg]",
                "sigma of translation" + unit, "sigma of rotation [deg]"},
               rows);
}

std::string RejectedPairsTable(const PageModel& model) {
  std::vector<Row> rows;
  const Json& rejected = Get(model.report, "rejected_pairs");
  if (rejected.is_object()) {
    for (const auto& [reason, count] : rejected.items()) {
      if (count.is_number() && count.get<double>() > 0) {
        rows.push_back(
            {Text(WithBlanks(reason)), Number(count.get<double>(), 0)});
      }
    }
  }
  return Table({"reason of rejection (all models)", "pairs"}, rows);
}

std::string StatisticsRow(const char* name,
                          const std::optional<ErrorStatistics>& errors,
                          int digits) {
  if (!errors) return "";
  return std::string("<tr><td>") + name + "</td><td>" +
         Number(errors->median, digits) + "</td><td>" +
         Number(errors->mean, digits) + "</td><td>" +
         Number(errors->max, digits) + "</td></tr>\n";
}

std::string ErrorTable(const Evaluation& evaluation, const std::string& unit) {
  const std::string position = "position [" + unit + "]";
  return "<div class=\"scroll\"><table><thead><tr><th></th><th>median</th>"
         "<th>mean</th><th>largest</th></tr></thead><tbody>\n" +
         StatisticsRow(position.c_str(), evaluation.position_m, 4) +
         StatisticsRow("rotation [deg]", evaluation.rotation_deg, 4) +
         "</tbody></table></div>\n";
}

std::string TruthContent(const PageModel& model) {
  if (!model.input.truth) return "";
  const PoseComparison& truth = *model.input.truth;
  const Evaluation& evaluation = truth.evaluation;
  EvaluationLabels labels;
  labels.length_unit = LengthUnitName(evaluation);
  const std::string& unit = labels.length_unit;
  std::vector<Row> rows;
  for (const SensorErrors& sensor : evaluation.sensors) {
    rows.push_back({Text(sensor.name), Number(sensor.rotation_deg, 4),
                    Number(sensor.direction_deg, 3), Number(sensor.length_m, 4),
                    Number(sensor.true_length_m, 4)});
  }
  return "<p>Truth: " + Text(truth.label) + "; " +
         Share(static_cast<size_t>(evaluation.num_registered),
               static_cast<size_t>(evaluation.num_images)) +
         " of its images are registered.</p>\n" + ErrorTable(evaluation, unit) +
         Table({"camera in the rig", "rotation error [deg]",
                "direction error [deg]", "distance [" + unit + "]",
                "true distance [" + unit + "]"},
               rows) +
         ThemedChart(EvaluationToSvg(truth.images, evaluation, labels),
                     "path and errors against the truth");
}

std::string ComparisonContent(const PageModel& model) {
  if (!model.input.other) return "";
  const Evaluation& evaluation = model.input.other->evaluation;
  const std::string unit = LengthUnit(model);
  return "<p>Other model: " + Text(model.input.other->label) + "; it has " +
         Share(static_cast<size_t>(evaluation.num_registered),
               static_cast<size_t>(evaluation.num_images)) +
         " images of this one. Differences after similarity alignment, in "
         "the unit of this model:</p>\n" +
         ErrorTable(evaluation, unit) +
         ThemedChart(
             EvaluationToSvg(model.input.other->images, evaluation,
                             {"this model", "other", "difference", unit}),
             "path and differences of both models");
}

std::string RunContent(const PageModel& model) {
  const Json& input = Get(model.report, "input");
  std::vector<Row> rows;
  const auto add = [&](const char* name, const std::string& text) {
    if (!text.empty()) rows.push_back({name, Text(text)});
  };
  add("program", GetText(model.report, "mgsfm_version"));
  add("database", GetText(input, "database_path"));
  add("rigs", GetText(input, "rig_source"));
  for (const char* key : {"num_pairs", "num_matches", "num_keypoints"}) {
    if (const auto value = GetNumber(input, key)) {
      rows.push_back({key + 4, Number(*value, 0)});
    }
  }
  return ThemedChart(StageChart(model), "time and memory per stage") +
         Table({"", "value"}, rows);
}

}  // namespace

std::string SummarySection(const PageModel& model) {
  return Section("summary", "Summary",
                 WarningList(model) + Cards(model) + ReportSummary(model));
}

std::string DetailSections(const PageModel& model) {
  return Section("registration", "Registration",
                 ThemedChart(RegistrationChart(model),
                             "registered images of each camera over frames") +
                     SensorTable(model)) +
         Section("missing", "Frames that are not registered",
                 MissingTable(model)) +
         Section("seams", "Seams", SeamTable(model)) +
         Section("truth", "Errors against the ground truth",
                 TruthContent(model)) +
         Section("comparison", "Comparison of two models",
                 ComparisonContent(model)) +
         Section("errors", "Reprojection errors",
                 ThemedChart(ErrorHistogramChart(model),
                             "histogram of reprojection errors per camera")) +
         Section("error_maps", "Reprojection errors over the image plane",
                 ThemedChart(ErrorMapChart(model),
                             "mean reprojection error over the image")) +
         Section("tracks", "Track lengths",
                 ThemedChart(TrackLengthChart(model),
                             "number of points by track length")) +
         Section("rigs", "Rig calibration",
                 ThemedChart(RigChart(model), "poses of the cameras") +
                     RigTable(model)) +
         Section("view_graph", "View graph",
                 ThemedChart(ViewGraphChart(model), "common points of frames") +
                     "<p class=\"muted\">Neighboring frames are on the "
                     "diagonal, loops away from it.</p>\n" +
                     RejectedPairsTable(model)) +
         Section("run", "Time and memory", RunContent(model));
}

}  // namespace mgsfm
