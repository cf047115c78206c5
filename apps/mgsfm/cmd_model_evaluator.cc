// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>

#include "command.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "mgsfm/eval/evaluation.h"
#include "mgsfm/io/model_io.h"
#include "mgsfm/io/trajectory_io.h"

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
  std::string input_path;
  std::string gt_path;
  TruthFormat gt_format = TruthFormat::kColmap;
  std::string calib_path;
  std::string reference;
  std::string json;
  std::string position_thresholds = "0.05,0.1,0.5,1";
  std::string rotation_thresholds = "0.5,1,5";

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("input_path", self.input_path, Required(), "",
          "Folder of the model to evaluate.");
    visit("gt_path", self.gt_path, AnyValue(), "",
          "True poses: a folder (colmap) or a file (kitti, tum).");
    visit("gt_format", self.gt_format, AnyValue(), "",
          "colmap: images of equal names. kitti, tum: poses of the reference "
          "camera; kitti by the number in the image name or in frame order, "
          "tum by the time in the name (s or ns) or in frame order. rig: "
          "only the rig of --calib_path.");
    visit("calib_path", self.calib_path, AnyValue(), "",
          "True rig: KITTI's calib.txt, or EuRoC's sensor yaml of every "
          "camera, separated by commas; in the order of the camera folders.");
    visit("reference", self.reference, AnyValue(), "",
          "Folder of the camera that --gt_path is of; by default the model's "
          "reference, or the first folder.");
    visit("json", self.json, AnyValue(), "", "Also write a JSON file.");
    visit("position_thresholds", self.position_thresholds, AnyValue(), "m",
          "Of the areas under the curve, separated by commas.");
    visit("rotation_thresholds", self.rotation_thresholds, AnyValue(), "deg",
          "Likewise.");
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
      message << "--" << name << ": '" << item << "' is no positive number";
      throw Error(message.str());
    }
    thresholds.push_back(value);
  }
  return thresholds;
}

std::string FolderOf(const std::string& image_name) {
  const size_t slash = image_name.rfind('/');
  return slash == std::string::npos ? "" : image_name.substr(0, slash);
}

std::string FrameOf(const std::string& image_name) {
  const std::string file = image_name.substr(image_name.rfind('/') + 1);
  return file.substr(0, file.rfind('.'));
}

// The number that a name consists of.
std::optional<double> NumberOf(const std::string& name) {
  if (name.empty() ||
      name.find_first_not_of("0123456789.") != std::string::npos) {
    return std::nullopt;
  }
  std::istringstream stream(name);
  double number = 0.0;
  if (!(stream >> number) || !stream.eof()) return std::nullopt;
  return number;
}

// A model by folders (cameras) and file names (frames), the reference first.
struct NamedModel {
  PoseModel poses;
  std::vector<std::string> folders;  // sorted, but for the reference
  std::vector<std::string> frames;   // sorted
  std::map<std::string, std::optional<Rigid3>> sensor_from_ref;
};

NamedModel NameModel(PoseModel poses, const std::string& reference) {
  NamedModel model;
  std::map<CameraId, std::string> folder_of_camera;
  std::map<std::string, int> folders, frames;
  for (const ModelImage& image : poses.images) {
    folder_of_camera.emplace(image.camera_id, FolderOf(image.name));
    ++folders[FolderOf(image.name)];
    ++frames[FrameOf(image.name)];
  }
  for (const auto& folder : folders) model.folders.push_back(folder.first);
  for (const auto& frame : frames) model.frames.push_back(frame.first);
  std::string first = reference;
  for (const ModelRig& rig : poses.rigs) {
    for (const ModelSensor& sensor : rig.sensors) {
      const auto it = folder_of_camera.find(sensor.camera_id);
      if (it == folder_of_camera.end()) continue;
      if (sensor.is_reference && first.empty()) first = it->second;
      model.sensor_from_ref[it->second] = sensor.sensor_from_rig;
    }
  }
  if (first.empty() && !model.folders.empty()) first = model.folders.front();
  const auto it = std::find(model.folders.begin(), model.folders.end(), first);
  if (it == model.folders.end()) {
    throw Error("no image of the model is in the reference folder '" + first +
                "'");
  }
  std::rotate(model.folders.begin(), it, it + 1);
  const std::optional<Rigid3> ref_from_rig = model.sensor_from_ref[first];
  for (auto& [folder, pose] : model.sensor_from_ref) {
    if (pose && ref_from_rig) pose = *pose * ref_from_rig->Inverse();
  }
  model.poses = std::move(poses);
  return model;
}

