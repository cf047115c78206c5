// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rigs/rig_config.h"

#include <map>
#include <nlohmann/json.hpp>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text.h"
#include "files/file_operations.h"
#include "files/json_reading.h"
#include "mgsfm/base/error.h"
#include "rigs/name_patterns.h"
#include "rigs/rig_inference.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kCameras = "cameras";
constexpr const char* kPrefix = "image_prefix";
constexpr const char* kPattern = "image_pattern";
constexpr const char* kReference = "ref_sensor";
constexpr const char* kRotation = "cam_from_rig_rotation";
constexpr const char* kTranslation = "cam_from_rig_translation";
constexpr const char* kRefCameraId = "ref_camera_id";
constexpr const char* kCameraId = "camera_id";
constexpr const char* kLegacyRotation = "rel_qvec";
constexpr const char* kLegacyTranslation = "rel_tvec";
constexpr const char* kModel = "camera_model_name";
constexpr const char* kParams = "camera_params";

// Reads one object of the file; messages state its position.
class ObjectReader {
 public:
  ObjectReader(const Json& json, const std::string& path,
               const std::string& where)
      : json_(json), path_(path), where_(where) {
    if (!json.is_object()) Throw("is not an object");
  }

  [[noreturn]] void Throw(const std::string& problem) const {
    throw Error("rig configuration '" + path_ + "': " + where_ + " " + problem);
  }

  void CheckKeys(const std::vector<std::string>& known) const {
    for (const auto& [key, value] : json_.items()) {
      if (!Contains(known, key)) {
        Throw("has the unknown key '" + key + "'");
      }
    }
  }
  bool Has(const std::string& key) const { return json_.contains(key); }

  std::string Text(const std::string& key) const {
    if (!Has(key) || !json_[key].is_string()) {
      Throw("needs '" + key + "', a text");
    }
    auto text = json_[key].get<std::string>();
    if (const auto problem = WhyUnusable(text)) {
      Throw("has a '" + key + "' that " + *problem);
    }
    return text;
  }
  bool Flag(const std::string& key) const {
    if (!Has(key)) return false;
    if (!json_[key].is_boolean()) Throw("needs '" + key + "' true or false");
    return json_[key].get<bool>();
  }
  std::vector<double> Numbers(const std::string& key, size_t size) const {
    const bool is_array = Has(key) && json_[key].is_array();
    std::vector<double> numbers;
    if (is_array) {
      for (const Json& number : json_[key]) {
        if (number.is_number()) numbers.push_back(number.get<double>());
      }
    }
    if (!is_array || numbers.size() != json_[key].size() ||
        numbers.size() != size) {
      Throw("needs '" + key + "', an array of " + std::to_string(size) +
            " numbers");
    }
    return numbers;
  }
  double Number(const std::string& key) const {
    if (!Has(key) || !json_[key].is_number()) {
      Throw("needs '" + key + "', a number");
    }
    return json_[key].get<double>();
  }
  // Rotation and translation must come together.
  bool HasBoth(const std::string& a, const std::string& b) const {
    if (Has(a) != Has(b)) {
      Throw("has only one of '" + a + "' and '" + b + "'");
    }
    return Has(a);
  }

 private:
  const Json& json_;
  const std::string& path_;
  std::string where_;
};

Rigid3 ReadPose(const ObjectReader& object, const char* rotation = kRotation,
                const char* translation = kTranslation) {
  const std::vector<double> q = object.Numbers(rotation, 4);
  const std::vector<double> t = object.Numbers(translation, 3);
  Rigid3 pose = PoseOfFile({q[0], q[1], q[2], q[3]}, {t[0], t[1], t[2]});
  if (const auto problem = WhyImplausible(pose)) {
    object.Throw("has a pose that " + *problem);
  }
  return pose;
}

