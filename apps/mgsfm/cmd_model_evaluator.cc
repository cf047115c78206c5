// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <set>
#include <sstream>

#include "command.h"
#include "commands.h"
#include "eval/evaluation_plot.h"
#include "io/files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/eval/evaluation.h"
#include "mgsfm/io/database/database.h"
#include "mgsfm/io/models/scene_loading.h"
#include "mgsfm/io/models/trajectory_io.h"
#include "named_model.h"
#include "true_trajectory.h"

namespace mgsfm {
namespace {

enum class TruthFormat { kColmap, kKitti, kTum, kRig };

}  // namespace

template <>
struct EnumTable<TruthFormat> {
  static constexpr std::pair<std::string_view, TruthFormat> kNames[] = {
      {"colmap", TruthFormat::kColmap},
      {"kitti", TruthFormat::kKitti},
      {"tum", TruthFormat::kTum},
      {"rig", TruthFormat::kRig}};
};

namespace {

struct EvaluatorOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Folder of the model to evaluate."};
  Option<std::string> gt_path{
      "gt_path", "", "True poses: a folder (colmap) or a file (kitti, tum)."};
  Option<TruthFormat> gt_format{
      "gt_format", TruthFormat::kColmap,
      "colmap: a model with the same image names. kitti, tum: poses of the "
      "reference camera, assigned by the number (kitti) or the time in s or ns "
      "(tum) in the image name, else in frame order. rig: only the rig of "
      "--calib_path."};
  Option<std::string> calib_path{
      "calib_path", "",
      "True rig: KITTI's calib.txt, or EuRoC's sensor.yaml of every camera, "
      "separated by commas, in the order of the camera folders."};
  Option<std::string> database_path{
      "database_path", "",
      "Database of the model, for kitti and tum: counts images that are "
      "missing in the model as unregistered. Without it, only images in gaps "
      "between frames of the model count."};
  Option<std::string> image_prefix{
      "image_prefix", "",
      "Evaluates only images whose names start with this, such as seq1/."};
  Option<std::string> reference{
      "reference", "",
      "Folder of the camera whose poses --gt_path holds; by default the "
      "reference sensor of the model's rig, or the first folder."};
  Option<std::string> rig_name_rule{
      "rig_name_rule", "auto",
      "How image names identify cameras and frames if the model has no rigs; "
      "as for the mapper."};
  Option<Alignment> alignment{
      "alignment", Alignment::kSimilarity,
      "Alignment of the model before it is compared: similarity; rigid for "
      "metric models; none for models in the world of the ground truth."};
  Option<std::string> json{"json", "", "Write the errors to a JSON file."};
  Option<std::string> svg_path{
      "svg_path", "", "Write an SVG plot of the trajectory and its errors."};
  Option<std::string> position_thresholds{
      "position_thresholds", "0.05,0.1,0.5,1", AnyValue(), "m",
      "Position thresholds of the areas under the curve, separated by commas."};
  Option<std::string> rotation_thresholds{
      "rotation_thresholds", "0.5,1,5", AnyValue(), "deg",
      "Rotation thresholds of the areas under the curve, separated by commas."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, gt_path, gt_format, calib_path, database_path,
          image_prefix, reference, rig_name_rule, alignment, json, svg_path,
          position_thresholds, rotation_thresholds);
  }
};

std::vector<std::string> SplitList(const std::string& list) {
  std::vector<std::string> items;
  std::istringstream stream(list);
  for (std::string item; std::getline(stream, item, ',');) {
    if (!item.empty()) items.push_back(item);
  }
  return items;
}

std::vector<double> ParseThresholds(const std::string& name,
                                    const std::string& list) {
  std::vector<double> thresholds;
  for (const std::string& item : SplitList(list)) {
    std::istringstream stream(item);
    double value = 0.0;
    if (!(stream >> value) || !stream.eof() || !(value > 0.0)) {
      std::ostringstream message;
      message << "--" << name << ": '" << item << "' is not a positive number";
      throw Error(message.str());
    }
    thresholds.push_back(value);
  }
  return thresholds;
}

// True sensor_from_ref per sensor of the model, as far as it is known.
using TrueSensors = std::vector<std::optional<Rigid3>>;

std::vector<Rigid3> ReadCameras(const std::string& calib_path) {
  const std::vector<std::string> paths = SplitList(calib_path);
  const std::string extension =
      std::filesystem::path(paths.front()).extension().string();
  if (extension != ".yaml" && extension != ".yml") {
    return ReadKittiCalibration(paths.front());
  }
  std::vector<Rigid3> cameras;
  for (const std::string& path : paths) {
    cameras.push_back(ReadEurocCalibration(path));
  }
  return cameras;
}

