// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/scene_loading.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "calibration/calibration_rigs.h"
#include "database/database_reader.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"
#include "mgsfm/rigs/rig_config.h"
#include "models/rows_to_scene.h"
#include "rigs/image_times.h"
#include "rigs/rig_inference.h"
#include "scene/intrinsics_check.h"
#include "scene/item_lists.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// Detectors can place keypoints this far beyond the image border.
constexpr float kBorderNoise_px = 1.0f;

std::string DescribeIntrinsics(CameraModelId model,
                               const std::vector<double>& params) {
  std::string text(InfoOf(model).name);
  for (const double param : params) {
    text += ' ' + FormatDouble(param, std::chars_format::general, 6);
  }
  return text;
}

bool AreEqualUpToRounding(const std::vector<double>& a,
                          const std::vector<double>& b) {
  constexpr double kRounding = 1e-5;  // of six digits
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double x, double y) {
                      return std::abs(x - y) <= kRounding * (1.0 + std::abs(y));
                    });
}

// Describes the difference between the calibration of a camera in
// rig_config.json and in the model beside it; empty without a difference.
std::string WhyOfAnotherModel(const RigConfigCamera& camera,
                              const Model& model) {
  const auto image = std::find_if(
      model.poses.images.begin(), model.poses.images.end(),
      [&](const ModelImage& i) { return FrameKeyOf(camera, i.name); });
  if (image == model.poses.images.end()) return "";
  for (const Camera& other : model.cameras) {
    if (other.id != image->camera_id || !camera.camera_model) continue;
    if (other.model == *camera.camera_model &&
        AreEqualUpToRounding(camera.camera_params, other.params)) {
      continue;
    }
    return "intrinsics " +
           DescribeIntrinsics(*camera.camera_model, camera.camera_params) +
           ", not " + DescribeIntrinsics(other.model, other.params);
  }
  for (const RigRow& rig : model.poses.rigs) {
    for (const RigSensorRow& sensor : rig.sensors) {
      if (sensor.camera_id != image->camera_id ||
          sensor.camera_id == rig.ref_camera_id || !sensor.sensor_from_rig ||
          !camera.cam_from_rig) {
        continue;
      }
      const auto difference =
          WhyDifferent(*camera.cam_from_rig, *sensor.sensor_from_rig);
      if (difference) return "a pose in the rig that differs " + *difference;
    }
  }
  return "";
}

// Reads the rigs from a file or a folder: from its rig_config.json or else from
// its sparse model, which any program may have written. Throws Error if both
// exist and contradict each other.
std::vector<RigConfig> ReadRigConfigOrModel(const std::string& path,
                                            const Context& context) {
  namespace fs = std::filesystem;
  if (!fs::is_directory(path)) return ReadRigConfig(path);
  const fs::path folder(path), config = folder / "rig_config.json";
  if (!fs::exists(config)) {
    const ModelScene model = LoadModelScene(path, {}, context);
    return MakeRigConfigs(model.scene, model.reconstruction);
  }
  std::vector<RigConfig> rigs = ReadRigConfig(config.string());
  if (!fs::exists(folder / "images.bin") && !fs::exists(folder / "images.txt"))
    return rigs;
  const Model model = ReadModel(folder);
  for (const RigConfig& rig : rigs) {
    for (const RigConfigCamera& camera : rig.cameras) {
      const std::string difference = WhyOfAnotherModel(camera, model);
      if (difference.empty()) continue;
      throw Error("'" + config.string() +
                  "' contradicts the model beside it: " + "'" +
                  camera.NameRule() + "' has " + difference +
                  "; remove it if another program changed the model, or give "
                  "the file in place of its folder");
    }
  }
  return rigs;
}

RigInput MakeRigInput(const std::string& kind, DatabaseContents contents) {
  RigInput input;
  input.kind = kind;
  SortBy(&contents.images, &ImageRow::name);
  const auto camera_of_id = IndexById(contents.cameras);
  for (const ImageRow& image : contents.images) {
    const auto camera = camera_of_id.find(image.camera_id);
    MGSFM_CHECK_MSG(camera != camera_of_id.end(), image.name);
    input.camera_of_image.push_back(camera->second);
  }
  input.contents = std::move(contents);
  return input;
}

RigAssignment AssignAllSingle(const RigInput& input) {
  RigAssignment assignment;
  std::vector<int> images = Indices(input.contents.images.size());
  assignment.sensor_of_image.resize(images.size());
  assignment.frame_of_image.resize(images.size());
  AssignSingleImages(input, images, &assignment);
  assignment.source = "none (single images)";
  return assignment;
}