RigConfigCamera ReadCamera(const ObjectReader& object) {
  object.CheckKeys({kPrefix, kPattern, kReference, kRotation, kTranslation,
                    kModel, kParams});
  RigConfigCamera camera;
  if (object.Has(kPattern)) {
    if (object.Has(kPrefix)) object.Throw("has a prefix and a pattern");
    camera.image_pattern = object.Text(kPattern);
    if (camera.image_pattern.empty()) object.Throw("has an empty pattern");
  } else {
    camera.image_prefix = object.Text(kPrefix);
  }
  camera.is_reference = object.Flag(kReference);
  if (camera.is_reference) camera.cam_from_rig = Rigid3();
  if (object.HasBoth(kRotation, kTranslation)) {
    if (camera.is_reference) {
      object.Throw("is the reference sensor, so it must not have a pose");
    }
    camera.cam_from_rig = ReadPose(object);
  }
  if (object.HasBoth(kModel, kParams)) {
    const std::string name = object.Text(kModel);
    const CameraModelInfo* model = FindCameraModel(name);
    if (model == nullptr) {
      object.Throw("has the unknown camera model '" + name + "'");
    }
    camera.camera_model = model->id;
    camera.camera_params =
        object.Numbers(kParams, static_cast<size_t>(model->num_params));
  }
  return camera;
}

// A camera of rig_bundle_adjuster, whose reference may have a pose as well.
RigConfigCamera ReadLegacyCamera(const ObjectReader& object, double ref_id) {
  object.CheckKeys({kCameraId, kPrefix, kLegacyRotation, kLegacyTranslation,
                    kRotation, kTranslation});
  RigConfigCamera camera;
  camera.image_prefix = object.Text(kPrefix);
  camera.is_reference = object.Number(kCameraId) == ref_id;
  if (object.HasBoth(kLegacyRotation, kLegacyTranslation)) {
    camera.cam_from_rig = ReadPose(object, kLegacyRotation, kLegacyTranslation);
  } else if (object.HasBoth(kRotation, kTranslation)) {
    camera.cam_from_rig = ReadPose(object);
  }
  return camera;
}

// Poses relative to the reference. Poses of the others count only if the
// reference has one.
void MoveToReference(std::vector<RigConfigCamera>* cameras) {
  std::optional<Rigid3> ref_from_rig;
  for (const RigConfigCamera& camera : *cameras) {
    if (camera.is_reference) ref_from_rig = camera.cam_from_rig;
  }
  for (RigConfigCamera& camera : *cameras) {
    if (camera.is_reference) {
      camera.cam_from_rig = Rigid3();
    } else if (!ref_from_rig) {
      camera.cam_from_rig.reset();
    } else if (camera.cam_from_rig) {
      camera.cam_from_rig = *camera.cam_from_rig * ref_from_rig->Inverse();
    }
  }
}

RigConfig ReadRig(const Json& json, const std::string& path,
                  const std::string& where) {
  const ObjectReader object(json, path, where);
  object.CheckKeys({kCameras, kRefCameraId});
  const bool is_legacy = object.Has(kRefCameraId);
  if (!object.Has(kCameras) || !json[kCameras].is_array() ||
      json[kCameras].empty()) {
    object.Throw("needs 'cameras', an array of cameras");
  }
  RigConfig rig;
  for (const Json& camera : json[kCameras]) {
    const std::string camera_where =
        "camera " + std::to_string(rig.cameras.size() + 1) + " of " + where;
    const ObjectReader reader(camera, path, camera_where);
    rig.cameras.push_back(
        is_legacy ? ReadLegacyCamera(reader, object.Number(kRefCameraId))
                  : ReadCamera(reader));
  }
  const auto num_references = CountIf(
      rig.cameras,
      [](const RigConfigCamera& camera) { return camera.is_reference; });
  if (num_references != 1) {
    object.Throw("has " + std::to_string(num_references) +
                 (is_legacy ? " cameras with the \"camera_id\" of "
                              "\"ref_camera_id\"; it needs one"
                            : " cameras with \"ref_sensor\": true; it needs "
                              "one"));
  }
  if (is_legacy) MoveToReference(&rig.cameras);
  for (const RigConfigCamera& camera : rig.cameras) {
    const auto problem = camera.cam_from_rig
                             ? WhyImplausible(*camera.cam_from_rig)
                             : std::nullopt;
    if (problem) object.Throw("has a pose that " + *problem);
  }
  return rig;
}

Json CameraToJson(const RigConfigCamera& camera) {
  Json json;
  if (camera.image_pattern.empty()) {
    json[kPrefix] = camera.image_prefix;
  } else {
    json[kPattern] = camera.image_pattern;
  }
  if (camera.is_reference) json[kReference] = true;
  if (camera.cam_from_rig && !camera.is_reference) {
    const Eigen::Quaterniond& q = camera.cam_from_rig->rotation;
    const Eigen::Vector3d& t = camera.cam_from_rig->translation;
    json[kRotation] = {q.w(), q.x(), q.y(), q.z()};
    json[kTranslation] = {t.x(), t.y(), t.z()};
  }
  if (camera.camera_model) {
    json[kModel] = std::string(InfoOf(*camera.camera_model).name);
    json[kParams] = camera.camera_params;
  }
  return json;
}