// The camera of a sensor: image_2 and image_3 are the third and fourth of
// KITTI's matrices, others go by their order.
const Rigid3& CameraOf(const std::string& sensor_name, size_t order,
                       const std::vector<Rigid3>& cameras,
                       const std::string& calib_path) {
  const size_t digits = sensor_name.find_last_not_of("0123456789") + 1;
  const auto number = ParseNumber(sensor_name.substr(digits));
  const size_t k = number && *number < static_cast<double>(cameras.size())
                       ? static_cast<size_t>(*number)
                       : order;
  if (k >= cameras.size()) {
    throw Error("'" + calib_path + "' has no camera for the images of '" +
                sensor_name + "'");
  }
  return cameras[k];
}

TrueSensors ReadTrueSensors(const std::string& calib_path,
                            const NamedModel& model) {
  TrueSensors sensors(model.scene.sensors.size());
  for (const int ref_sensor : model.ref_sensor) sensors[ref_sensor] = Rigid3();
  if (SplitList(calib_path).empty()) return sensors;
  const std::vector<Rigid3> cameras = ReadCameras(calib_path);
  for (size_t rig_idx = 0; rig_idx < model.scene.rigs.size(); ++rig_idx) {
    std::map<std::string, int> by_name;
    for (const int sensor_idx : model.scene.rigs[rig_idx].sensor_idxs) {
      by_name[model.scene.sensors[sensor_idx].name] = sensor_idx;
    }
    size_t order = 0;
    for (const auto& [name, sensor_idx] : by_name) {
      sensors[sensor_idx] = CameraOf(name, order++, cameras, calib_path);
    }
    const Rigid3 any_from_ref = sensors[model.ref_sensor[rig_idx]]->Inverse();
    for (const auto& [name, sensor_idx] : by_name) {
      sensors[sensor_idx] = *sensors[sensor_idx] * any_from_ref;
    }
  }
  return sensors;
}

std::vector<SensorPoses> PairSensors(const NamedModel& model,
                                     const TrueSensors& truth) {
  std::vector<SensorPoses> sensors;
  for (size_t i = 0; i < model.scene.sensors.size(); ++i) {
    const Sensor& sensor = model.scene.sensors[i];
    if (model.ref_sensor[sensor.rig_idx] == static_cast<int>(i)) continue;
    sensors.push_back({sensor.name, model.sensor_from_ref[i], truth[i]});
  }
  return sensors;
}

// The input of Evaluate.
struct Comparison {
  std::vector<ImagePoses> images;
  std::vector<SensorPoses> sensors;
  bool has_true_poses = true;
};

// Per sensor of the model; sensors with common images are the same.
TrueSensors FindTrueSensors(const NamedModel& model, const NamedModel& truth,
                            const std::vector<int>& true_image_of_image) {
  std::vector<std::optional<int>> true_sensor(model.scene.sensors.size());
  for (size_t i = 0; i < true_image_of_image.size(); ++i) {
    if (true_image_of_image[i] < 0) continue;
    true_sensor[model.scene.images[i].sensor_idx] =
        truth.scene.images[true_image_of_image[i]].sensor_idx;
  }
  TrueSensors sensors(model.scene.sensors.size());
  for (size_t i = 0; i < sensors.size(); ++i) {
    const auto sensor = true_sensor[i];
    const auto ref =
        true_sensor[model.ref_sensor[model.scene.sensors[i].rig_idx]];
    if (!sensor || !ref ||
        truth.scene.sensors[*sensor].rig_idx !=
            truth.scene.sensors[*ref].rig_idx ||
        !truth.sensor_from_ref[*sensor] || !truth.sensor_from_ref[*ref]) {
      continue;
    }
    sensors[i] = *truth.sensor_from_ref[*sensor] *
                 truth.sensor_from_ref[*ref]->Inverse();
  }
  return sensors;
}

Comparison CompareWithModel(const EvaluatorOptions& options,
                            const NamedModel& model) {
  SceneLoadingOptions naming;
  naming.rig_name_rule = options.rig_name_rule;
  const NamedModel truth =
      ReadNamedModel(options.gt_path, options.image_prefix, "", naming);
  std::map<std::string, size_t> image_of_name;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    image_of_name[model.scene.images[i].name] = i;
  }
  Comparison comparison;
  std::vector<int> true_image_of_image(model.scene.images.size(), -1);
  for (size_t i = 0; i < truth.scene.images.size(); ++i) {
    const int true_idx = static_cast<int>(i);
    const std::string& name = truth.scene.images[i].name;
    ImagePoses poses{name, truth.IsReference(true_idx), std::nullopt,
                     truth.cam_from_world[i]};
    const auto found = image_of_name.find(name);
    if (found != image_of_name.end()) {
      const size_t image_idx = found->second;
      true_image_of_image[image_idx] = true_idx;
      poses.cam_from_model = model.cam_from_world[image_idx];
      poses.is_reference = model.IsReference(static_cast<int>(image_idx));
    }
    comparison.images.push_back(std::move(poses));
  }
  comparison.sensors =
      PairSensors(model, FindTrueSensors(model, truth, true_image_of_image));
  return comparison;
}