// A file may name images of the database that are not selected.
UnknownImages OtherImages(bool is_selection) {
  return is_selection ? UnknownImages::kIgnore : UnknownImages::kReject;
}

// The times of images, from a file or from their names.
std::vector<int64_t> ReadTimes(const RigInput& input, const std::string& path) {
  std::vector<int64_t> times_ns;
  if (path.empty()) {
    for (const ImageRow& image : input.contents.images) {
      const std::optional<int64_t> time_ns = TimeInName(image.name);
      if (!time_ns) {
        throw Error(input.Name() + ": the name of image '" + image.name +
                    "' has no time; list the times of all images in a file "
                    "and set image_timestamps_path, or let rig_configurator "
                    "take them from EXIF tags");
      }
      times_ns.push_back(*time_ns);
    }
    return times_ns;
  }
  const std::vector<std::string> names =
      Transformed(input.contents.images, &ImageRow::name);
  for (const double time_s :
       ReadImageTimes(path, names, OtherImages(input.contents.is_selection))) {
    times_ns.push_back(std::llround(time_s * kNsPerSecond));
  }
  return times_ns;
}

std::optional<TimedImages> ReadFrameTimes(const RigInput& input,
                                          const SceneLoadingOptions& options) {
  if (!options.PairsFramesByTime()) return std::nullopt;
  return TimedImages{
      ReadTimes(input, options.image_timestamps_path),
      std::llround(options.frame_max_time_difference_s * kNsPerSecond)};
}

RigAssignment AssignWithoutCalibration(const RigInput& input,
                                       const SceneLoadingOptions& options,
                                       const TimedImages* times,
                                       const Context& context) {
  if (*options.rig_name_rule == "none") return AssignAllSingle(input);
  if (*options.rig_name_rule != "auto") {
    return AssignByRule(input, options.rig_name_rule, times, context);
  }
  if (times == nullptr) {
    if (auto assignment = AssignByTables(input)) return *std::move(assignment);
  }
  return AssignByFolders(input, times, context);
}

// The images that none of these rigs has.
std::vector<int> ImagesOfOtherRigs(const RigInput& input,
                                   const std::vector<RigConfig>& rigs) {
  std::vector<int> others;
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const bool is_known = AnyOf(rigs, [&](const RigConfig& rig) {
      return AnyOf(rig.cameras, [&](const RigConfigCamera& camera) {
        return FrameKeyOf(camera, input.contents.images[i].name).has_value();
      });
    });
    if (!is_known) others.push_back(static_cast<int>(i));
  }
  return others;
}

// Assigns the images of a list that no calibrated rig has, such as those of a
// vehicle that the calibrated part lacks, as without the calibration.
void AssignOtherRigs(const RigInput& input, const std::vector<int>& others,
                     const SceneLoadingOptions& options,
                     const TimedImages* times, const Context& context,
                     RigAssignment* assignment) {
  DatabaseContents contents;
  contents.path = input.contents.path;
  contents.cameras = input.contents.cameras;
  contents.rigs = input.contents.rigs;
  contents.frames = input.contents.frames;
  std::set<std::string> names;
  TimedImages times_of_others;
  for (const int i : others) {
    contents.images.push_back(input.contents.images[i]);
    names.insert(contents.images.back().name);
    if (times) times_of_others.times_ns.push_back(times->times_ns[i]);
  }
  if (times) times_of_others.max_difference_ns = times->max_difference_ns;
  KeepListedImages(names, "", &contents);
  const RigAssignment added = AssignWithoutCalibration(
      MakeRigInput(input.kind, std::move(contents)), options,
      times ? &times_of_others : nullptr, context);
  const auto num_rigs = static_cast<int>(assignment->rig_ids.size());
  const auto num_sensors = static_cast<int>(assignment->sensors.size());
  const auto num_frames = static_cast<int>(assignment->frames.size());
  assignment->rig_ids.insert(assignment->rig_ids.end(), added.rig_ids.begin(),
                             added.rig_ids.end());
  for (RigAssignment::Sensor sensor : added.sensors) {
    sensor.rig += num_rigs;
    assignment->sensors.push_back(std::move(sensor));
  }
  for (RigAssignment::Frame frame : added.frames) {
    frame.rig += num_rigs;
    assignment->frames.push_back(std::move(frame));
  }
  for (size_t k = 0; k < others.size(); ++k) {
    assignment->sensor_of_image[others[k]] =
        num_sensors + added.sensor_of_image[k];
    assignment->frame_of_image[others[k]] =
        num_frames + added.frame_of_image[k];
  }
  assignment->source += "; of " + std::to_string(others.size()) +
                        " listed images that it lacks: " + added.source;
}

