// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "evaluation/truth_comparison.h"
#include "exchange/exchange_formats.h"
#include "exchange/import_formats.h"
#include "files/file_operations.h"
#include "files/model_files.h"
#include "files/staged_output.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/priors/pose_priors.h"
#include "model_file.h"
#include "priors/body_calibration.h"
#include "priors/position_files.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ModelConverterOptions {
  Option<std::string> input_path{
      "input_path", "", Required(),
      "Convert the model in this folder, or a file of another program."};
  Option<std::string> input_type{
      "input_type", "auto",
      "State the format of the input: auto (a model in a folder; a file by its "
      "extension), nvm, bundler, nerfstudio (transforms.json), or a trajectory "
      "of the reference camera: tum, kitti, euroc."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write this file, or files into this folder for bin, txt and one file "
      "per camera. bundler appends .bundle.out and .list.txt."};
  Option<std::string> output_type{
      "output_type", "bin",
      "Choose the format of the output: bin, txt (COLMAP); ply, nvm, bundler; "
      "tum, kitti, euroc (trajectories); kalibr, euroc_sensor, ros_tf, "
      "ros_launch, camera_info, rig_config (calibration); kapture; geojson, "
      "kml (georeferenced trajectories)."};
  Option<TrajectoryPoses> poses{
      "poses", TrajectoryPoses::kFrame,
      "Choose the poses of a trajectory. frame: poses of the reference camera "
      "of the rig. camera: poses of every camera, in a folder with one file "
      "per camera."};
  Option<std::string> body_calibration{
      "body_calibration", "",
      "Write a trajectory of the body instead of the reference camera: of the "
      "inertial sensor in this file (T_cam_imu of Kalibr, or a URDF, in "
      "meters, as the model must be)."};
  Option<std::string> image_timestamps_path{
      "image_timestamps_path", "",
      "Read the times for tum and euroc from this file with one line "
      "`image_name SECONDS` per image. Without it, image names must be times "
      "or numbers of seconds."};
  Option<std::string> image_path{"image_path", "",
                                 "Read image sizes from this folder for nvm "
                                 "and bundler input, which lacks them."};
  Option<std::string> list_path{
      "list_path", "",
      "Read the list of images for bundler input. By default, it is beside the "
      "file: a.list.txt for a.bundle.out, list.txt for bundle.out."};
  Option<std::string> database_path{
      "database_path", "",
      "Assign the poses of tum, kitti and euroc input to the cameras and "
      "images of this database. point_triangulator adds the points."};
  Option<std::string> origin{
      "origin", "",
      "Set latitude,longitude,altitude (degrees, meters) of the origin of the "
      "east-north-up world for geojson and kml. By default, it is read from "
      "geo_origin.json in the model."};
  ModelRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, input_type, output_path, output_type, poses,
          body_calibration, image_timestamps_path, image_path, list_path,
          database_path, origin, rigs);
  }
};

std::optional<ModelFormat> FindModelFormat(const std::string& name) {
  for (const auto& [format_name, format] : EnumTable<ModelFormat>::kNames) {
    if (format_name == ToLower(name)) return format;
  }
  return std::nullopt;
}

const ExchangeFormat& FindFormat(const std::string& name) {
  const ExchangeFormat* format = FindExchangeFormat(name);
  if (format != nullptr) return *format;
  std::vector<std::string> names = ExchangeFormatNames();
  const std::string list = Joined(names, ", ");
  names.insert(names.end(), {"bin", "txt"});
  throw Error("unknown --output_type '" + name + "'" +
              SuggestName(name, names) + "; the types are bin, txt, " + list);
}

Eigen::Vector3d ParseOrigin(const std::string& text) {
  const auto values = Transformed(SplitFields(text, ','), ParseDouble);
  if (values.size() != 3 || !values[0] || !values[1] || !values[2]) {
    throw Error("--origin '" + text +
                "' is not latitude,longitude,altitude, such as 47.37,8.54,408");
  }
  Eigen::Vector3d origin(*values[0], *values[1], *values[2]);
  CheckGeoOrigin(origin, "--origin '" + text + "'");
  return origin;
}

// Throws Error if the file cannot be written.
void CheckTarget(const std::string& output_path, const std::string& suffix) {
  const std::string path = output_path + suffix;
  const std::string name = fs::path(path).filename();
  // The folder `sensors` of kapture has a file rigs.txt of its own.
  const bool is_in_own_folder = suffix.rfind("/sensors/", 0) == 0;
  if (IsModelFileName(name) && name != "rig_config.json" && !is_in_own_folder) {
    throw Error("'" + path +
                "' (--output_path) is the name of a file of a model; choose "
                "another output_path");
  }
  if (fs::is_directory(path)) {
    throw Error("'" + path +
                "' (--output_path) is a folder; choose a file in it");
  }
}