// True sensor_from_ref of each folder that the calibration has.
std::map<std::string, Rigid3> ReadCalibration(const std::string& calib_path,
                                              const NamedModel& model) {
  std::vector<std::string> sorted = model.folders;
  std::sort(sorted.begin(), sorted.end());
  const std::vector<std::string> paths = SplitList(calib_path);
  std::vector<Rigid3> cameras;
  std::map<std::string, Rigid3> sensors;
  if (paths.empty()) return sensors;
  const std::string extension =
      std::filesystem::path(paths.front()).extension().string();
  if (extension == ".yaml" || extension == ".yml") {
    for (const std::string& path : paths) {
      cameras.push_back(ReadEurocCalibration(path));
    }
  } else {
    cameras = ReadKittiCalibration(paths.front());
  }
  for (size_t i = 0; i < sorted.size(); ++i) {
    // image_2 and image_3 are the third and fourth of KITTI's matrices.
    const size_t digits = sorted[i].find_last_not_of("0123456789") + 1;
    const auto number = NumberOf(sorted[i].substr(digits));
    const size_t k = number && *number < static_cast<double>(cameras.size())
                         ? static_cast<size_t>(*number)
                         : i;
    if (k >= cameras.size()) {
      throw Error("'" + calib_path + "' has no camera for the folder '" +
                  sorted[i] + "'");
    }
    sensors[sorted[i]] = cameras[k];
  }
  const Rigid3 ref_from_any = sensors.at(model.folders.front());
  for (auto& sensor : sensors) {
    sensor.second = sensor.second * ref_from_any.Inverse();
  }
  return sensors;
}

std::vector<SensorPoses> PairSensors(
    const NamedModel& model, const std::map<std::string, Rigid3>& truth) {
  std::vector<SensorPoses> sensors;
  for (size_t i = 1; i < model.folders.size(); ++i) {
    const std::string& folder = model.folders[i];
    SensorPoses sensor;
    sensor.name = folder;
    const auto estimate = model.sensor_from_ref.find(folder);
    if (estimate != model.sensor_from_ref.end()) {
      sensor.sensor_from_ref = estimate->second;
    }
    const auto it = truth.find(folder);
    if (it != truth.end()) sensor.true_sensor_from_ref = it->second;
    sensors.push_back(sensor);
  }
  return sensors;
}

// Which pose belongs to each frame; the frames are numbers below the number of
// poses, or as many as there are poses.
std::map<std::string, Rigid3> AssignByNumber(
    const std::vector<std::string>& frames, const std::vector<Rigid3>& poses,
    const std::string& path) {
  bool are_line_numbers = true;
  for (const std::string& frame : frames) {
    const auto number = NumberOf(frame);
    are_line_numbers &= number && *number < static_cast<double>(poses.size()) &&
                        *number == std::floor(*number);
  }
  if (!are_line_numbers && frames.size() != poses.size()) {
    throw Error("'" + path + "' has " + std::to_string(poses.size()) +
                " poses for the " + std::to_string(frames.size()) +
                " frames of the model, whose names are not line numbers");
  }
  std::map<std::string, Rigid3> assigned;
  for (size_t i = 0; i < frames.size(); ++i) {
    assigned[frames[i]] =
        poses[are_line_numbers ? static_cast<size_t>(*NumberOf(frames[i])) : i];
  }
  return assigned;
}

// The pose nearest in time, if within half the usual step between poses.
std::map<std::string, Rigid3> AssignByTime(
    const std::vector<std::string>& frames, const std::vector<TimedPose>& poses,
    const std::string& path) {
  constexpr double kMinNanoseconds = 1e14;
  const bool have_times =
      poses.size() > 1 &&
      std::all_of(frames.begin(), frames.end(), [](const std::string& frame) {
        return NumberOf(frame).has_value();
      });
  if (!have_times) {
    std::vector<Rigid3> in_order;
    in_order.reserve(poses.size());
    for (const TimedPose& pose : poses) in_order.push_back(pose.cam_from_world);
    return AssignByNumber(frames, in_order, path);
  }
  const double max_difference_s =
      0.5 * (poses.back().timestamp_s - poses.front().timestamp_s) /
      static_cast<double>(poses.size() - 1);
  std::map<std::string, Rigid3> assigned;
  for (const std::string& frame : frames) {
    double time_s = *NumberOf(frame);
    if (time_s > kMinNanoseconds) time_s *= 1e-9;
    const TimedPose* nearest = &poses.front();
    for (const TimedPose& pose : poses) {
      if (std::abs(pose.timestamp_s - time_s) <
          std::abs(nearest->timestamp_s - time_s)) {
        nearest = &pose;
      }
    }
    if (std::abs(nearest->timestamp_s - time_s) <= max_difference_s) {
      assigned[frame] = nearest->cam_from_world;
    }
  }
  if (assigned.empty()) {
    throw Error("no time in '" + path + "' is near that of any image name");
  }
  return assigned;
}

