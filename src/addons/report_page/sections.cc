// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/sections.h"

#include <algorithm>
#include <functional>
#include <tuple>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "evaluation/evaluation_plot.h"
#include "evaluation/svg.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"
#include "report_page/charts.h"
#include "report_page/encoding.h"
#include "report_page/html_parts.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

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

// The share of the image plane where points are seen, by the cells of the map
// of errors.
std::string CoverageCell(const SensorStatistics& sensor) {
  const auto num_seen = CountIf(sensor.cells, [](const ImageCell& cell) {
    return cell.num_residuals > 0;
  });
  return Number(100.0 * static_cast<double>(num_seen) /
                    static_cast<double>(sensor.cells.size()),
                0, "%");
}

std::string SensorTable(const PageModel& model) {
  const Scene& scene = model.input.scene;
  std::vector<Row> rows;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const SensorStatistics& s = model.statistics.sensors[i];
    const Camera& camera =
        model.input.reconstruction.cameras[scene.sensors[i].camera_idx];
    const auto params = Transformed(
        camera.params, [](double value) { return Number(value, 4); });
    rows.push_back(
        {Text(scene.sensors[i].name.empty() ? "images" : scene.sensors[i].name),
         Share(s.num_registered, s.num_images), Count(s.errors.num_points),
         CoverageCell(s), Number(s.errors.MeanErrorPx(), 3),
         std::string(InfoOf(camera.model).name) + " " +
             Count(static_cast<size_t>(camera.width_px)) + "&times;" +
             Count(static_cast<size_t>(camera.height_px)),
         Joined(params, ", "), FocalLengthCell(model, camera)});
  }
  return Table(
      {"camera", "images registered", "observations", "coverage of the image",
       "mean error [px]", "model", "parameters", "focal length [px]"},
      rows);
}

// Successive frames that miss for the same reason share a row.
std::string MissingTable(const PageModel& model) {
  struct Group {
    std::string first, last, reason;
    size_t num_frames = 0;
  };
  std::vector<Group> groups;
  for (const Json& frame : GetArray(model.report, "unregistered_frames")) {
    const std::string name = GetText(frame, "name");
    const std::string reason = GetText(frame, "reason");
    if (groups.empty() || groups.back().reason != reason) {
      groups.push_back({name, name, reason, 0});
    }
    groups.back().last = name;
    ++groups.back().num_frames;
  }
  std::vector<Row> rows;
  for (const Group& group : groups) {
    rows.push_back(
        {Text(group.num_frames == 1 ? group.first
                                    : group.first + " to " + group.last),
         Count(group.num_frames), Text(group.reason), FrameLink(group.first)});
  }
  return Table({"frames", "number", "reason", "in the view"}, rows);
}

// The stretches of frames on one side of a seam.
std::string Stretches(const Json& stretches) {
  std::vector<std::string> texts;
  for (const Json& names : stretches) {
    const auto ends = GetTwoNames(names);
    if (ends) texts.push_back(ends->first + " to " + ends->second);
  }
  return Text(Joined(texts, "; "));
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
  if (!values.is_array()) return "&ndash;";
  const auto texts = Transformed(values, [&](const Json& value) {
    return value.is_number() ? Number(value.get<double>(), digits) : "&ndash;";
  });
  return Joined(texts, ", ");
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
        rows.push_back({Text(WithBlanks(reason)), Count(count.get<size_t>())});
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
  const std::string unit = LengthUnitName(evaluation);
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
         ThemedChart(EvaluationToSvg(truth.images, evaluation),
                     "path and errors against the truth");
}