Comparison CompareWithRig(const NamedModel& model,
                          const TrueSensors& true_sensors) {
  Comparison comparison;
  comparison.has_true_poses = false;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    comparison.images.push_back({model.scene.images[i].name,
                                 model.IsReference(static_cast<int>(i)),
                                 model.cam_from_world[i], Rigid3()});
  }
  comparison.sensors = PairSensors(model, true_sensors);
  return comparison;
}

// Images of the database that are not in the model.
ImageNames ReadOtherImages(const EvaluatorOptions& options,
                           const NamedModel& model) {
  if (options.database_path->empty()) return std::nullopt;
  std::set<std::string> in_model;
  for (const Image& image : model.scene.images) in_model.insert(image.name);
  std::vector<std::string> others;
  for (std::string& name : ReadImageNames(options.database_path)) {
    const bool has_prefix = name.compare(0, options.image_prefix->size(),
                                         options.image_prefix) == 0;
    if (has_prefix && in_model.count(name) == 0) {
      others.push_back(std::move(name));
    }
  }
  return others;
}

Comparison CompareWithTrajectory(const EvaluatorOptions& options,
                                 const NamedModel& model,
                                 const TrueSensors& true_sensors) {
  const ImageNames others = ReadOtherImages(options, model);
  const std::vector<std::string> frames = FrameNames(model, others);
  const TrueTrajectory trajectory =
      options.gt_format == TruthFormat::kKitti
          ? AssignByNumber(frames, ReadKittiPoses(*options.gt_path),
                           options.gt_path)
          : AssignByTime(frames, ReadTumPoses(*options.gt_path),
                         options.gt_path);
  return {PairWithTrajectory(model, trajectory, true_sensors, others),
          PairSensors(model, true_sensors), true};
}

Comparison Compare(const EvaluatorOptions& options) {
  SceneLoadingOptions naming;
  naming.rig_name_rule = options.rig_name_rule;
  const NamedModel model = ReadNamedModel(
      options.input_path, options.image_prefix, options.reference, naming);
  if (options.gt_format == TruthFormat::kColmap) {
    return CompareWithModel(options, model);
  }
  const TrueSensors true_sensors = ReadTrueSensors(options.calib_path, model);
  return options.gt_format == TruthFormat::kRig
             ? CompareWithRig(model, true_sensors)
             : CompareWithTrajectory(options, model, true_sensors);
}

void CheckUsage(const EvaluatorOptions& options) {
  const bool is_rig = options.gt_format == TruthFormat::kRig;
  if (is_rig && options.calib_path->empty()) {
    throw Error("--gt_format rig needs --calib_path");
  }
  if (!is_rig && options.gt_path->empty()) {
    throw Error("--gt_path is needed, or --gt_format rig with --calib_path");
  }
  if (is_rig && !options.svg_path->empty()) {
    throw Error(
        "--svg_path needs true poses; choose another --gt_format than rig");
  }
}

int RunModelEvaluator(const EvaluatorOptions& options, const Context&) {
  CheckUsage(options);
  const EvaluationOptions thresholds{
      ParseThresholds("position_thresholds", options.position_thresholds),
      ParseThresholds("rotation_thresholds", options.rotation_thresholds),
      options.alignment};
  const Comparison comparison = Compare(options);
  const Evaluation evaluation =
      Evaluate(comparison.images, comparison.has_true_poses, comparison.sensors,
               thresholds);
  FileOperations files;
  if (!options.json->empty()) {
    ReplaceFile(*options.json, EvaluationToJson(evaluation), &files);
  }
  if (!options.svg_path->empty()) {
    ReplaceFile(*options.svg_path,
                EvaluationToSvg(comparison.images, evaluation), &files);
  }
  std::cout << EvaluationToText(evaluation);
  return kExitSuccess;
}

}  // namespace

Command ModelEvaluatorCommand() {
  return MakeCommand(
      "model_evaluator",
      "Compares a model with ground-truth poses or rig extrinsics.",
      RunModelEvaluator);
}

}  // namespace mgsfm
