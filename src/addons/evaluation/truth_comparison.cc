// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/truth_comparison.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "evaluation/true_trajectory.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/rigs/rig_config.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// The rotation cam_from_world if the file is meant differently.
Quaterniond Reread(const Quaterniond& cam_from_world,
                   const PoseConvention& convention, bool is_reordered,
                   bool is_inverse) {
  Quaterniond in_file = convention.is_world_from_cam
                            ? cam_from_world.conjugate()
                            : cam_from_world;
  if (is_reordered && convention.order == PoseConvention::kXyzw) {
    in_file = Quaterniond(in_file.x(), in_file.y(), in_file.z(), in_file.w());
  } else if (is_reordered) {
    in_file = FromOrderXyzw(in_file);
  }
  return convention.is_world_from_cam != is_inverse ? in_file.conjugate()
                                                    : in_file;
}

std::vector<double> DifferencesRad(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, bool is_reordered, bool is_inverse) {
  std::vector<double> differences_rad;
  for (const RotationEvidence& pair : evidence) {
    const auto reread = [&](const Quaterniond& rotation) {
      return Reread(rotation, convention, is_reordered, is_inverse);
    };
    differences_rad.push_back(
        AngleBetween(pair.second_from_first,
                     reread(pair.second) * reread(pair.first).conjugate()));
  }
  return differences_rad;
}

// Whether more pairs are for the other reading than chance explains: between
// readings that are equally wrong, a pair decides like a coin. With 3.1
// standard deviations, chance does so once in 1000 files, and never in one of
// fewer than ten pairs.
bool MostAreFor(const std::vector<double>& other_rad,
                const std::vector<double>& as_read_rad) {
  const auto num_pairs = static_cast<double>(other_rad.size());
  double num_for = 0.0;
  for (size_t i = 0; i < other_rad.size(); ++i) {
    num_for += other_rad[i] < as_read_rad[i];
  }
  return 2.0 * num_for - num_pairs > 3.1 * std::sqrt(num_pairs);
}

}  // namespace

std::optional<std::string> FindOtherConvention(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, const std::string& source) {
  // Errors of sound poses shrink by no other convention.
  constexpr double kMaxRatio = 0.2;
  if (evidence.empty()) return std::nullopt;
  const std::vector<double> as_read_rad =
      DifferencesRad(evidence, convention, false, false);
  const double difference_rad = Median(as_read_rad);
  for (const auto& [is_reordered, is_inverse] :
       {std::pair(true, false), std::pair(false, true),
        std::pair(true, true)}) {
    if (is_reordered && convention.order == PoseConvention::kMatrix) continue;
    const std::vector<double> reread_rad =
        DifferencesRad(evidence, convention, is_reordered, is_inverse);
    const double other_rad = Median(reread_rad);
    if (!(other_rad < kMaxRatio * difference_rad) ||
        !MostAreFor(reread_rad, as_read_rad)) {
      continue;
    }
    const auto degrees = [](double rad) {
      return FormatDouble(RadToDeg(rad), std::chars_format::general, 3);
    };
    std::string other = !is_inverse                    ? ""
                        : convention.is_world_from_cam ? "poses cam_from_world"
                                                       : "poses world_from_cam";
    if (is_reordered) {
      other +=
          std::string(is_inverse ? " and " : "") + "quaternions " +
          (convention.order == PoseConvention::kXyzw ? "w x y z" : "x y z w");
    }
    return "the rotations from image to image differ from those of the " +
           source + " by " + degrees(difference_rad) +
           " deg in the median, but by " + degrees(other_rad) +
           " deg if the file has " + other +
           "; write it again in the documented convention";
  }
  return std::nullopt;
}

