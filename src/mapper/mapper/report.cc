// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/mapper/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/text_streams.h"
#include "base/text_tools.h"
#include "bundle_adjustment/covariance_report.h"
#include "geometry/so3.h"
#include "mapper/run_summary.h"
#include "mgsfm/base/mask.h"
#include "scene/fields_json.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

// One value per stage.
Json ToJson(const std::vector<StageTime>& times, double StageTime::*value) {
  Json json = Json::object();
  for (const StageTime& time : times) json[time.stage] = time.*value;
  return json;
}

void AddTimes(const std::vector<StageTime>& times, Json* json) {
  (*json)["seconds"] = ToJson(times, &StageTime::seconds);
  (*json)["processor_seconds"] = ToJson(times, &StageTime::processor_seconds);
  (*json)["peak_memory_mib_after"] = ToJson(times, &StageTime::peak_memory_mib);
}

Json ToJson(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  return {{"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
          {"translation", {t.x(), t.y(), t.z()}}};
}

Json ToJson(const Scene& scene, const KeptMatches& kept) {
  Json cameras = Json::object();
  for (size_t k = 0; k < kept.sensors.size(); ++k) {
    cameras[scene.sensors[k].name] = kept.sensors[k].Share();
  }
  return {{"num_matches", kept.total.num_matches},
          {"share", kept.total.Share()},
          {"share_of_cameras", cameras}};
}

Json InputToJson(const Scene& scene, const ViewGraph& view_graph,
                 const RunDescription& run) {
  size_t num_keypoints = 0, num_matches = 0;
  for (const Image& image : scene.images) {
    num_keypoints += image.keypoints_px.size();
  }
  for (const ImagePair& pair : view_graph.pairs) {
    num_matches += pair.matches.size();
  }
  Json json = {{"database_path", run.database_path},
               {"rig_source", run.rig_source},
               {"num_cameras", scene.cameras.size()},
               {"num_rigs", scene.rigs.size()},
               {"num_sensors", scene.sensors.size()},
               {"num_frames", scene.frames.size()},
               {"num_images", scene.images.size()},
               {"num_keypoints", num_keypoints},
               {"num_pairs", view_graph.pairs.size()},
               {"num_matches", num_matches}};
  if (!run.input_path.empty()) json["input_path"] = run.input_path;
  return json;
}

// The models list the outliers of gravity.
Json ToJson(const JsonFields& fields, const RotationSummary& summary) {
  Json json = fields.ToJson(summary);
  if (!summary.gravity) return json;
  json["gravity"]["num_outliers"] = summary.gravity->outliers.size();
  json["gravity"].erase("outliers");
  return json;
}

Json ToJson(const std::vector<RejectionCount>& rejected_pairs) {
  Json json = Json::object();
  for (const RejectionCount& count : rejected_pairs) {
    json[EnumName(count.reason)] = count.num_pairs;
  }
  return json;
}

// Segments of consecutive registered frames on one side of a seam, each as its
// first and last name.
Json StretchesOfSide(const Scene& scene, const Reconstruction& reconstruction,
                     const Mask& frame_is_beyond, bool is_beyond) {
  Json stretches = Json::array();
  bool continues = false;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (!reconstruction.rig_from_world[i]) continue;
    const bool is_on_side = (frame_is_beyond[i] != 0) == is_beyond;
    const std::string& name = scene.frames[i].name;
    if (is_on_side && continues) stretches.back()[1] = name;
    if (is_on_side && !continues) stretches.push_back({name, name});
    continues = is_on_side;
  }
  return stretches;
}