RigAssignment AssignRigs(const RigInput& input,
                         const SceneLoadingOptions& options,
                         const TimedImages* times, const Context& context) {
  if (!options.rig_config_path->empty() && !options.calibration_path->empty()) {
    throw Error(
        "both rig_config_path and calibration_path are set; set one of them");
  }
  if (!options.HasKnownRig()) {
    return AssignWithoutCalibration(input, options, times, context);
  }
  const bool is_config = !options.rig_config_path->empty();
  const std::string& path =
      is_config ? options.rig_config_path : options.calibration_path;
  if (!is_config && times == nullptr) {
    if (auto assignment = AssignByInstances(input, path, context)) {
      return *std::move(assignment);
    }
  }
  const std::vector<RigConfig> rigs =
      is_config ? ReadRigConfigOrModel(path, context)
                : ReadCalibrationRigs(input, path, context);
  RigAssignment assignment = AssignByConfig(input, rigs, path, times, context);
  if (!is_config) assignment.source = "calibration '" + path + "'";
  if (!input.contents.is_selection) return assignment;
  const std::vector<int> others = ImagesOfOtherRigs(input, rigs);
  if (!others.empty()) {
    AssignOtherRigs(input, others, options, times, context, &assignment);
  }
  return assignment;
}

// Throws Error for impossible intrinsics.
void CheckIntrinsics(const Scene& scene, const std::string& input_name,
                     const Context& context) {
  size_t num_more = 0;
  std::string warning;
  Mask is_checked(scene.cameras.size(), false);
  for (const Image& image : scene.images) {
    if (is_checked[image.camera_idx]) continue;
    is_checked[image.camera_idx] = true;
    const auto problem = FindIntrinsicsProblem(scene.cameras[image.camera_idx]);
    if (!problem) continue;
    const std::string text = input_name + ": the camera of image '" +
                             image.name + "' " + problem->text;
    if (problem->is_certain) {
      throw Error(text + "; correct its intrinsics");
    }
    if (warning.empty()) {
      warning = text;
    } else {
      ++num_more;
    }
  }
  if (warning.empty()) return;
  context.Warning(warning + "; check the intrinsics" +
                  (num_more > 0 ? " of this and of " +
                                      std::to_string(num_more) + " more cameras"
                                : ""));
}

// Whether more keypoints are outside the camera's image than noise explains.
bool HasKeypointsOutside(const Image& image, const Camera& camera) {
  constexpr double kMaxShare = 0.05;
  const float max_x = static_cast<float>(camera.width_px) + kBorderNoise_px;
  const float max_y = static_cast<float>(camera.height_px) + kBorderNoise_px;
  const auto num_outside =
      CountIf(image.keypoints_px, [&](const Eigen::Vector2f& pixel) {
        return pixel.minCoeff() < -kBorderNoise_px || pixel.x() > max_x ||
               pixel.y() > max_y;
      });
  return static_cast<double>(num_outside) >
         kMaxShare * static_cast<double>(image.keypoints_px.size());
}

// Warns of features that belong to images of another size than the camera.
void CheckKeypoints(const Scene& scene, const std::string& input_name,
                    const Context& context) {
  size_t num_images = 0;
  const Image* example = nullptr;
  for (const Image& image : scene.images) {
    if (!HasKeypointsOutside(image, scene.cameras[image.camera_idx])) continue;
    ++num_images;
    if (example == nullptr) example = &image;
  }
  if (example == nullptr) return;
  const Camera& camera = scene.cameras[example->camera_idx];
  context.Warning(input_name + ": " + std::to_string(num_images) +
                  " images have keypoints outside of the size of their "
                  "camera, such as '" +
                  example->name + "' of " +
                  SizeText(camera.width_px, camera.height_px) +
                  " px; correct the size of the camera");
}

ImagePair MakePair(TwoViewGeometryRow* row, int image_idx1, int image_idx2) {
  ImagePair pair;
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  pair.config = row->config;
  pair.F = row->F;
  pair.E = row->E;
  pair.H = row->H;
  if (row->cam2_from_cam1) {
    pair.relative_pose = RelativePose{row->cam2_from_cam1->rotation, {}};
    const double length = row->cam2_from_cam1->translation.norm();
    if (length > 0.0) {
      pair.relative_pose->translation_direction =
          row->cam2_from_cam1->translation / length;
    }
  }
  pair.matches = std::move(row->matches);
  pair.outliers = std::move(row->outliers);
  return pair;
}