namespace {

// True sensor_from_ref per sensor of the model, as far as it is known.
using TrueSensors = std::vector<std::optional<Rigid3>>;

std::vector<Rigid3> ReadCameras(const std::string& calib_path) {
  const std::vector<std::string> paths = SplitList(calib_path);
  const std::string extension =
      std::filesystem::path(paths.front()).extension().string();
  if (extension != ".yaml" && extension != ".yml") {
    return ReadKittiCalibration(paths.front());
  }
  return Transformed(paths, ReadEurocCalibration);
}

// The number at the end of a name, such as 2 of image_2.
std::optional<double> CameraNumber(const std::string& sensor_name) {
  const size_t digits = sensor_name.find_last_not_of("0123456789") + 1;
  return ParseNumber(sensor_name.substr(digits));
}

// The cameras of sensors by name: image_2 and image_3 are the third and fourth
// of KITTI's matrices, others go by their order, so there must be as many.
std::vector<Rigid3> PairCameras(const std::map<std::string, int>& sensors,
                                const std::vector<Rigid3>& cameras,
                                const std::string& calib_path) {
  std::vector<Rigid3> paired;
  for (const auto& [name, sensor_idx] : sensors) {
    const auto number = CameraNumber(name);
    const bool is_numbered =
        number && *number < static_cast<double>(cameras.size());
    if (!is_numbered && sensors.size() != cameras.size()) {
      throw Error(Formatted(
          "'%s' has %zu cameras for the %zu of the model, and the name of '%s' "
          "does not tell which is its; give one calibration per camera, or a "
          "rig_config.json",
          calib_path.c_str(), cameras.size(), sensors.size(), name.c_str()));
    }
    const size_t order = paired.size();
    paired.push_back(
        cameras[is_numbered ? static_cast<size_t>(*number) : order]);
  }
  return paired;
}

// The cameras of a rig configuration that images of the sensor have.
std::vector<const RigConfigCamera*> FindCameras(const PosedScene& model,
                                                int sensor_idx,
                                                const RigConfig& rig) {
  std::vector<const RigConfigCamera*> cameras;
  for (const RigConfigCamera& camera : rig.cameras) {
    const bool has_image = AnyOf(model.scene.images, [&](const Image& image) {
      return image.sensor_idx == sensor_idx &&
             FrameKeyOf(camera, image.name).has_value();
    });
    if (has_image) cameras.push_back(&camera);
  }
  return cameras;
}

// The poses in one rig of the configuration, if it has all sensors of a rig of
// the model; nullopt for those whose pose it leaves open.
std::optional<std::map<int, std::optional<Rigid3>>> PosesInConfig(
    const PosedScene& model, int rig_idx, const RigConfig& config,
    const std::string& path) {
  std::map<int, std::optional<Rigid3>> poses;
  for (const int sensor_idx : model.scene.rigs[rig_idx].sensor_idxs) {
    const auto cameras = FindCameras(model, sensor_idx, config);
    if (cameras.empty()) return std::nullopt;
    if (cameras.size() > 1) {
      throw Error("'" + path + "' has two cameras for the images of '" +
                  model.scene.sensors[sensor_idx].name + "', '" +
                  cameras[0]->NameRule() + "' and '" + cameras[1]->NameRule() +
                  "'; keep one of them");
    }
    poses[sensor_idx] = cameras.front()->cam_from_rig;
  }
  return poses;
}

// Our own or COLMAP's rig_config.json as the truth.
TrueSensors ReadTrueRigConfig(const std::string& path,
                              const PosedScene& model) {
  const std::vector<RigConfig> configs = ReadRigConfig(path);
  TrueSensors sensors(model.scene.sensors.size());
  for (size_t rig_idx = 0; rig_idx < model.scene.rigs.size(); ++rig_idx) {
    std::optional<std::map<int, std::optional<Rigid3>>> poses;
    for (const RigConfig& config : configs) {
      if (!poses) {
        poses = PosesInConfig(model, static_cast<int>(rig_idx), config, path);
      }
    }
    const int ref_sensor = model.scene.rigs[rig_idx].ref_sensor_idx;
    if (!poses) {
      throw Error("'" + path + "' has no rig with a camera for each of the " +
                  std::to_string(model.scene.rigs[rig_idx].sensor_idxs.size()) +
                  " cameras of the rig of '" +
                  model.scene.sensors[ref_sensor].name +
                  "'; its image_prefix must be those of the image names");
    }
    for (const auto& [sensor_idx, pose] : *poses) {
      if (pose && poses->at(ref_sensor)) {
        sensors[sensor_idx] = *pose * poses->at(ref_sensor)->Inverse();
      }
    }
    sensors[ref_sensor] = Rigid3();
  }
  return sensors;
}

TrueSensors ReadTrueSensors(const std::string& calib_path,
                            const PosedScene& model) {
  if (std::filesystem::path(calib_path).extension() == ".json") {
    return ReadTrueRigConfig(calib_path, model);
  }
  TrueSensors sensors(model.scene.sensors.size());
  for (const Rig& rig : model.scene.rigs) {
    sensors[rig.ref_sensor_idx] = Rigid3();
  }
  if (SplitList(calib_path).empty()) return sensors;
  const std::vector<Rigid3> cameras = ReadCameras(calib_path);
  for (size_t rig_idx = 0; rig_idx < model.scene.rigs.size(); ++rig_idx) {
    std::map<std::string, int> by_name;
    for (const int sensor_idx : model.scene.rigs[rig_idx].sensor_idxs) {
      by_name[model.scene.sensors[sensor_idx].name] = sensor_idx;
    }
    const auto paired = PairCameras(by_name, cameras, calib_path);
    size_t order = 0;
    for (const auto& [name, sensor_idx] : by_name) {
      sensors[sensor_idx] = paired[order++];
    }
    const Rigid3 any_from_ref =
        sensors[model.scene.rigs[rig_idx].ref_sensor_idx]->Inverse();
    for (const auto& [name, sensor_idx] : by_name) {
      sensors[sensor_idx] = *sensors[sensor_idx] * any_from_ref;
    }
  }
  return sensors;
}

std::vector<SensorPoses> PairSensors(const PosedScene& model,
                                     const TrueSensors& truth) {
  std::vector<SensorPoses> sensors;
  for (size_t i = 0; i < model.scene.sensors.size(); ++i) {
    const Sensor& sensor = model.scene.sensors[i];
    if (model.scene.IsReference(static_cast<int>(i))) continue;
    sensors.push_back({sensor.name, sensor.sensor_from_rig, truth[i]});
  }
  return sensors;
}

// Per sensor of the model; sensors with common images are the same.
TrueSensors FindTrueSensors(const PosedScene& model, const PosedScene& truth,
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
        true_sensor[model.scene.rigs[model.scene.sensors[i].rig_idx]
                        .ref_sensor_idx];
    if (!sensor || !ref) continue;
    const Sensor& of_sensor = truth.scene.sensors[*sensor];
    const Sensor& of_ref = truth.scene.sensors[*ref];
    if (of_sensor.rig_idx != of_ref.rig_idx || !of_sensor.sensor_from_rig ||
        !of_ref.sensor_from_rig) {
      continue;
    }
    sensors[i] = *of_sensor.sensor_from_rig * of_ref.sensor_from_rig->Inverse();
  }
  return sensors;
}