// "Before" and "after" are the sides in the order of their first frames.
Json ToJson(const Scene& scene, const Reconstruction& reconstruction,
            const Seam& seam) {
  Mask is_beyond(scene.frames.size(), false);
  for (const int i : seam.frame_idxs_beyond) is_beyond[i] = true;
  const Json core = StretchesOfSide(scene, reconstruction, is_beyond, false);
  const Json beyond = StretchesOfSide(scene, reconstruction, is_beyond, true);
  const auto& poses = reconstruction.rig_from_world;
  const auto first =
      std::find_if(poses.begin(), poses.end(),
                   [](const auto& pose) { return pose.has_value(); });
  const std::string& core_frame = scene.frames[seam.frame_idx_core].name;
  const std::string& beyond_frame = scene.frames[seam.frame_idx_beyond].name;
  const bool beyond_is_first = is_beyond[first - poses.begin()];
  Json json = {{"reason", EnumName(seam.reason)},
               {"frames_before", beyond_is_first ? beyond : core},
               {"frames_after", beyond_is_first ? core : beyond},
               {"frame_before", beyond_is_first ? beyond_frame : core_frame},
               {"frame_after", beyond_is_first ? core_frame : beyond_frame},
               {"weaker_side", beyond_is_first ? "before" : "after"},
               {"num_frames_of_weaker_side", seam.frame_idxs_beyond.size()}};
  json.update(JsonFields(scene).ToJson(seam));
  return json;
}

// Standard deviations of the pose of a sensor.
Json SensorSigmaToJson(const MapperModel& model, int sensor_idx) {
  if (!model.covariances || !model.covariances->is_usable) return nullptr;
  const auto& covariance = model.covariances->sensors[sensor_idx];
  if (!covariance) return nullptr;
  Json rotations_deg = Json::array(), translations = Json::array();
  for (int i = 0; i < 3; ++i) {
    rotations_deg.push_back(RadToDeg(std::sqrt((*covariance)(i, i))));
    translations.push_back(std::sqrt((*covariance)(3 + i, 3 + i)));
  }
  return {{"rotations_deg", rotations_deg}, {"translations", translations}};
}

// The calibrated rigs of one model, and how each sensor was determined.
Json RigsToJson(const Scene& scene, const RotationSummary& rotation,
                const MapperModel& model) {
  const JsonFields fields(scene);
  Json rigs = Json::array();
  for (const Rig& rig : scene.rigs) {
    Json sensors = Json::array();
    for (const int sensor_idx : rig.sensor_idxs) {
      const Sensor& sensor = scene.sensors[sensor_idx];
      const auto& pose = model.reconstruction.sensor_from_rig[sensor_idx];
      sensors.push_back(
          {{"name", sensor.name},
           {"camera_id", scene.cameras[sensor.camera_idx].id.value()},
           {"is_reference", sensor_idx == rig.ref_sensor_idx},
           {"was_known", sensor.sensor_from_rig.has_value()},
           {"sensor_from_rig", pose ? ToJson(*pose) : Json(nullptr)},
           {"rotation", fields.ToJson(rotation.sensors[sensor_idx])},
           {"translation",
            fields.ToJson(model.translation.sensors[sensor_idx])},
           {"sigma", SensorSigmaToJson(model, sensor_idx)}});
    }
    rigs.push_back({{"rig_id", rig.id.value()}, {"sensors", sensors}});
  }
  return rigs;
}