// The images of one rig in one outer folder, such as seq1 of seq1/cam0/0.jpg,
// or of a whole rig, and the rule that distinguishes its cameras.
struct NameGroup {
  std::vector<int> image_idxs;
  std::map<int, RigConfigCamera> rule_of_sensor;
  bool is_valid = true;
};

// Returns the sensor's prefix of the name of an image, and in `outer` the
// folders before the sensor's own name.
std::string ImagePrefix(const Image& image, const std::string& sensor_name,
                        std::string* outer) {
  *outer = "";
  if (const auto begin = FindSensorName(image.name, sensor_name)) {
    const size_t end = *begin + sensor_name.size();
    *outer = image.name.substr(0, *begin);
    const bool is_folder = end > *begin && image.name[end] == '/';
    return image.name.substr(0, is_folder ? end + 1 : end);
  }
  return image.name.substr(0, image.name.rfind('/') + 1);
}

// Groups the images of a rig by outer folder.
std::map<std::string, NameGroup> GroupImages(const Scene& scene, int rig_idx) {
  std::map<std::string, NameGroup> groups;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const Sensor& sensor = scene.sensors[image.sensor_idx];
    if (sensor.rig_idx != rig_idx) continue;
    std::string outer;
    RigConfigCamera rule;
    rule.image_prefix = ImagePrefix(image, sensor.name, &outer);
    NameGroup& group = groups[outer];
    group.image_idxs.push_back(static_cast<int>(i));
    const auto [known, is_new] =
        group.rule_of_sensor.emplace(image.sensor_idx, rule);
    if (!is_new && known->second.image_prefix != rule.image_prefix) {
      group.is_valid = false;
    }
  }
  return groups;
}

// Whether the rules reproduce the sensors, and the rest of the names joins no
// images of different frames. It may differ within a frame if times define the
// frames.
bool IsFaithful(const Scene& scene, const NameGroup& group) {
  if (!group.is_valid) return false;
  std::map<std::string, int> frame_of_key;
  for (const auto& [sensor_idx, rule] : group.rule_of_sensor) {
    for (const Image& image : scene.images) {
      const bool fits = FrameKeyOf(rule, image.name).has_value();
      if (fits && image.sensor_idx != sensor_idx) return false;
    }
  }
  for (const int image_idx : group.image_idxs) {
    const Image& image = scene.images[image_idx];
    const auto key =
        FrameKeyOf(group.rule_of_sensor.at(image.sensor_idx), image.name);
    if (!key) return false;
    const auto frame = frame_of_key.emplace(*key, image.frame_idx).first;
    if (frame->second != image.frame_idx) return false;
  }
  return true;
}

// The images of a rig with the first patterns that reproduce it.
std::optional<NameGroup> FindPatterns(const Scene& scene, int rig_idx) {
  NameGroup group;
  NameGroups names_of_sensor;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    if (scene.sensors[image.sensor_idx].rig_idx != rig_idx) continue;
    group.image_idxs.push_back(static_cast<int>(i));
    names_of_sensor[image.sensor_idx].push_back(image.name);
  }
  for (const auto& patterns : FindNamePatterns(names_of_sensor)) {
    auto pattern = patterns.begin();
    for (const auto& entry : names_of_sensor) {
      group.rule_of_sensor[entry.first].image_pattern = *pattern++;
    }
    if (IsFaithful(scene, group)) return group;
  }
  return std::nullopt;
}

// The groups that describe a rig; empty if names do not distinguish its
// cameras.
std::vector<NameGroup> DescribeRig(const Scene& scene, int rig_idx) {
  std::vector<NameGroup> faithful;
  const auto groups = GroupImages(scene, rig_idx);
  for (const auto& [outer, group] : groups) {
    if (IsFaithful(scene, group)) faithful.push_back(group);
  }
  if (faithful.size() == groups.size() || groups.empty()) return faithful;
  if (auto group = FindPatterns(scene, rig_idx)) return {*std::move(group)};
  return faithful;
}