std::vector<ImagePoses> PairWithTrajectory(
    const NamedModel& model,
    const std::map<std::string, Rigid3>& ref_from_world,
    const std::map<std::string, Rigid3>& sensor_from_ref) {
  std::vector<ImagePoses> images;
  for (const ModelImage& image : model.poses.images) {
    const std::string folder = FolderOf(image.name);
    const bool is_reference = folder == model.folders.front();
    const auto pose = ref_from_world.find(FrameOf(image.name));
    const auto sensor = sensor_from_ref.find(folder);
    if (pose == ref_from_world.end()) continue;
    if (!is_reference && sensor == sensor_from_ref.end()) continue;
    const Rigid3 true_pose =
        is_reference ? pose->second : sensor->second * pose->second;
    images.push_back(
        {image.name, is_reference, image.cam_from_world, true_pose});
  }
  return images;
}

std::vector<ImagePoses> PairWithModel(const NamedModel& model,
                                      const NamedModel& truth) {
  std::map<std::string, const ModelImage*> by_name;
  for (const ModelImage& image : model.poses.images) {
    by_name[image.name] = &image;
  }
  std::vector<ImagePoses> images;
  for (const ModelImage& image : truth.poses.images) {
    ImagePoses poses{image.name, FolderOf(image.name) == model.folders.front(),
                     std::nullopt, image.cam_from_world};
    const auto it = by_name.find(image.name);
    if (it != by_name.end()) poses.cam_from_model = it->second->cam_from_world;
    images.push_back(poses);
  }
  return images;
}

Evaluation EvaluateModel(const EvaluatorOptions& options) {
  const EvaluationOptions thresholds{
      ParseThresholds("position_thresholds", options.position_thresholds),
      ParseThresholds("rotation_thresholds", options.rotation_thresholds)};
  const NamedModel model =
      NameModel(ReadModelPoses(options.input_path), options.reference);
  if (options.gt_format == TruthFormat::kColmap) {
    const NamedModel truth =
        NameModel(ReadModelPoses(options.gt_path), model.folders.front());
    std::map<std::string, Rigid3> sensors;
    for (const auto& [folder, pose] : truth.sensor_from_ref) {
      if (pose) sensors[folder] = *pose;
    }
    return Evaluate(PairWithModel(model, truth), true,
                    PairSensors(model, sensors), thresholds);
  }
  const std::map<std::string, Rigid3> sensors =
      ReadCalibration(options.calib_path, model);
  if (options.gt_format == TruthFormat::kRig) {
    std::map<std::string, Rigid3> no_poses;
    for (const std::string& frame : model.frames) no_poses[frame] = Rigid3();
    return Evaluate(PairWithTrajectory(model, no_poses, sensors), false,
                    PairSensors(model, sensors), thresholds);
  }
  const std::map<std::string, Rigid3> poses =
      options.gt_format == TruthFormat::kKitti
          ? AssignByNumber(model.frames, ReadKittiPoses(options.gt_path),
                           options.gt_path)
          : AssignByTime(model.frames, ReadTumPoses(options.gt_path),
                         options.gt_path);
  return Evaluate(PairWithTrajectory(model, poses, sensors), true,
                  PairSensors(model, sensors), thresholds);
}

int RunModelEvaluator(const EvaluatorOptions& options, const Context&) {
  const bool needs_calibration = options.gt_format == TruthFormat::kRig;
  if (needs_calibration && options.calib_path.empty()) {
    throw Error("--gt_format rig needs --calib_path");
  }
  if (!needs_calibration && options.gt_path.empty()) {
    throw Error("--gt_path is needed, or --gt_format rig with --calib_path");
  }
  const Evaluation evaluation = EvaluateModel(options);
  std::cout << EvaluationToText(evaluation);
  if (!options.json.empty()) {
    std::ofstream file(options.json);
    file << EvaluationToJson(evaluation);
    file.close();
    if (!file) throw Error("cannot write '" + options.json + "'");
  }
  return kExitSuccess;
}

}  // namespace

Command ModelEvaluatorCommand() {
  return MakeCommand("model_evaluator",
                     "Compares a model with true poses or a true rig.",
                     RunModelEvaluator);
}

}  // namespace mgsfm
