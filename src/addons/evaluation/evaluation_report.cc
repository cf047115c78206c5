// SPDX-License-Identifier: BSD-3-Clause
#include <nlohmann/json.hpp>

#include "base/format.h"
#include "evaluation/evaluation_plot.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

std::string SensorsToText(const std::vector<SensorErrors>& sensors,
                          const char* unit) {
  std::string text =
      Formatted("%-16s %12s %13s %10s %10s %9s\n", "sensor in rig", "rotation",
                "direction", "length", "true", "error");
  for (const SensorErrors& errors : sensors) {
    const std::string direction =
        errors.direction_deg ? Formatted("%.4f deg", *errors.direction_deg)
                             : "-";
    const std::string percent =
        errors.direction_deg
            ? Formatted("%+.2f %%",
                        100.0 * (errors.length_m / errors.true_length_m - 1.0))
            : "-";
    text += Formatted("%-16s %8.4f deg %13s %8.4f %s %8.4f %s %9s\n",
                      errors.name.c_str(), errors.rotation_deg,
                      direction.c_str(), errors.length_m, unit,
                      errors.true_length_m, unit, percent.c_str());
  }
  return text;
}

std::string StatisticsToText(const char* name, const char* unit,
                             const ErrorStatistics& errors) {
  std::string text = Formatted("%-16s", name);
  for (const double value :
       {errors.median, errors.mean, errors.max, errors.rms}) {
    text += Formatted(" %8.4f %-3s", value, unit);
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return text + "\n";
}

std::string AucToText(const char* name, const char* unit,
                      const std::vector<AreaUnderCurve>& areas) {
  std::string text = Formatted("%-16s", name);
  for (const AreaUnderCurve& auc : areas) {
    text += Formatted(" %.3f @ %g %s", auc.area, auc.threshold, unit);
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
  return {{"num_steps", steps->num_steps},
          {"rotation_deg", ToJson(std::optional(steps->rotation_deg))},
          {"translation_m", ToJson(std::optional(steps->translation_m))}};
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
  std::string text =
      Formatted("%-16s %d of %d\n", "registered", evaluation.num_registered,
                evaluation.num_images);
  if (!evaluation.world_from_model) {
    return text + "no alignment: no image to compare\n";
  }
  if (evaluation.position_m) {
    const ErrorStatistics& rotation = *evaluation.rotation_deg;
    const ErrorStatistics& position = *evaluation.position_m;
    text += Formatted("%-16s %12s %12s %12s %12s\n", "error of images",
                      "median", "mean", "max", "RMSE");
    text += StatisticsToText("rotation", "deg", rotation);
    text += StatisticsToText("position", unit, position);
    if (evaluation.steps) {
      const StepErrors& steps = *evaluation.steps;
      text += StatisticsToText("step rotation", "deg", steps.rotation_deg);
      text += StatisticsToText("step translation", unit, steps.translation_m);
    }
    if (evaluation.segments) {
      text +=
          Formatted("%-16s t_rel %.4f %%, r_rel %.4f deg/100 %s, %d segments\n",
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
  text += Formatted("%-16s %.4f %s between the farthest frames\n", "extent",
                    *evaluation.extent_m, unit);
  if (evaluation.path_m) {
    text += Formatted("%-16s %.4f %s\n", "true path", *evaluation.path_m, unit);
  }
  text += Formatted("%-16s %.9g %s per unit of the model\n", "scale",
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