TruthComparison CompareWithModel(const TruthSource& source,
                                 const PosedScene& model) {
  const PosedScene truth = ReadPosedScene(source.gt_path, source.image_prefix,
                                          "", source.rig_name_rule);
  const auto image_of_name = IndexByName(model.scene.images);
  // Whether a ground-truth sensor is a reference of the model; --reference may
  // select another one.
  std::vector<std::optional<bool>> is_reference(truth.scene.sensors.size());
  for (const Image& image : truth.scene.images) {
    const auto found = image_of_name.find(image.name);
    if (found == image_of_name.end()) continue;
    is_reference[image.sensor_idx] = model.IsReference(found->second);
  }
  TruthComparison comparison;
  std::vector<int> true_image_of_image(model.scene.images.size(), -1);
  const auto add = [&](int true_idx) {
    const Image& image = truth.scene.images[true_idx];
    ImagePoses poses{
        image.name,
        is_reference[image.sensor_idx].value_or(truth.IsReference(true_idx)),
        std::nullopt, truth.cam_from_world[true_idx]};
    const auto found = image_of_name.find(image.name);
    if (found != image_of_name.end()) {
      true_image_of_image[found->second] = true_idx;
      poses.cam_from_model = model.cam_from_world[found->second];
    }
    comparison.images.push_back(std::move(poses));
  };
  // Paths follow the order of frames, which is not that of names.
  for (const Frame& frame : truth.scene.frames) {
    std::for_each(frame.image_idxs.begin(), frame.image_idxs.end(), add);
  }
  if (NoneOf(comparison.images, [](const ImagePoses& image) {
        return image.cam_from_model.has_value();
      })) {
    throw Error("the models '" + source.model_path + "' and '" +
                source.gt_path + "' have no image in common; the names of " +
                "their images must agree");
  }
  comparison.sensors =
      PairSensors(model, FindTrueSensors(model, truth, true_image_of_image));
  return comparison;
}