// The rig's reference if it has images here, otherwise the first sensor that
// has a pose to which the others can be related.
int ReferenceOf(const Scene& scene, const Reconstruction& reconstruction,
                const NameGroup& group) {
  int chosen = -1;
  for (const auto& [sensor_idx, rule] : group.rule_of_sensor) {
    if (scene.IsReference(sensor_idx)) return sensor_idx;
    const bool has_pose =
        reconstruction.sensor_from_rig[sensor_idx].has_value();
    if (chosen < 0 ||
        (has_pose && !reconstruction.sensor_from_rig[chosen].has_value())) {
      chosen = sensor_idx;
    }
  }
  return chosen;
}

RigConfig MakeRigConfig(const Scene& scene,
                        const Reconstruction& reconstruction,
                        const NameGroup& group) {
  const int ref_sensor_idx = ReferenceOf(scene, reconstruction, group);
  const auto& ref_from_rig = reconstruction.sensor_from_rig[ref_sensor_idx];
  RigConfig rig;
  for (const auto& [sensor_idx, rule] : group.rule_of_sensor) {
    RigConfigCamera config = rule;
    config.is_reference = sensor_idx == ref_sensor_idx;
    const auto& sensor_from_rig = reconstruction.sensor_from_rig[sensor_idx];
    if (config.is_reference) {
      config.cam_from_rig = Rigid3();
    } else if (scene.IsReference(ref_sensor_idx)) {
      config.cam_from_rig = sensor_from_rig;
    } else if (sensor_from_rig && ref_from_rig) {
      config.cam_from_rig = *sensor_from_rig * ref_from_rig->Inverse();
    }
    const Camera& camera =
        reconstruction.cameras[scene.sensors[sensor_idx].camera_idx];
    config.camera_model = camera.model;
    config.camera_params = camera.params;
    rig.cameras.push_back(std::move(config));
  }
  return rig;
}

}  // namespace

std::optional<std::string> FrameKeyOf(const RigConfigCamera& camera,
                                      const std::string& image_name) {
  if (!camera.image_pattern.empty()) {
    return MatchNamePattern(image_name, camera.image_pattern);
  }
  const std::string& prefix = camera.image_prefix;
  if (image_name.compare(0, prefix.size(), prefix) != 0) return std::nullopt;
  if (prefix.empty()) return image_name;
  size_t begin = image_name.rfind(prefix) + prefix.size();
  // "cam1" and "cam1/" mean the same folder.
  if (begin < image_name.size() && image_name[begin] == '/') ++begin;
  return image_name.substr(begin);
}

std::vector<RigConfig> ReadRigConfig(const std::string& path) {
  const std::string text = ReadFile(path, "rig configuration '" + path + "'");
  const Json json = ParseJson(text, "rig configuration '" + path + "'");
  if (!json.is_array() || json.empty()) {
    throw Error("rig configuration '" + path + "' is not an array of rigs" +
                (json.is_array() ? ", as the names of images do not tell the "
                                   "cameras of the model apart; rename them"
                                 : ""));
  }
  std::vector<RigConfig> rigs;
  for (const Json& rig : json) {
    rigs.push_back(
        ReadRig(rig, path, "rig " + std::to_string(rigs.size() + 1)));
  }
  return rigs;
}

std::string RigConfigsToJson(const std::vector<RigConfig>& rigs) {
  Json json = Json::array();
  for (const RigConfig& rig : rigs) {
    Json cameras = Json::array();
    for (const RigConfigCamera& camera : rig.cameras) {
      cameras.push_back(CameraToJson(camera));
    }
    json.push_back({{kCameras, cameras}});
  }
  return json.dump(2) + '\n';
}

void WriteRigConfig(const std::string& path,
                    const std::vector<RigConfig>& rigs) {
  WriteFile(path, RigConfigsToJson(rigs));
}

std::vector<RigConfig> MakeRigConfigs(const Scene& scene,
                                      const Reconstruction& reconstruction) {
  std::vector<RigConfig> rigs;
  for (size_t rig_idx = 0; rig_idx < scene.rigs.size(); ++rig_idx) {
    for (const NameGroup& group :
         DescribeRig(scene, static_cast<int>(rig_idx))) {
      rigs.push_back(MakeRigConfig(scene, reconstruction, group));
    }
  }
  return rigs;
}

void WriteRigConfig(const std::string& path, const Scene& scene,
                    const Reconstruction& reconstruction) {
  WriteRigConfig(path, MakeRigConfigs(scene, reconstruction));
}

}  // namespace mgsfm