Json ModelToJson(const Scene& scene, const RotationSummary& rotation,
                 const ModelSummary& summary, const MapperModel& model) {
  const JsonFields fields(scene);
  Json json = {{"num_frames", summary.num_frames},
               {"num_frames_in_component", model.num_frames_in_component},
               {"num_images", summary.num_images},
               {"num_points", summary.num_points},
               {"num_observations", summary.num_observations},
               {"mean_reprojection_error_px",
                fields.ToJson(summary.mean_reprojection_error_px)},
               {"rigs", RigsToJson(scene, rotation, model)}};
  const auto add = [&](const char* key, const auto& optional) {
    if (optional) json[key] = fields.ToJson(*optional);
  };
  if (summary.kept_share) {
    json["kept_matches"] = ToJson(scene, model.kept_matches);
  }
  add("extension", model.extension);
  add("finished_map", model.finished_map);
  if (!model.extension) {
    json["tracks"] = fields.ToJson(model.tracks);
    json["translation_averaging"] = fields.ToJson(model.translation);
    json["rejected_groups"] = fields.ToJson(model.rejected_groups);
    json["seams"] = Json::array();
    for (const Seam& seam : model.confidence.seams) {
      json["seams"].push_back(ToJson(scene, model.reconstruction, seam));
    }
  }
  json["bundle_adjustment"] = fields.ToJson(model.bundle);
  add("position_priors", model.position_priors);
  add("gravity", model.gravity);
  json["lenses"] = fields.ToJson(summary.lenses);
  add("delays", model.delays);
  if (model.delays && model.delays->unit) {
    json["delays"]["unit_of_length"] = fields.ToJson(*model.delays->unit);
  }
  add("covariances", model.covariances);
  if (model.covariances) {
    json["covariances"]["message"] =
        DescribeUnobservable(scene, model.reconstruction, *model.covariances);
  }
  if (model.soft_rig_images) {
    json["soft_rig"] = fields.ToJson(model.soft_rig_images->summary);
  }
  AddTimes(model.times, &json);
  return json;
}

}  // namespace

std::string MapperReportToJson(const Scene& scene, const ViewGraph& view_graph,
                               const MapperResult& result,
                               const RunDescription& run) {
  const JsonFields fields(scene);
  const RunSummary summary = SummarizeRun(scene, result);
  Json report = {{"summary", fields.ToJson(summary)},
                 {"warnings", fields.ToJson(result.findings)},
                 {"mgsfm_version", run.version},
                 {"commit", run.commit},
                 {"date", run.date},
                 {"command", run.command},
                 {"input", InputToJson(scene, view_graph, run)},
                 {"options", Json::parse(run.options_json)},
                 {"changed_options", Json::parse(run.changed_options_json)},
                 {"random_seed", run.random_seed},
                 {"view_graph", fields.ToJson(result.view_graph)}};
  if (result.incremental) {
    report["incremental"] = fields.ToJson(*result.incremental);
  } else if (run.input_path.empty()) {
    report["rotation_averaging"] = ToJson(fields, result.rotation);
  }
  if (run.input_path.empty()) {
    report["rejected_pairs"] = ToJson(result.rejected_pairs);
    report["motion_was_refuted"] = result.motion_was_refuted;
  }
  if (!result.focal_lengths.empty()) {
    report["focal_lengths"] = fields.ToJson(result.focal_lengths);
  }
  if (result.lenses) report["lenses"] = fields.ToJson(*result.lenses);
  report["models"] = Json::array();
  for (size_t i = 0; i < result.models.size(); ++i) {
    report["models"].push_back(ModelToJson(
        scene, result.rotation, summary.models[i], result.models[i]));
  }
  report["unregistered_frames"] = fields.ToJson(result.unregistered_frames);
  std::vector<StageTime> times = run.times;
  times.insert(times.end(), result.times.begin(), result.times.end());
  AddTimes(times, &report);
  report["peak_memory_mib"] = run.peak_memory_mib;
  return report.dump(2) + "\n";
}

std::string FramesToCsv(const Scene& scene, const MapperModel& model) {
  std::vector<size_t> num_images(scene.frames.size(), 0);
  std::vector<size_t> num_observations(scene.frames.size(), 0);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    num_images[scene.images[i].frame_idx] +=
        model.reconstruction.IsRegistered(scene, static_cast<int>(i));
  }
  for (const Point3D& point : model.reconstruction.points) {
    for (const Observation& observation : point.track) {
      ++num_observations[scene.images[observation.image_idx].frame_idx];
    }
  }
  TextOutput csv;
  csv << "frame,num_images,num_observations,confidence\n";
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (!model.confidence.of_frame[i]) continue;
    csv << QuoteCsv(scene.frames[i].name) << ',' << num_images[i] << ','
        << num_observations[i] << ',' << *model.confidence.of_frame[i] << '\n';
  }
  return csv.str();
}

}  // namespace mgsfm