std::string PositionsContent(const PageModel& model) {
  if (!model.input.positions) return "";
  const PoseComparison& positions = *model.input.positions;
  std::vector<Row> rows;
  for (const Json& outlier :
       GetArray(Get(model.model_report, "position_priors"), "outliers")) {
    rows.push_back({Text(GetText(outlier, "image")),
                    Number(GetNumber(outlier, "distance"), 2, "m")});
  }
  return ErrorTable(positions.evaluation, "m") +
         ThemedChart(EvaluationToSvg(positions.images, positions.evaluation,
                                     {"model", "measured", "residual", "m"}),
                     "map and residuals of measured positions") +
         Table({"position that the model contradicts", "residual"}, rows);
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

// The stages of a run and of its model with their total, as bars. Those of the
// run that follow the models come last.
std::string StageTable(const PageModel& model) {
  std::vector<std::tuple<std::string, double, std::optional<double>>> stages;
  double total_s = 0.0, max_s = 0.0;
  const auto add =
      [&](const Json& report,
          const std::function<bool(const std::string&)>& is_added) {
        const Json& seconds = Get(report, "seconds");
        if (!seconds.is_object()) return;
        for (const auto& [name, value] : seconds.items()) {
          if (!value.is_number() || !is_added(name)) continue;
          stages.emplace_back(
              name, value.get<double>(),
              GetNumber(Get(report, "peak_memory_mib_after"), name.c_str()));
          total_s += value.get<double>();
          max_s = std::max(max_s, value.get<double>());
        }
      };
  const auto is = [](const char* stage) {
    return [=](const std::string& name) { return name == stage; };
  };
  add(model.report, [](const std::string& name) {
    return name != "input check" && name != "writing";
  });
  add(model.model_report, [](const std::string&) { return true; });
  add(model.report, is("input check"));
  add(model.report, is("writing"));
  std::vector<Row> rows;
  for (const auto& [name, seconds, peak_mib] : stages) {
    const double share = 100.0 * seconds / std::max(max_s, 1e-9);
    rows.push_back({Text(name), Number(seconds, 2, "s"),
                    peak_mib ? Number(peak_mib, 0, "MiB") : "",
                    "<i class=\"amount\" style=\"width:" +
                        FormatNumber(share, 1) + "%\"></i>"});
  }
  if (rows.size() > 1) {
    rows.push_back({"<b>all</b>", Number(total_s, 2, "s"), "", ""});
  }
  return Table({"stage", "time", "peak memory so far", ""}, rows);
}

std::string RunContent(const PageModel& model) {
  const Json& input = Get(model.report, "input");
  std::vector<Row> rows;
  const auto add = [&](const char* name, const std::string& text) {
    if (!text.empty()) rows.push_back({name, Text(text)});
  };
  add("written", GetText(model.report, "date"));
  const std::string commit = GetText(model.report, "commit");
  add("program", GetText(model.report, "mgsfm_version") +
                     (commit.empty() ? "" : ", commit " + commit));
  add("command", GetText(model.report, "command"));
  const Json& changed = Get(model.report, "changed_options");
  if (changed.is_object()) {
    std::string list;
    for (const auto& [name, value] : changed.items()) {
      list += (list.empty() ? "" : ", ") + name + " " +
              (value.is_string() ? value.get<std::string>() : value.dump());
    }
    add("options that differ from their defaults", list);
  }
  add("database", GetText(input, "database_path"));
  add("rigs", GetText(input, "rig_source"));
  for (const char* key : {"num_pairs", "num_matches", "num_keypoints"}) {
    if (const auto value = GetNumber(input, key)) {
      rows.push_back({key + 4, Count(static_cast<size_t>(*value))});
    }
  }
  const Json& options = Get(model.report, "options");
  return StageTable(model) + Table({"", "value"}, rows) +
         (options.is_null() ? ""
                            : "<details><summary>All options</summary><pre>" +
                                  EscapeHtml(Shorten(options.dump(1), 20000)) +
                                  "</pre></details>\n");
}

}  // namespace

std::string DetailSections(const PageModel& model) {
  const size_t num_sensors = ChartSensors(model).size();
  return Section("registration", "Registration",
                 "Frames from left to right, in the order of the slider: green "
                 "are registered, orange in part, red not.",
                 RegistrationBars(model) + SensorTable(model)) +
         Section("missing", "Frames in no model",
                 "The reasons, from the report of the run.",
                 MissingTable(model)) +
         Section("seams", "Seams",
                 "Places where few matches hold two parts of the model "
                 "together.",
                 SeamTable(model)) +
         Section("truth", "Errors against the ground truth",
                 "After alignment of the model with the truth.",
                 TruthContent(model)) +
         Section("positions", "Measured positions",
                 "Distances of the model from the measured positions of its "
                 "images.",
                 PositionsContent(model)) +
         Section("comparison", "Comparison of two models",
                 "After alignment of the other model with this one.",
                 ComparisonContent(model)) +
         Section("errors", "Reprojection errors",
                 "Between keypoints and projected points, per camera.",
                 ThemedColumns(ErrorHistogramChart(model),
                               "errors of reprojection per camera",
                               kHistogramColumns, num_sensors)) +
         Section(
             "error_maps", "Reprojection errors over the image plane",
             "Color: mean error; arrows: mean residual where significant; "
             "empty parts have no observation. Arrows that form a pattern "
             "show a wrong lens model.",
             ThemedColumns(ErrorMapChart(model), "maps of reprojection errors",
                           kMapColumns, num_sensors)) +
         Section("tracks", "Track lengths",
                 "Points by the number of images "
                 "that see them.",
                 ThemedChart(TrackLengthChart(model),
                             "number of points by track length")) +
         Section("rigs", "Rig calibration",
                 "The cameras of a rig, with their standard deviations if they "
                 "were computed.",
                 ThemedColumns(RigChart(model), "rig with poses of the cameras",
                               kRigColumns, 2) +
                     RigTable(model)) +
         Section("view_graph", "View graph",
                 "Common points of pairs of frames. Neighbors are on the "
                 "diagonal, loops away from it. A click on a cell shows two "
                 "images of its frames.",
                 ThemedChart(ViewGraphChart(model), "common points of frames") +
                     RejectedPairsTable(model)) +
         Section("run", "Run",
                 "Stages with their time and the peak of memory "
                 "so far, the command and its options.",
                 RunContent(model));
}

}  // namespace mgsfm