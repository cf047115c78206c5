// SPDX-License-Identifier: BSD-3-Clause
#include "named_model.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mgsfm/base/error.h"
#include "models/model_checks.h"

namespace mgsfm {
namespace {

void KeepPrefix(const std::string& path, const std::string& prefix,
                PoseModel* poses) {
  auto& images = poses->images;
  images.erase(std::remove_if(images.begin(), images.end(),
                              [&](const ModelImage& image) {
                                return image.name.compare(0, prefix.size(),
                                                          prefix) != 0;
                              }),
               images.end());
  if (images.empty()) {
    throw Error("no image of the model '" + path +
                "' has a name that starts "
                "with '" +
                prefix + "'");
  }
}

// The model as rows of a database, with placeholder intrinsics.
DatabaseContents ToContents(const PoseModel& poses, const std::string& path) {
  DatabaseContents contents;
  contents.path = path;
  std::set<CameraId> camera_ids;
  for (const ModelImage& image : poses.images) {
    contents.images.push_back({image.id, image.name, image.camera_id, {}});
    camera_ids.insert(image.camera_id);
  }
  for (const CameraId id : camera_ids) {
    contents.cameras.push_back(
        {id, CameraModelId::kSimplePinhole, 1, 1, {1.0, 0.5, 0.5}, false});
  }
  AddModelTables(poses, &contents);
  return contents;
}

void ChangeReference(int sensor_idx, NamedModel* model) {
  const Scene& scene = model->scene;
  const int rig_idx = scene.sensors[sensor_idx].rig_idx;
  const std::optional<Rigid3> new_from_old = model->sensor_from_ref[sensor_idx];
  model->ref_sensor[rig_idx] = sensor_idx;
  for (const int other : scene.rigs[rig_idx].sensor_idxs) {
    std::optional<Rigid3>& pose = model->sensor_from_ref[other];
    if (!new_from_old) {
      pose.reset();
    } else if (pose) {
      pose = *pose * new_from_old->Inverse();
    }
  }
  model->sensor_from_ref[sensor_idx] = Rigid3();
}

}  // namespace

std::string FolderOfName(const std::string& image_name) {
  const size_t slash = image_name.rfind('/');
  return slash == std::string::npos ? "" : image_name.substr(0, slash);
}

std::string StemOfName(const std::string& image_name) {
  const std::string file = image_name.substr(image_name.rfind('/') + 1);
  return file.substr(0, file.rfind('.'));
}

bool NamedModel::IsReference(int image_idx) const {
  const int sensor_idx = scene.images[image_idx].sensor_idx;
  return ref_sensor[scene.sensors[sensor_idx].rig_idx] == sensor_idx;
}

std::optional<int> NamedModel::FindSensor(const std::string& folder) const {
  const auto found = sensor_of_folder.find(folder);
  if (found != sensor_of_folder.end()) return found->second;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (scene.sensors[i].name == folder) return static_cast<int>(i);
  }
  return std::nullopt;
}

NamedModel ReadNamedModel(const std::string& path,
                          const std::string& image_prefix,
                          const std::string& reference,
                          const SceneLoadingOptions& naming) {
  PoseModel poses = ReadModelPoses(path);
  if (*naming.rig_name_rule == "auto") CheckModelTables(poses, path);
  KeepPrefix(path, image_prefix, &poses);
  NamedModel model;
  model.scene = LoadScene(ToContents(poses, path), naming, Context()).scene;
  // Scene and model are both sorted by name.
  for (const ModelImage& image : poses.images) {
    model.cam_from_world.push_back(image.cam_from_world);
  }
  for (const Image& image : model.scene.images) {
    model.sensor_of_folder.emplace(FolderOfName(image.name), image.sensor_idx);
  }
  for (const Rig& rig : model.scene.rigs) {
    model.ref_sensor.push_back(rig.ref_sensor_idx);
  }
  for (const Sensor& sensor : model.scene.sensors) {
    model.sensor_from_ref.push_back(sensor.sensor_from_rig);
  }
  if (reference.empty()) return model;
  const std::optional<int> sensor_idx = model.FindSensor(reference);
  if (!sensor_idx) {
    throw Error("no image of the model '" + path + "' is in the folder '" +
                reference + "' that --reference names");
  }
  ChangeReference(*sensor_idx, &model);
  return model;
}

}  // namespace mgsfm