// Checks all files before it writes the first.
void WriteFiles(const std::vector<ExportedFile>& files,
                const std::string& output_path, const Context& context) {
  for (const auto& [suffix, content] : files) CheckTarget(output_path, suffix);
  context.CheckInterrupted();
  for (const auto& [suffix, content] : files) {
    const std::string path = output_path + suffix;
    const bool is_in_folder = suffix.find('/') != std::string::npos;
    if (is_in_folder) fs::create_directories(fs::path(path).parent_path());
    ReplaceFile(path, content);
    context.Info("written: " + path);
  }
}

[[noreturn]] void ThrowUnknownInput(const ModelConverterOptions& options) {
  std::vector<std::string> names = ImportFormatNames();
  names.insert(names.end(), {"tum", "kitti", "euroc"});
  const std::string list = Joined(names, ", ");
  if (*options.input_type == "auto") {
    throw Error(
        "'" + *options.input_path +
        "' is not a folder, and its extension does not tell its format; "
        "give --input_type, one of " +
        list);
  }
  throw Error("unknown --input_type '" + *options.input_type + "'" +
              SuggestName(options.input_type, names) +
              "; the types are auto, " + list);
}

std::optional<PositionFileFormat> FindTrajectoryFormat(
    const std::string& name) {
  if (name == "tum") return PositionFileFormat::kTum;
  if (name == "kitti") return PositionFileFormat::kKitti;
  if (name == "euroc") return PositionFileFormat::kEuroc;
  return std::nullopt;
}

// Throws Error if the rotations between verified pairs show that the poses of
// the trajectory are in another convention.
void CheckConvention(const LoadedScene& loaded, const Reconstruction& model,
                     const ModelConverterOptions& options,
                     PositionFileFormat format) {
  PoseConvention convention;
  if (format == PositionFileFormat::kKitti) {
    convention.order = PoseConvention::kMatrix;
  } else if (format == PositionFileFormat::kEuroc) {
    convention.order = PoseConvention::kWxyz;
  }
  const auto pose_of = [&](int image_idx) {
    const Image& image = loaded.scene.images[image_idx];
    return loaded.scene.IsReference(image.sensor_idx)
               ? model.rig_from_world[image.frame_idx]
               : std::nullopt;
  };
  std::vector<RotationEvidence> evidence;
  for (const ImagePair& pair : loaded.view_graph.pairs) {
    const auto first = pose_of(pair.image_idx1);
    const auto second = pose_of(pair.image_idx2);
    if (!pair.relative_pose || !first || !second) continue;
    evidence.push_back({pair.relative_pose->cam2_from_cam1, first->rotation,
                        second->rotation});
  }
  const auto other = FindOtherConvention(evidence, convention, "matches");
  if (other) throw Error("'" + *options.input_path + "': " + *other);
}

// The images of a database with the poses of a trajectory, without points.
ModelFile PlaceOnTrajectory(const ModelConverterOptions& options,
                            PositionFileFormat format, const Context& context) {
  if (options.database_path->empty()) {
    throw Error("--input_type " + *options.input_type +
                " needs --database_path, as a trajectory has neither cameras "
                "nor images");
  }
  SceneLoadingOptions loading;
  loading.rig_config_path = options.rigs.rig_config_path;
  loading.rig_name_rule = options.rigs.rig_name_rule;
  loading.image_timestamps_path = options.image_timestamps_path;
  LoadedScene loaded = LoadScene(options.database_path, loading, context);
  Scene& scene = loaded.scene;
  Reconstruction model;
  model.cameras = scene.cameras;
  model.rig_from_world.resize(scene.frames.size());
  for (const Sensor& sensor : scene.sensors) {
    model.sensor_from_rig.push_back(sensor.sensor_from_rig);
    if (sensor.sensor_from_rig) continue;
    throw Error("the pose of the camera '" + sensor.name +
                "' in its rig is unknown; give it with --rig_config_path");
  }
  const auto poses = ReadTrajectoryPoses(scene, options.input_path, format);
  for (const auto& [frame_idx, rig_from_world] : poses) {
    model.rig_from_world[frame_idx] = rig_from_world;
  }
  CheckConvention(loaded, model, options, format);
  context.Info(Formatted("%zu of %zu frames have a pose", poses.size(),
                         scene.frames.size()));
  return {{std::move(scene), std::move(model)}, {}};
}

