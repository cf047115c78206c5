// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "base/text_tools.h"
#include "evaluation/evaluation_plot.h"
#include "report_page/charts.h"
#include "report_page/html_parts.h"
#include "report_page/sections.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

std::string Card(const std::string& value, const std::string& label) {
  return "<div class=\"card\"><b>" + value + "</b><span>" + label +
         "</span></div>";
}

// The largest side of the box of the frames.
std::optional<double> Extent(const PageModel& model) {
  Eigen::AlignedBox3d box;
  for (const auto& pose : model.input.reconstruction.rig_from_world) {
    if (pose) box.extend(pose->Center());
  }
  if (box.isEmpty()) return std::nullopt;
  return box.sizes().maxCoeff();
}

std::string Cards(const PageModel& model) {
  const PageStatistics& s = model.statistics;
  const Scene& scene = model.input.scene;
  const auto share = [](size_t part, size_t all) {
    return part == all ? Count(all)
                       : Count(part) + "&thinsp;/&thinsp;" + Count(all);
  };
  std::string html = "<div class=\"cards\">";
  html += Card(share(s.num_registered_images, scene.images.size()),
               "images registered");
  html += Card(share(s.num_registered_frames, scene.frames.size()),
               "frames registered");
  html += Card(Count(scene.sensors.size()), "cameras");
  html += Card(Count(model.input.reconstruction.points.size()), "points");
  html += Card(Number(Extent(model), 1, LengthUnit(model)), "extent");
  html +=
      Card(Number(s.errors.MeanErrorPx(), 3, "px"), "mean reprojection error");
  if (model.input.truth && model.input.truth->evaluation.position_m) {
    const Evaluation& evaluation = model.input.truth->evaluation;
    html += Card(
        Number(evaluation.position_m->median, 4, LengthUnitName(evaluation)),
        "median error against the truth");
  }
  return html + "</div>\n";
}

// The lines that state the accuracy of lengths and poses.
std::string TrustLine(const PageModel& model) {
  const Json& models = GetArray(Get(model.report, "summary"), "models");
  if (model.input.model_idx >= models.size()) return "";
  const Json& summary = models[model.input.model_idx];
  std::string html =
      "Lengths: " + Text(GetText(summary, "unit_of_length")) + ". ";
  std::optional<double> rotation_deg, translation;
  for (const Json& sensor : GetArray(summary, "rig_accuracy")) {
    const auto keep = [&](const char* key, std::optional<double>* largest) {
      const auto value = GetNumber(sensor, key);
      if (value) *largest = std::max(largest->value_or(0.0), *value);
    };
    keep("sigma_rotation_deg", &rotation_deg);
    keep("sigma_translation", &translation);
  }
  if (rotation_deg && translation) {
    html += "Standard deviations of the cameras in the rig: at most " +
            Number(rotation_deg, 4, "deg") + " and " +
            Number(translation, 4, LengthUnit(model)) + ".";
  } else if (Get(model.model_report, "covariances").is_null()) {
    html +=
        "The accuracy of poses is not computed; --compute_covariances 1 "
        "states it.";
  }
  return "<p>" + html + "</p>\n";
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
  const Json& frames = GetArray(warning, "frames");
  if (!html.empty() && !frames.empty() && frames[0].is_string()) {
    html += " " + FrameLink(frames[0].get<std::string>());
  }
  return html;
}

// A warning about frames belongs to the models that have one of them.
bool IsOfModel(const PageModel& model, const Json& warning,
               const FramesOfNames& frame_of_name) {
  bool is_known = false;
  for (const Json& name : GetArray(warning, "frames")) {
    const auto frame = name.is_string()
                           ? frame_of_name.find(name.get<std::string>())
                           : frame_of_name.end();
    if (frame == frame_of_name.end()) continue;
    if (model.input.reconstruction.rig_from_world[frame->second]) return true;
    is_known = true;
  }
  return !is_known;
}

// Warnings of one cause stand below each other, the first of them open.
std::string WarningList(const PageModel& model) {
  const auto frame_of_name = FramesByName(model.input.scene);
  std::vector<std::pair<std::string, std::vector<std::string>>> causes;
  const auto add = [&](const std::string& cause, const std::string& text) {
    if (text.empty()) return;
    auto group =
        std::find_if(causes.begin(), causes.end(),
                     [&](const auto& entry) { return entry.first == cause; });
    if (cause.empty() || group == causes.end()) {
      group = causes.insert(causes.end(), {cause, {}});
    }
    group->second.push_back(text);
  };
  for (const Json* report : {&model.report, &model.model_report}) {
    for (const Json& warning : GetArray(*report, "warnings")) {
      if (IsOfModel(model, warning, frame_of_name)) {
        add(GetText(warning, "cause"), WarningText(warning));
      }
    }
  }
  if (model.input.scene.images.empty()) {
    add("", "The model has no image.");
  } else if (model.input.reconstruction.points.empty()) {
    add("", "The model has no point.");
  }
  if (causes.empty()) return "";
  std::string html = "<ul class=\"warnings\">";
  for (const auto& [cause, texts] : causes) {
    html += "<li>" + texts.front();
    if (texts.size() > 1) {
      html += "<details><summary>" + Count(texts.size() - 1) +
              " more of this cause</summary>";
      for (size_t i = 1; i < texts.size(); ++i) {
        html += "<p>" + texts[i] + "</p>\n";
      }
      html += "</details>";
    }
    html += "</li>\n";
  }
  return html + "</ul>\n";
}

// Observations that are no reason to distrust the model.
std::string Notes(const PageModel& model) {
  std::vector<std::string> notes;
  const auto add = [&](size_t count, const std::string& text) {
    if (count > 0) notes.push_back(Count(count) + " " + text);
  };
  const size_t num_frames = model.input.scene.frames.size();
  add(num_frames - model.statistics.num_registered_frames,
      "frames are <a href=\"#missing\">not in this model</a>");
  add(GetArray(model.model_report, "seams").size(),
      "<a href=\"#seams\">seams</a> connect their parts weakly");
  add(GetArray(model.model_report, "rejected_groups").size(),
      "groups of image pairs contradict the model and are "
      "<a href=\"#view_graph\">rejected</a>");
  add(GetArray(Get(model.model_report, "bundle_adjustment"), "weak_frames")
          .size(),
      "frames have few observations");
  if (notes.empty()) return "";
  return "<p class=\"muted\">" + Joined(notes, "; ") + ".</p>\n";
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
      const bool is_on_cards =
          key == "num_images" || key == "num_registered_images";
      if (value.is_structured() || value.is_null() || is_on_cards) continue;
      rows.push_back(
          {Text(WithBlanks(key)),
           Text(value.is_string() ? value.get<std::string>() : value.dump())});
    }
    html += Table({"", "value"}, rows);
  }
  return html;
}

}  // namespace

std::string SummarySection(const PageModel& model) {
  const std::string warnings = WarningList(model);
  // Shown where the 3D view cannot be.
  const std::string plan =
      ThemedChart(TrajectoryChart(model), "the model from above");
  return "<section id=\"summary\">" + warnings + Cards(model) +
         (warnings.empty() ? "<p class=\"good\">No warning.</p>\n" : "") +
         TrustLine(model) + Notes(model) + ReportSummary(model) +
         "</section>\n" +
         (plan.empty()
              ? ""
              : "<section id=\"plan\" hidden>" + plan + "</section>\n");
}

}  // namespace mgsfm