TruthComparison CompareWithRig(const PosedScene& model,
                               const TrueSensors& true_sensors) {
  TruthComparison comparison;
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
ImageNames ReadOtherImages(const TruthSource& source, const PosedScene& model) {
  if (source.database_path.empty()) return std::nullopt;
  std::set<std::string> in_model;
  for (const Image& image : model.scene.images) in_model.insert(image.name);
  const std::string& prefix = source.image_prefix;
  std::vector<std::string> others = ReadImageNames(source.database_path);
  EraseIf(&others, [&](const std::string& name) {
    return name.compare(0, prefix.size(), prefix) != 0 ||
           in_model.count(name) > 0;
  });
  return others;
}

TruthComparison CompareWithTrajectory(const TruthSource& source,
                                      const PosedScene& model,
                                      const TrueSensors& true_sensors) {
  TruthComparison comparison;
  comparison.images =
      PairWithTrajectory(model, source.gt_path, source.gt_format, true_sensors,
                         ReadOtherImages(source, model));
  comparison.sensors = PairSensors(model, true_sensors);
  return comparison;
}

bool IsMetric(const TruthSource& source) {
  if (source.gt_format == TruthFormat::kColmap) {
    return ReadGeoOrigin(source.gt_path).has_value();
  }
  return source.gt_format != TruthFormat::kRig ||
         std::filesystem::path(source.calib_path).extension() != ".json";
}

std::vector<std::string> UnpairedImages(const PosedScene& model,
                                        const TruthComparison& comparison) {
  std::set<std::string> paired;
  for (const ImagePoses& image : comparison.images) paired.insert(image.name);
  auto names = Transformed(model.scene.images, &Image::name);
  EraseIf(&names, [&](const auto& name) { return paired.count(name) > 0; });
  return names;
}

TruthComparison Compare(const TruthSource& source, const PosedScene& model) {
  if (source.gt_format == TruthFormat::kColmap) {
    return CompareWithModel(source, model);
  }
  const TrueSensors true_sensors = ReadTrueSensors(source.calib_path, model);
  return source.gt_format == TruthFormat::kRig
             ? CompareWithRig(model, true_sensors)
             : CompareWithTrajectory(source, model, true_sensors);
}

}  // namespace

TruthComparison CompareWithTruth(const TruthSource& source) {
  const PosedScene model =
      ReadPosedScene(source.model_path, source.image_prefix, source.reference,
                     source.rig_name_rule);
  TruthComparison comparison = Compare(source, model);
  comparison.is_metric = IsMetric(source);
  comparison.unpaired_images = UnpairedImages(model, comparison);
  return comparison;
}

void WarnOfFewPoses(const TruthComparison& comparison,
                    const Evaluation& evaluation, Alignment alignment,
                    const Context& context) {
  const std::vector<std::string>& names = comparison.unpaired_images;
  if (!names.empty()) {
    context.Warning(
        Formatted("%zu images of the model have no true pose and are not "
                  "compared, such as '%s'",
                  names.size(), names.front().c_str()));
  }
  // A similarity moves two positions to any others, a rigid transform one.
  const int max_free = alignment == Alignment::kSimilarity ? 2
                       : alignment == Alignment::kRigid    ? 1
                                                           : 0;
  if (!evaluation.position_m || evaluation.num_registered > max_free) return;
  context.Warning(Formatted(
      "the errors of positions are 0 for any model, as only %d of its "
      "images have true poses; compare more images",
      evaluation.num_registered));
}

}  // namespace mgsfm