// Throws Error if a file is given that this kind of input does not need.
void CheckIsUnused(const Option<std::string>& path, const std::string& reads) {
  if (path->empty()) return;
  throw Error("--" + std::string(path.Info().name) + " '" + *path +
              "' would not be read: it is for " + reads +
              "; omit it, or correct the type of input or output");
}

ModelFile ReadInput(const ModelConverterOptions& options,
                    const Context& context) {
  const auto trajectory = FindTrajectoryFormat(options.input_type);
  const bool is_auto = *options.input_type == "auto";
  const bool is_model =
      !trajectory && is_auto && fs::is_directory(*options.input_path);
  if (trajectory || is_model) {
    CheckIsUnused(options.image_path, "nvm, bundler and nerfstudio input");
    CheckIsUnused(options.list_path, "bundler input");
  }
  if (trajectory) return PlaceOnTrajectory(options, *trajectory, context);
  CheckIsUnused(options.database_path, "tum, kitti and euroc input");
  if (is_model) return ReadModelFile(options.input_path, options.rigs, context);
  const ImportFormat* format = is_auto ? GuessImportFormat(*options.input_path)
                                       : FindImportFormat(*options.input_type);
  if (is_auto && !fs::exists(*options.input_path)) {
    throw Error("'" + *options.input_path +
                "' (--input_path) does not exist; give the folder of a model "
                "or a file");
  }
  if (format == nullptr) ThrowUnknownInput(options);
  if (format->name != "bundler") {
    CheckIsUnused(options.list_path, "bundler input");
  }
  const Model model = format->read(
      {*options.input_path, *options.image_path, *options.list_path}, context);
  ModelFile result =
      MakeModelFile(model, options.input_path, options.rigs, context);
  context.Info("read: " + DescribeSize(result.model));
  return result;
}

// Replaces the poses of frames by those of the body that carries the cameras.
void MoveToBody(const ModelConverterOptions& options, const Context& context,
                SceneModel* model) {
  const std::string& path = options.body_calibration;
  if (path.empty()) return;
  const std::vector<std::string> types = {"tum", "kitti", "euroc", "geojson",
                                          "kml"};
  const bool is_trajectory = Contains(types, ToLower(options.output_type));
  if (!is_trajectory || options.poses != TrajectoryPoses::kFrame) {
    CheckIsUnused(options.body_calibration,
                  "tum, kitti, euroc, geojson and kml output with poses frame");
  }
  const Scene& scene = model->scene;
  const BodyFrame body = ReadBodyOfModel(scene, path);
  if (!body.warning.empty()) context.Warning(body.warning);
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    auto& rig_from_world = model->reconstruction.rig_from_world[f];
    if (!rig_from_world) continue;
    const int ref = scene.rigs[scene.frames[f].rig_idx].ref_sensor_idx;
    if (!body.cam_from_body[ref]) {
      throw Error("'" + path + "' has no pose of the reference camera '" +
                  scene.sensors[ref].name + "'; add its T_cam_imu");
    }
    rig_from_world = body.cam_from_body[ref]->Inverse() * *rig_from_world;
  }
}

int RunModelConverter(const ModelConverterOptions& options,
                      const Context& context) {
  const std::optional<ModelFormat> model_format =
      FindModelFormat(options.output_type);
  const ExchangeFormat* format =
      model_format ? nullptr : &FindFormat(options.output_type);
  std::optional<StagedOutput> output;
  if (model_format) output.emplace(*options.output_path, OutputKind::kModel);
  ModelFile input = ReadInput(options, context);
  if (!options.origin->empty()) {
    input.origin_wgs84 = ParseOrigin(options.origin);
  }
  if (model_format) {
    CheckFormat(input.model.scene, *model_format);
    WriteModelFile(input, *model_format, context, &*output);
    return kExitSuccess;
  }
  if (!options.image_timestamps_path->empty()) {
    ReadImageTimestamps(*options.image_timestamps_path, &input.model.scene,
                        UnknownImages::kIgnore);
  }
  MoveToBody(options, context, &input.model);
  const ExportInput exported{input.model.scene, input.model.reconstruction,
                             options.poses, input.origin_wgs84};
  WriteFiles(format->write(exported), options.output_path, context);
  GroupedWarnings warnings;
  if (format->losses != nullptr) {
    for (const std::string& loss : format->losses(exported)) warnings.Add(loss);
  }
  warnings.Log(context);
  return kExitSuccess;
}

}  // namespace

Command ModelConverterCommand() {
  return MakeCommand(
      "model_converter",
      "Converts models from and to other formats: point clouds, trajectories, "
      "calibrations, maps.",
      RunModelConverter);
}

}  // namespace mgsfm