void SwapImages(MatchesRow* pair) {
  std::swap(pair->image_id1, pair->image_id2);
  SwapImages(&pair->matches);
}

// The rows with matches in canonical order.
template <class Row>
std::vector<std::tuple<int, int, Row*>> OrderPairs(const Scene& scene,
                                                   std::vector<Row>* rows) {
  const auto image_idx_of_id = IndexById(scene.images);
  const auto idx_of = [&](ImageId id) {
    const auto found = image_idx_of_id.find(id);
    MGSFM_CHECK_MSG(found != image_idx_of_id.end(), std::to_string(id.value()));
    return found->second;
  };
  std::vector<std::tuple<int, int, Row*>> order;
  for (Row& row : *rows) {
    if (row.matches.empty()) continue;
    if (idx_of(row.image_id1) > idx_of(row.image_id2)) SwapImages(&row);
    order.emplace_back(idx_of(row.image_id1), idx_of(row.image_id2), &row);
  }
  std::sort(order.begin(), order.end());
  return order;
}

ViewGraph BuildViewGraph(std::vector<TwoViewGeometryRow> rows,
                         const Scene& scene) {
  const auto order = OrderPairs(scene, &rows);
  ViewGraph view_graph;
  view_graph.pairs.reserve(order.size());
  for (const auto& [image_idx1, image_idx2, row] : order) {
    view_graph.pairs.push_back(MakePair(row, image_idx1, image_idx2));
  }
  return view_graph;
}

void LogScene(const Scene& scene, const std::string& rig_source,
              size_t num_pairs, const Context& context) {
  context.Info("rigs from " + rig_source + ": " +
               std::to_string(scene.rigs.size()) + " rigs, " +
               std::to_string(scene.frames.size()) + " frames, " +
               std::to_string(scene.images.size()) + " images, " +
               std::to_string(num_pairs) + " pairs");
  std::vector<int> num_images(scene.sensors.size(), 0);
  for (const Image& image : scene.images) ++num_images[image.sensor_idx];
  for (size_t rig_idx = 0; rig_idx < scene.rigs.size(); ++rig_idx) {
    std::string line = "rig " + std::to_string(rig_idx + 1) + ":";
    for (const int sensor_idx : scene.rigs[rig_idx].sensor_idxs) {
      line += " '" + scene.sensors[sensor_idx].name + "' (" +
              std::to_string(num_images[sensor_idx]) + " images" +
              (scene.IsReference(sensor_idx) ? ", reference)" : ")");
    }
    context.Debug(line);
  }
  if (num_pairs == 0) {
    context.Warning(
        "the database has no verified matches; run a matcher with geometric "
        "verification first");
  }
}

// Writes cameras that are new or have changed intrinsics. Ids become those of
// the database.
void WriteCameras(const std::vector<Camera>& before, FeatureDatabase* database,
                  DatabaseContents* after) {
  const auto camera_before = IndexById(before);
  std::map<CameraId, CameraId> new_id;
  for (const Camera& camera : after->cameras) {
    const auto known = camera_before.find(camera.id);
    if (known == camera_before.end()) {
      new_id.emplace(camera.id, database->AddCamera(camera));
      continue;
    }
    new_id.emplace(camera.id, camera.id);
    if (!HaveEqualIntrinsics(before[known->second], camera)) {
      database->UpdateCamera(camera);
    }
  }
  for (RigRow& rig : after->rigs) {
    if (rig.ref_camera_id) rig.ref_camera_id = new_id.at(*rig.ref_camera_id);
    for (RigSensorRow& sensor : rig.sensors) {
      sensor.camera_id = new_id.at(sensor.camera_id);
    }
  }
  for (FrameRow& frame : after->frames) {
    for (FrameDataRow& data : frame.data) {
      data.camera_id = new_id.at(data.camera_id);
    }
  }
}

void SetCamerasOfImages(const std::vector<ImageRow>& before,
                        const std::vector<FrameRow>& frames,
                        FeatureDatabase* database) {
  const auto image_before = IndexById(before);
  for (const FrameRow& frame : frames) {
    for (const FrameDataRow& data : frame.data) {
      if (before[image_before.at(data.image_id)].camera_id != data.camera_id) {
        database->SetImageCamera(data.image_id, data.camera_id);
      }
    }
  }
}

}  // namespace

