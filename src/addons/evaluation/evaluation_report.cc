// SPDX-License-Identifier: BSD-3-Clause
#include <cstdarg>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "evaluation/error_statistics.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

__attribute__((format(printf, 1, 2))) std::string Format(const char* format,
                                                         ...) {
  char line[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof(line), format, arguments);
  va_end(arguments);
  return line;
}

double LengthErrorPercent(const SensorErrors& errors) {
  return 100.0 * (errors.length_m / errors.true_length_m - 1.0);
}

std::string SensorsToText(const std::vector<SensorErrors>& sensors,
                          const char* unit) {
  std::string text = Format("%-16s %12s %13s %10s %10s %9s\n", "sensor in rig",
                            "rotation", "direction", "length", "true", "error");
  for (const SensorErrors& errors : sensors) {
    const std::string direction =
        errors.direction_deg ? Format("%.4f deg", *errors.direction_deg) : "-";
    const std::string percent =
        errors.direction_deg ? Format("%+.2f %%", LengthErrorPercent(errors))
                             : "-";
    text += Format("%-16s %8.4f deg %13s %8.4f %s %8.4f %s %9s\n",
                   errors.name.c_str(), errors.rotation_deg, direction.c_str(),
                   errors.length_m, unit, errors.true_length_m, unit,
                   percent.c_str());
  }
  return text;
}

std::string StatisticsToText(const char* name, const char* unit,
                             const ErrorStatistics& errors) {
  std::string text = Format("%-16s", name);
  for (const double value :
       {errors.median, errors.mean, errors.max, errors.rms}) {
    text += Format(" %8.4f %-3s", value, unit);
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return text + "\n";
}

std::string AucToText(const char* name, const char* unit,
                      const std::vector<AreaUnderCurve>& areas) {
  std::string text = Format("%-16s", name);
  for (const AreaUnderCurve& auc : areas) {
    text += Format(" %.3f @ %g %s", auc.area, auc.threshold, unit);
  }
  return text + "\n";
}

Json ToJson(const std::optional<ErrorStatistics>& statistics) {
  if (!statistics) return nullptr;
  return {{"median", statistics->median},
          {"mean", statistics->mean},
          {"max", statistics->max},
          {"rmse", statistics->rms}};
}

Json ToJson(const std::optional<SegmentErrors>& segments) {
  if (!segments) return nullptr;
  return {{"num_segments", segments->num_segments},
          {"t_rel_percent", segments->translation_percent},
          {"r_rel_deg_per_100m", segments->rotation_deg_per_100m}};
}

Json ToJson(const std::optional<StepErrors>& steps) {
  if (!steps) return nullptr;
  const std::optional<ErrorStatistics> rotation = steps->rotation_deg;
  const std::optional<ErrorStatistics> translation = steps->translation_m;
  return {{"num_steps", steps->num_steps},
          {"rotation_deg", ToJson(rotation)},
          {"translation_m", ToJson(translation)}};
}

Json ToJson(const std::vector<AreaUnderCurve>& areas) {
  Json json = Json::array();
  for (const AreaUnderCurve& auc : areas) {
    json.push_back({{"threshold", auc.threshold}, {"area", auc.area}});
  }
  return json;
}

// x_in_world = scale R x_in_model + translation.
Json ToJson(const Sim3& world_from_model) {
  const Eigen::Quaterniond& q = world_from_model.rotation;
  const Eigen::Vector3d& t = world_from_model.translation;
  return {{"scale", world_from_model.scale},
          {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
          {"translation_m", {t.x(), t.y(), t.z()}}};
}

}  // namespace

std::string EvaluationToText(const Evaluation& evaluation) {
  const char* const unit = LengthUnitName(evaluation);
  std::string text = Format("%-16s %d of %d\n", "registered",
                            evaluation.num_registered, evaluation.num_images);
  if (!evaluation.world_from_model) {
    return text + "no alignment: no image to compare\n";
  }
  if (evaluation.position_m) {
    const ErrorStatistics& rotation = *evaluation.rotation_deg;
    const ErrorStatistics& position = *evaluation.position_m;
    text += Format("%-16s %12s %12s %12s %12s\n", "error of images", "median",
                   "mean", "max", "RMSE");
    text += StatisticsToText("rotation", "deg", rotation);
    text += StatisticsToText("position", unit, position);
    if (evaluation.steps) {
      const StepErrors& steps = *evaluation.steps;
      text += StatisticsToText("step rotation", "deg", steps.rotation_deg);
      text += StatisticsToText("step translation", unit, steps.translation_m);
    }
    if (evaluation.segments) {
      text +=
          Format("%-16s t_rel %.4f %%, r_rel %.4f deg/100 %s, %d segments\n",
                 "KITTI", evaluation.segments->translation_percent,
                 evaluation.segments->rotation_deg_per_100m, unit,
                 evaluation.segments->num_segments);
    }
    text += AucToText("rotation AUC", "deg", evaluation.rotation_auc);
    text += AucToText("position AUC", unit, evaluation.position_auc);
  }
  if (!evaluation.sensors.empty()) {
    text += SensorsToText(evaluation.sensors, unit);
  }
  text += Format("%-16s %.4f %s between the farthest frames\n", "extent",
                 *evaluation.extent_m, unit);
  if (evaluation.path_m) {
    text += Format("%-16s %.4f %s\n", "true path", *evaluation.path_m, unit);
  }
  text += Format("%-16s %.9g %s per unit of the model\n", "scale",
                 evaluation.world_from_model->scale, unit);
  return text;
}

std::string EvaluationToJson(const Evaluation& evaluation) {
  Json json = {{"num_images", evaluation.num_images},
               {"num_registered", evaluation.num_registered},
               {"length_unit", LengthUnitName(evaluation)},
               {"rotation_deg", ToJson(evaluation.rotation_deg)},
               {"position_m", ToJson(evaluation.position_m)},
               {"rotation_auc", ToJson(evaluation.rotation_auc)},
               {"position_auc", ToJson(evaluation.position_auc)},
               {"kitti", ToJson(evaluation.segments)},
               {"rpe", ToJson(evaluation.steps)},
               {"sensors", Json::array()}};
  for (const SensorErrors& errors : evaluation.sensors) {
    json["sensors"].push_back(
        {{"name", errors.name},
         {"rotation_deg", errors.rotation_deg},
         {"direction_deg",
          errors.direction_deg ? Json(*errors.direction_deg) : Json(nullptr)},
         {"length_m", errors.length_m},
         {"true_length_m", errors.true_length_m}});
  }
  if (evaluation.world_from_model) {
    json["extent_m"] = *evaluation.extent_m;
    if (evaluation.path_m) json["path_m"] = *evaluation.path_m;
    json["world_from_model"] = ToJson(*evaluation.world_from_model);
  }
  return json.dump(2) + "\n";
}

}  // namespace mgsfm
