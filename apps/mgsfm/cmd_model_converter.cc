// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <utility>
#include <vector>

#include "base/text.h"
#include "command.h"
#include "commands.h"
#include "io/exchange/exchange_formats.h"
#include "io/files/file_operations.h"
#include "io/files/model_files.h"
#include "io/files/staged_output.h"
#include "io/rigs/image_timestamps.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/priors/pose_priors.h"
#include "tool_model.h"
#include "truth_comparison.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ModelConverterOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Folder of the model to convert."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "File to write, or folder for bin, txt and one file per camera. bundler "
      "appends .bundle.out and .list.txt."};
  Option<std::string> output_type{
      "output_type", "bin",
      "bin, txt (COLMAP); ply, nvm, bundler; tum, kitti, euroc (trajectories); "
      "kalibr, ros_tf, ros_launch, camera_info, rig_config (calibration); "
      "geojson, kml (georeferenced trajectories)."};
  Option<TrajectoryPoses> poses{
      "poses", TrajectoryPoses::kFrame,
      "Poses of a trajectory. frame: those of the reference camera of the rig. "
      "camera: those of every camera, in a folder with one file per camera."};
  Option<std::string> image_timestamps_path{
      "image_timestamps_path", "",
      "Times for tum and euroc, a line `image_name SECONDS` per image. Without "
      "it, image names must be times in s or ns."};
  Option<std::string> origin{
      "origin", "",
      "For geojson and kml: latitude,longitude,altitude (degrees, metres) of "
      "the origin of the east-north-up world. By default that of "
      "geo_origin.json in the model."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, output_type, poses, image_timestamps_path,
          origin, rigs);
  }
};

std::optional<ModelFormat> FindModelFormat(std::string name) {
  for (char& c : name) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  for (const auto& [format_name, format] : EnumTable<ModelFormat>::kNames) {
    if (format_name == name) return format;
  }
  return std::nullopt;
}

const ExchangeFormat& FindFormat(const std::string& name) {
  const ExchangeFormat* format = FindExchangeFormat(name);
  if (format != nullptr) return *format;
  std::vector<std::string> names = ExchangeFormatNames();
  std::string list;
  for (const std::string& known : names) list += ", " + known;
  names.insert(names.end(), {"bin", "txt"});
  throw Error("unknown --output_type '" + name + "'" +
              SuggestName(name, names) + "; the types are bin, txt" + list);
}

Eigen::Vector3d ParseOrigin(const std::string& text) {
  std::vector<double> values;
  for (const std::string& item : SplitList(text)) {
    const std::optional<double> value = ParseDouble(item);
    if (value) values.push_back(*value);
  }
  if (values.size() != 3) {
    throw Error("--origin '" + text +
                "' is not latitude,longitude,altitude, such as 47.37,8.54,408");
  }
  Eigen::Vector3d origin(values[0], values[1], values[2]);
  CheckGeoOrigin(origin, "--origin '" + text + "'");
  return origin;
}

// Nothing is written if one of the files cannot be.
void CheckTargets(const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    const std::string name = fs::path(path).filename();
    if (IsModelFileName(name) && name != "rig_config.json") {
      throw Error("'" + path +
                  "' (--output_path) is the name of a file of a model; choose "
                  "another output_path");
    }
    if (fs::is_directory(path)) {
      throw Error("'" + path +
                  "' (--output_path) is a folder; choose a file in it");
    }
  }
}

void WriteFiles(const std::vector<ExportedFile>& files,
                const std::string& output_path, const Context& context) {
  std::vector<std::string> paths;
  for (const ExportedFile& file : files) {
    paths.push_back(output_path + file.suffix);
  }
  CheckTargets(paths);
  context.CheckInterrupted();
  FileOperations operations;
  for (size_t i = 0; i < files.size(); ++i) {
    const bool is_in_folder = files[i].suffix.find('/') != std::string::npos;
    if (is_in_folder) fs::create_directories(output_path);
    ReplaceFile(paths[i], files[i].content, &operations);
    context.Info("written: " + paths[i]);
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
  ToolModel input = ReadToolModel(options.input_path, options.rigs, context);
  if (!options.origin->empty()) {
    input.origin_wgs84 = ParseOrigin(options.origin);
  }
  if (model_format) {
    CheckFormat(input.model.scene, *model_format);
    WriteToolModel(input, *model_format, context, &*output);
    return kExitSuccess;
  }
  if (!options.image_timestamps_path->empty()) {
    ReadImageTimestamps(*options.image_timestamps_path, &input.model.scene,
                        OtherImages::kIgnore);
  }
  WriteFiles(format->write({input.model.scene, input.model.reconstruction,
                            options.poses, input.origin_wgs84}),
             options.output_path, context);
  return kExitSuccess;
}

}  // namespace

Command ModelConverterCommand() {
  return MakeCommand(
      "model_converter",
      "Converts a model to other formats: point clouds, trajectories, "
      "calibrations, maps.",
      RunModelConverter);
}

}  // namespace mgsfm