SceneOfRows BuildSceneOfRows(const std::string& kind, DatabaseContents contents,
                             const SceneLoadingOptions& options,
                             const Context& context) {
  RigInput input = MakeRigInput(kind, std::move(contents));
  const std::optional<TimedImages> times = ReadFrameTimes(input, options);
  RigAssignment assignment =
      AssignRigs(input, options, times ? &*times : nullptr, context);
  const std::string input_name = input.Name();
  const bool is_selection = input.contents.is_selection;
  SceneOfRows result;
  result.rig_source = assignment.source;
  result.scene = BuildScene(std::move(input), std::move(assignment), context);
  CheckIntrinsics(result.scene, input_name, context);
  CheckKeypoints(result.scene, input_name, context);
  if (kind != "model" || options.HasKnownRig()) {
    const auto problem = WhyRigsAreNotMetric(result.scene);
    // Calibrations are in meters; a rig configuration may have any unit.
    if (problem && !options.calibration_path->empty()) {
      throw Error("'" + *options.calibration_path + "': " + *problem);
    }
    if (problem) context.Warning("by " + result.rig_source + ", " + *problem);
  }
  if (times) {
    for (size_t i = 0; i < times->times_ns.size(); ++i) {
      result.scene.images[i].timestamp_s = Seconds(times->times_ns[i]);
    }
  } else if (!options.image_timestamps_path->empty()) {
    const std::string& path = *options.image_timestamps_path;
    ReadImageTimestamps(path, &result.scene, OtherImages(is_selection));
    const auto problem = WhyTimesAreNotSeconds(path, result.scene);
    if (problem) context.Warning(*problem);
  }
  SortFrames(&result.scene);
  return result;
}

LoadedScene LoadScene(DatabaseContents contents,
                      const SceneLoadingOptions& options,
                      const Context& context) {
  std::vector<TwoViewGeometryRow> pairs = std::move(contents.pairs);
  SceneOfRows rows =
      BuildSceneOfRows("database", std::move(contents), options, context);
  LoadedScene loaded;
  loaded.scene = std::move(rows.scene);
  loaded.rig_source = std::move(rows.rig_source);
  loaded.view_graph = BuildViewGraph(std::move(pairs), loaded.scene);
  LogScene(loaded.scene, loaded.rig_source, loaded.view_graph.pairs.size(),
           context);
  return loaded;
}

LoadedMatches LoadMatches(DatabaseContents contents,
                          const SceneLoadingOptions& options,
                          const Context& context) {
  std::vector<MatchesRow> matches = std::move(contents.matches);
  SceneOfRows rows =
      BuildSceneOfRows("database", std::move(contents), options, context);
  LoadedMatches loaded;
  loaded.scene = std::move(rows.scene);
  const auto order = OrderPairs(loaded.scene, &matches);
  loaded.pairs.reserve(order.size());
  for (const auto& [image_idx1, image_idx2, row] : order) {
    loaded.pairs.push_back({image_idx1, image_idx2, std::move(row->matches)});
  }
  LogScene(loaded.scene, rows.rig_source, loaded.pairs.size(), context);
  return loaded;
}

LoadedScene LoadScene(const std::string& database_path,
                      const SceneLoadingOptions& options,
                      const Context& context) {
  return LoadScene(ReadDatabase(database_path, context), options, context);
}

RigConfigurationSummary ConfigureRigs(const SceneLoadingOptions& options,
                                      FeatureDatabase* database,
                                      const Context& context) {
  DatabaseContents before = database->ReadStructure(context);
  before.rigs.clear();
  before.frames.clear();
  if (before.images.empty()) {
    throw Error("database '" + database->path() +
                "' has no images; run feature_extractor first");
  }
  const SceneOfRows found =
      BuildSceneOfRows("database", before, options, context);
  DatabaseContents after = MakeDatabaseContents(found.scene, ViewGraph());
  DatabaseTransaction transaction(database);
  WriteCameras(before.cameras, database, &after);
  SetCamerasOfImages(before.images, after.frames, database);
  database->WriteRigsAndFrames(after.rigs, after.frames);
  transaction.Commit();
  return {found.scene.rigs.size(), found.scene.sensors.size(),
          found.scene.frames.size(), found.scene.images.size(),
          found.rig_source};
}

}  // namespace mgsfm
