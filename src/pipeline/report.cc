// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/pipeline/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/text_streams.h"
#include "base/text_tools.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "pipeline/covariance_report.h"
#include "pipeline/run_summary.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

template <class T>
Json ToJson(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json ToJson(const SolveSummary& summary) {
  return {{"termination", TerminationName(summary.termination)},
          {"num_iterations", summary.num_iterations},
          {"initial_cost", summary.initial_cost},
          {"final_cost", summary.final_cost},
          {"message", summary.message}};
}

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

Json ToJson(const RunSummary& summary) {
  Json json = {{"num_images", summary.num_images},
               {"num_registered_images", summary.num_registered_images},
               {"missing_frames", Json::array()},
               {"models", Json::array()}};
  for (const auto& [reason, count] : summary.missing_frames) {
    json["missing_frames"].push_back(
        {{"num_frames", count}, {"reason", reason}});
  }
  for (const ModelSummary& model : summary.models) {
    Json sensors = Json::array();
    for (const SensorAccuracy& sensor : model.accuracies) {
      sensors.push_back({{"name", sensor.name},
                         {"sigma_rotation_deg", sensor.sigma_rotation_deg},
                         {"sigma_translation", sensor.sigma_translation},
                         {"place_is_determined", sensor.place_is_determined}});
    }
    json["models"].push_back({{"num_frames", model.num_frames},
                              {"num_images", model.num_images},
                              {"num_points", model.num_points},
                              {"mean_reprojection_error_px",
                               ToJson(model.mean_reprojection_error_px)},
                              {"kept_share", ToJson(model.kept_share)},
                              {"unit_of_length", model.unit_of_length},
                              {"rig_accuracy", sensors}});
  }
  return json;
}

Json ToJson(const std::vector<Finding>& findings) {
  Json json = Json::array();
  for (const Finding& finding : findings) {
    Json evidence = Json::object();
    for (const auto& [name, value] : finding.evidence) evidence[name] = value;
    json.push_back({{"cause", EnumName(finding.cause)},
                    {"cameras", finding.cameras},
                    {"frames", finding.frames},
                    {"text", finding.text},
                    {"remedy", finding.remedy},
                    {"evidence", evidence}});
  }
  return json;
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

Json ToJson(const Scene& scene,
            const std::vector<FocalLengthEstimate>& estimates) {
  Json json = Json::array();
  for (const FocalLengthEstimate& estimate : estimates) {
    json.push_back(
        {{"camera_id", scene.cameras[estimate.camera_idx].id.value()},
         {"prior_px", estimate.prior_px},
         {"estimated_px", ToJson(estimate.estimated_px)},
         {"relative_sigma", ToJson(estimate.sigma)},
         {"num_pairs", estimate.num_pairs},
         {"message", estimate.message}});
  }
  return json;
}

Json ToJson(const Scene& scene, const LensSummary& summary) {
  Json cameras = Json::array();
  for (const LensChoice& lens : summary.lenses) {
    cameras.push_back(
        {{"camera_id", scene.cameras[lens.camera_idx].id.value()},
         {"model", FindCameraModel(static_cast<int32_t>(lens.model))->name},
         {"reason", lens.reason}});
  }
  return {{"num_rounds", summary.num_rounds}, {"cameras", cameras}};
}

Json ToJson(const ViewGraphSummary& summary) {
  return {{"num_pairs", summary.num_pairs},
          {"num_matches", summary.num_matches},
          {"num_inliers", summary.num_inliers},
          {"kept",
           {{"pose_from_row", summary.num_from_row},
            {"pose_from_E_F_or_H", summary.num_decomposed},
            {"pose_estimated_anew", summary.num_reestimated},
            {"of_these_without_parallax", summary.num_low_parallax}}},
          {"dropped",
           {{"too_few_inliers", summary.num_dropped_few_inliers},
            {"degenerate_or_watermark", summary.num_dropped_config}}}};
}

Json ToJson(const Scene& scene, const GravitySummary& summary) {
  Json json = {{"num_priors", summary.num_priors},
               {"median_error_deg", ToJson(summary.median_error_deg)},
               {"outliers", Json::array()}};
  for (const GravitySummary::Outlier& outlier : summary.outliers) {
    json["outliers"].push_back({{"image", scene.images[outlier.image_idx].name},
                                {"error_deg", outlier.error_deg}});
  }
  return json;
}

Json ToJson(const Scene& scene, const LensValue& lens) {
  return {{"camera_id", scene.cameras[lens.camera_idx].id.value()},
          {"model", FindCameraModel(static_cast<int32_t>(lens.model))->name},
          {"prior_px", lens.prior_px},
          {"focal_length_px", lens.focal_length_px},
          {"relative_sigma", ToJson(lens.relative_sigma)},
          {"source", EnumName(lens.source)},
          {"message", lens.message}};
}

Json ToJson(const RotationSummary& summary) {
  Json gravity = nullptr;
  if (summary.gravity) {
    gravity = {{"num_priors", summary.gravity->num_priors},
               {"median_error_deg", ToJson(summary.gravity->median_error_deg)},
               {"num_outliers", summary.gravity->outliers.size()}};
  }
  return {{"gravity", gravity},
          {"images", ToJson(summary.images)},
          {"frames", ToJson(summary.frames)},
          {"joint", ToJson(summary.joint)},
          {"num_components", summary.num_components},
          {"median_error_deg", ToJson(summary.median_error_deg)},
          {"dropped",
           {{"without_relative_rotation", summary.num_pairs_without_rotation},
            {"of_unobservable_sensors", summary.num_pairs_unobservable},
            {"inconsistent", summary.num_pairs_dropped},
            {"unsupported_bridges", summary.num_unsupported_bridges}}}};
}

Json ToJson(const std::vector<RejectionCount>& rejected_pairs) {
  Json json = Json::object();
  for (const RejectionCount& count : rejected_pairs) {
    json[EnumName(count.reason)] = count.num_pairs;
  }
  return json;
}

Json ToJson(const TrackSummary& summary) {
  return {
      {"num_components", summary.num_components},
      {"num_components_with_conflicts", summary.num_components_with_conflicts},
      {"num_tracks", summary.num_tracks},
      {"num_observations", summary.num_observations},
      {"mean_track_length", summary.mean_track_length}};
}

Json ToJson(const Scene& scene, const std::vector<RejectedGroup>& groups) {
  Json json = Json::array();
  const auto names = [&](int first, int last) {
    return Json{scene.frames[first].name, scene.frames[last].name};
  };
  for (const RejectedGroup& group : groups) {
    json.push_back(
        {{"num_pairs", group.pair_idxs.size()},
         {"frames1", names(group.first_frame_idx1, group.last_frame_idx1)},
         {"frames2", names(group.first_frame_idx2, group.last_frame_idx2)}});
  }
  return json;
}

// Stretches of consecutive registered frames on one side of a seam, each by its
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
            const std::vector<Seam>& seams) {
  Json json = Json::array();
  for (const Seam& seam : seams) {
    Mask is_beyond(scene.frames.size(), false);
    for (const int i : seam.frame_idxs_beyond) is_beyond[i] = true;
    const Json core = StretchesOfSide(scene, reconstruction, is_beyond, false);
    const Json beyond = StretchesOfSide(scene, reconstruction, is_beyond, true);
    const auto first = std::find_if(
        reconstruction.rig_from_world.begin(),
        reconstruction.rig_from_world.end(),
        [](const std::optional<Rigid3>& pose) { return pose.has_value(); });
    const bool beyond_is_first =
        is_beyond[first - reconstruction.rig_from_world.begin()];
    json.push_back(
        {{"reason", EnumName(seam.reason)},
         {"frames_before", beyond_is_first ? beyond : core},
         {"frames_after", beyond_is_first ? core : beyond},
         {"frame_before", scene
                              .frames[beyond_is_first ? seam.frame_idx_beyond
                                                      : seam.frame_idx_core]
                              .name},
         {"frame_after", scene
                             .frames[beyond_is_first ? seam.frame_idx_core
                                                     : seam.frame_idx_beyond]
                             .name},
         {"weaker_side", beyond_is_first ? "before" : "after"},
         {"num_frames_of_weaker_side", seam.frame_idxs_beyond.size()},
         {"num_pairs", seam.num_pairs},
         {"num_tracks", seam.num_tracks},
         {"num_ties", seam.num_ties},
         {"num_confirmed_matches", seam.num_confirmed},
         {"num_matches_against", seam.num_against},
         {"sigma_position", ToJson(seam.sigma_position)},
         {"sigma_rotation_deg", ToJson(seam.sigma_rotation_deg)}});
  }
  return json;
}

Json ToJson(const TranslationSummary& summary) {
  return {{"initialization", ToJson(summary.initialization)},
          {"camera_refinement", ToJson(summary.camera_refinement)},
          {"joint_refinement", ToJson(summary.joint_refinement)},
          {"num_pairs_used", summary.num_pairs_used},
          {"num_pairs_without_parallax", summary.num_pairs_without_parallax},
          {"num_pairs_inconsistent", summary.num_pairs_inconsistent},
          {"num_pairs_inconsistent_with_positions",
           summary.num_pairs_inconsistent_with_positions},
          {"num_displaced_steps", summary.num_displaced_steps},
          {"num_rotation_corrections", summary.num_rotation_corrections},
          {"num_points", summary.num_points}};
}

Json ToJson(const Scene& scene, const BundleSummary& summary) {
  Json json = {
      {"solves", Json::array()},
      {"rounds", Json::array()},
      {"dropped_frames", Json::array()},
      {"weak_frames", Json::array()},
      {"sensors_without_observations", Json::array()},
      {"num_invisible_observations", summary.num_invisible_observations}};
  for (const SolveSummary& solve : summary.solves) {
    json["solves"].push_back(ToJson(solve));
  }
  for (const BundleRound& round : summary.rounds) {
    json["rounds"].push_back(
        {{"sigma_px", round.sigma_px},
         {"max_error_px", round.max_error_px},
         {"num_points_before", round.num_points_before},
         {"num_points_after", round.num_points_after},
         {"num_observations_before", round.num_observations_before},
         {"num_observations_after", round.num_observations_after}});
  }
  for (const DroppedFrame& frame : summary.dropped_frames) {
    json["dropped_frames"].push_back(
        {{"frame_id", scene.frames[frame.frame_idx].id.value()},
         {"reason", frame.reason}});
  }
  for (const int frame_idx : summary.weak_frame_idxs) {
    json["weak_frames"].push_back(scene.frames[frame_idx].id.value());
  }
  for (const int sensor_idx : summary.sensor_idxs_without_observations) {
    json["sensors_without_observations"].push_back(
        scene.sensors[sensor_idx].name);
  }
  return json;
}

Json ToJson(const Scene& scene, const PositionPriorSummary& summary) {
  Json json = {{"is_registered", summary.is_registered},
               {"message", summary.message},
               {"num_priors", summary.num_priors},
               {"num_used", summary.num_used},
               {"rms", ToJson(summary.rms)},
               {"deformation", nullptr},
               {"outliers", Json::array()}};
  if (summary.deformation) {
    json["deformation"] = {
        {"max_shift", summary.deformation->max_shift},
        {"max_rotation_deg", summary.deformation->max_rotation_deg}};
  }
  for (const PositionPriorSummary::Outlier& outlier : summary.outliers) {
    json["outliers"].push_back({{"image", scene.images[outlier.image_idx].name},
                                {"distance", outlier.distance}});
  }
  return json;
}

Json ToJson(const Scene& scene, const SoftRigSummary& summary) {
  Json json = {{"is_usable", summary.is_usable},
               {"has_converged", summary.has_converged},
               {"message", summary.message},
               {"noise_px", summary.sigma_px},
               {"solves", Json::array()},
               {"sensors", Json::array()}};
  for (const SolveSummary& solve : summary.solves) {
    json["solves"].push_back(ToJson(solve));
  }
  for (const SoftRigSensor& sensor : summary.sensors) {
    json["sensors"].push_back(
        {{"name", scene.sensors[sensor.sensor_idx].name},
         {"num_images", sensor.num_images},
         {"is_rigid", sensor.is_rigid},
         {"sigma_rotation_deg", RadToDeg(sensor.sigma_rotation_rad)},
         {"sigma_position", sensor.sigma_position},
         {"rms_rotation_deg", RadToDeg(sensor.rms_rotation_rad)},
         {"max_rotation_deg", RadToDeg(sensor.max_rotation_rad)},
         {"rms_position", sensor.rms_position},
         {"max_position", sensor.max_position},
         {"mean_error_before_px", sensor.mean_error_before_px},
         {"mean_error_after_px", sensor.mean_error_after_px},
         {"num_observations_before", sensor.num_observations_before},
         {"num_observations_after", sensor.num_observations_after},
         {"time_offset_s", ToJson(sensor.time_offset_s)},
         {"time_offset_sigma_s", ToJson(sensor.time_offset_sigma_s)},
         {"message", sensor.message}});
  }
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

// The synchronism and rigidity of the cameras of rigs.
Json ToJson(const Scene& scene, const RigDelays& delays) {
  Json json = {{"unit", delays.is_in_seconds ? "s" : "frame intervals"},
               {"cameras", Json::array()}};
  for (const CameraDelay& camera : delays.cameras) {
    json["cameras"].push_back(
        {{"camera", scene.sensors[camera.sensor_idx].name},
         {"delay", camera.delay},
         {"sigma", camera.sigma},
         {"is_certain", camera.is_certain},
         {"overdispersion", camera.overdispersion},
         {"overdispersion_of_points", camera.overdispersion_of_points}});
  }
  if (delays.unit) {
    json["unit_of_length"] = {{"log_factor", delays.unit->log_factor},
                              {"sigma", delays.unit->sigma},
                              {"is_certain", delays.unit->is_certain}};
  }
  return json;
}

// The gauge of the covariances, and the directions that are not observable.
Json ToJson(const Scene& scene, const Reconstruction& model,
            const CovarianceResult& covariances) {
  Json json = {{"is_usable", covariances.is_usable},
               {"sigma_px", covariances.sigma_px},
               {"fixed_frame", nullptr},
               {"scale_is_fixed", covariances.scale_is_fixed},
               {"message", DescribeUnobservable(scene, model, covariances)}};
  if (covariances.fixed_frame_idx) {
    json["fixed_frame"] = scene.frames[*covariances.fixed_frame_idx].name;
  }
  return json;
}

Json ToJson(const Scene& scene, const ExtensionSummary& summary) {
  Json json = {{"num_existing_frames", summary.num_existing_frames},
               {"frames_are_fixed", summary.frames_are_fixed},
               {"num_passes", summary.num_passes},
               {"added_frames", Json::array()}};
  for (const ExtensionSummary::AddedFrame& added : summary.added_frames) {
    const ResectedFrame& frame = added.frame;
    json["added_frames"].push_back(
        {{"frame_id", scene.frames[frame.frame_idx].id.value()},
         {"name", scene.frames[frame.frame_idx].name},
         {"pass", added.pass},
         {"num_keypoints", frame.num_keypoints},
         {"num_inliers", frame.num_inliers}});
  }
  return json;
}

// The calibrated rigs of one model, and how each sensor was determined.
Json RigsToJson(const Scene& scene, const RotationSummary& rotation,
                const MapperModel& model) {
  Json rigs = Json::array();
  for (const Rig& rig : scene.rigs) {
    Json sensors = Json::array();
    for (const int sensor_idx : rig.sensor_idxs) {
      const Sensor& sensor = scene.sensors[sensor_idx];
      const SensorRotationSummary& sensor_rotation =
          rotation.sensors[sensor_idx];
      const SensorTranslationSummary& translation =
          model.translation.sensors[sensor_idx];
      const auto& pose = model.reconstruction.sensor_from_rig[sensor_idx];
      sensors.push_back(
          {{"name", sensor.name},
           {"camera_id", scene.cameras[sensor.camera_idx].id.value()},
           {"is_reference", sensor_idx == rig.ref_sensor_idx},
           {"was_known", sensor.sensor_from_rig.has_value()},
           {"sensor_from_rig", pose ? ToJson(*pose) : Json(nullptr)},
           {"rotation",
            {{"is_observable", sensor_rotation.is_observable},
             {"num_samples", sensor_rotation.num_samples},
             {"median_deviation_deg",
              ToJson(sensor_rotation.median_deviation_deg)},
             {"message", sensor_rotation.message}}},
           {"translation",
            {{"is_observable", translation.is_observable},
             {"message", translation.message}}},
           {"sigma", SensorSigmaToJson(model, sensor_idx)}});
    }
    rigs.push_back({{"rig_id", rig.id.value()}, {"sensors", sensors}});
  }
  return rigs;
}

Json ModelToJson(const Scene& scene, const RotationSummary& rotation,
                 const ModelSummary& summary, const MapperModel& model) {
  Json json = {{"num_frames", summary.num_frames},
               {"num_frames_in_component", model.num_frames_in_component},
               {"num_images", summary.num_images},
               {"num_points", summary.num_points},
               {"num_observations", summary.num_observations},
               {"mean_reprojection_error_px",
                ToJson(summary.mean_reprojection_error_px)},
               {"rigs", RigsToJson(scene, rotation, model)}};
  if (summary.kept_share) {
    json["kept_matches"] = ToJson(scene, model.kept_matches);
  }
  if (model.extension) {
    json["extension"] = ToJson(scene, *model.extension);
  } else {
    json["tracks"] = ToJson(model.tracks);
    json["translation_averaging"] = ToJson(model.translation);
    json["rejected_groups"] = ToJson(scene, model.rejected_groups);
    json["seams"] = ToJson(scene, model.reconstruction, model.confidence.seams);
  }
  json["bundle_adjustment"] = ToJson(scene, model.bundle);
  if (model.position_priors) {
    json["position_priors"] = ToJson(scene, *model.position_priors);
  }
  if (model.gravity) json["gravity"] = ToJson(scene, *model.gravity);
  json["lenses"] = Json::array();
  for (const LensValue& lens : summary.lenses) {
    json["lenses"].push_back(ToJson(scene, lens));
  }
  if (model.delays) json["delays"] = ToJson(scene, *model.delays);
  if (model.covariances) {
    json["covariances"] =
        ToJson(scene, model.reconstruction, *model.covariances);
  }
  if (model.soft_rig_images) {
    json["soft_rig"] = ToJson(scene, model.soft_rig_images->summary);
  }
  AddTimes(model.times, &json);
  return json;
}

}  // namespace

std::string MapperReportToJson(const Scene& scene, const ViewGraph& view_graph,
                               const MapperResult& result,
                               const RunDescription& run) {
  const RunSummary summary = SummarizeRun(scene, result);
  Json report = {{"summary", ToJson(summary)},
                 {"warnings", ToJson(result.findings)},
                 {"mgsfm_version", run.version},
                 {"input", InputToJson(scene, view_graph, run)},
                 {"options", Json::parse(run.options_json)},
                 {"random_seed", run.random_seed},
                 {"view_graph", ToJson(result.view_graph)}};
  if (run.input_path.empty()) {
    report["rotation_averaging"] = ToJson(result.rotation);
    report["rejected_pairs"] = ToJson(result.rejected_pairs);
  }
  if (!result.focal_lengths.empty()) {
    report["focal_lengths"] = ToJson(scene, result.focal_lengths);
  }
  if (result.lenses) report["lenses"] = ToJson(scene, *result.lenses);
  report["models"] = Json::array();
  for (size_t i = 0; i < result.models.size(); ++i) {
    report["models"].push_back(ModelToJson(
        scene, result.rotation, summary.models[i], result.models[i]));
  }
  report["unregistered_frames"] = Json::array();
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    report["unregistered_frames"].push_back(
        {{"frame_id", scene.frames[frame.frame_idx].id.value()},
         {"name", scene.frames[frame.frame_idx].name},
         {"reason", frame.reason}});
  }
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
