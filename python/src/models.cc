// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"
#include "bindings.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;

// COLMAP's id of no point.
constexpr uint64_t kNoPoint = std::numeric_limits<uint64_t>::max();

// ------------------------------------------------------------------ reading

py::list CamerasToPython(const std::vector<Camera>& cameras) {
  py::list list;
  for (const Camera& camera : cameras) {
    const CameraModelInfo& info = InfoOf(camera.model);
    list.append(py::make_tuple(camera.id.value(), info.name, camera.width_px,
                               camera.height_px, MakeArray(camera.params)));
  }
  return list;
}

py::list RigsToPython(const std::vector<RigRow>& rigs) {
  py::list list;
  for (const RigRow& rig : rigs) {
    py::list sensors;
    for (const RigSensorRow& sensor : rig.sensors) {
      sensors.append(py::make_tuple(sensor.camera_id.value(),
                                    rig.ref_camera_id == sensor.camera_id,
                                    ToArrayOrNone(sensor.sensor_from_rig)));
    }
    list.append(py::make_tuple(rig.id.value(), sensors));
  }
  return list;
}

py::list FramesToPython(const std::vector<ModelFrame>& frames) {
  py::list list;
  for (const ModelFrame& frame : frames) {
    py::list images;
    for (const ImageId id : frame.image_ids) images.append(id.value());
    list.append(py::make_tuple(frame.id.value(), frame.rig_id.value(),
                               ToArray(frame.rig_from_world), images));
  }
  return list;
}

void AddImages(const Model& model, py::dict* result) {
  py::list names;
  std::vector<uint32_t> ids, camera_ids;
  std::vector<double> poses, positions_px;
  std::vector<uint64_t> point_ids;
  std::vector<int64_t> offsets = {0};
  for (const ModelImage& image : model.poses.images) {
    names.append(image.name);
    ids.push_back(image.id.value());
    camera_ids.push_back(image.camera_id.value());
    Append(image.cam_from_world, &poses);
  }
  for (const std::vector<ModelKeypoint>& keypoints : model.keypoints) {
    for (const ModelKeypoint& keypoint : keypoints) {
      positions_px.push_back(keypoint.position_px[0]);
      positions_px.push_back(keypoint.position_px[1]);
      point_ids.push_back(keypoint.point_id.value_or(kNoPoint));
    }
    offsets.push_back(static_cast<int64_t>(point_ids.size()));
  }
  (*result)["image_names"] = names;
  (*result)["image_ids"] = MakeArray(std::move(ids));
  (*result)["image_camera_ids"] = MakeArray(std::move(camera_ids));
  (*result)["cam_from_world"] = MakeArray(std::move(poses), 7);
  (*result)["keypoints_px"] = MakeArray(std::move(positions_px), 2);
  (*result)["keypoint_point_ids"] = MakeArray(std::move(point_ids));
  (*result)["keypoint_offsets"] = MakeArray(std::move(offsets));
}

void AddPoints(const std::vector<ModelPoint>& points, py::dict* result) {
  std::vector<uint64_t> ids;
  std::vector<double> xyz, errors_px;
  std::vector<uint8_t> rgb;
  std::vector<uint32_t> track;
  std::vector<int64_t> offsets = {0};
  for (const ModelPoint& point : points) {
    ids.push_back(point.id);
    Append(point.point_in_world, &xyz);
    rgb.insert(rgb.end(), point.color.data(), point.color.data() + 3);
    errors_px.push_back(point.error_px.value_or(-1.0));  // as in COLMAP's files
    for (const ModelObservation& observation : point.track) {
      track.push_back(observation.image_id.value());
      track.push_back(observation.keypoint_idx);
    }
    offsets.push_back(static_cast<int64_t>(track.size() / 2));
  }
  (*result)["point_ids"] = MakeArray(std::move(ids));
  (*result)["xyz"] = MakeArray(std::move(xyz), 3);
  (*result)["rgb"] = MakeArray(std::move(rgb), 3);
  (*result)["errors_px"] = MakeArray(std::move(errors_px));
  (*result)["track_elements"] = MakeArray(std::move(track), 2);
  (*result)["track_offsets"] = MakeArray(std::move(offsets));
}

py::dict ReadModelArrays(const std::filesystem::path& folder) {
  const Model model = [&] {
    const py::gil_scoped_release release;
    return ReadModel(folder);
  }();
  py::dict result;
  result["cameras"] = CamerasToPython(model.cameras);
  result["rigs"] = RigsToPython(model.poses.rigs);
  result["frames"] = FramesToPython(model.poses.frames);
  AddImages(model, &result);
  AddPoints(model.points, &result);
  return result;
}

// ------------------------------------------------------------------ writing

// A scene with its model, and the indices of ids in it.
struct IndexedModel {
  Scene scene;
  Reconstruction reconstruction;
  std::map<uint32_t, int> camera_idx, rig_idx, frame_of_image, image_idx;
};

int IndexOf(const std::map<uint32_t, int>& indices, uint32_t id,
            const std::string& kind) {
  const auto found = indices.find(id);
  if (found == indices.end()) {
    throw Error("the model refers to " + kind + " " + std::to_string(id) +
                ", which it lacks");
  }
  return found->second;
}

void AddCameras(const py::dict& arrays, IndexedModel* model) {
  using Row = std::tuple<uint32_t, std::string, int, int, std::vector<double>>;
  for (const py::handle item : arrays["cameras"]) {
    const auto [id, name, width_px, height_px, params] = py::cast<Row>(item);
    const CameraModelInfo* info = FindCameraModel(std::string_view(name));
    if (info == nullptr) throw Error("unknown camera model '" + name + "'");
    if (params.size() != static_cast<size_t>(info->num_params)) {
      throw Error("camera " + std::to_string(id) + " needs " +
                  std::to_string(info->num_params) + " parameters");
    }
    model->camera_idx[id] = static_cast<int>(model->scene.cameras.size());
    model->scene.cameras.push_back(
        {CameraId(id), info->id, width_px, height_px, params});
  }
  model->reconstruction.cameras = model->scene.cameras;
}

void AddRigs(const py::dict& arrays, IndexedModel* model) {
  Scene& scene = model->scene;
  for (const py::handle item : arrays["rigs"]) {
    const auto [id, sensors] = py::cast<std::pair<uint32_t, py::list>>(item);
    const auto rig_idx = static_cast<int>(scene.rigs.size());
    model->rig_idx[id] = rig_idx;
    Rig rig{RigId(id), 0, {}};
    for (const py::handle sensor : sensors) {
      const auto [camera_id, is_reference, pose] =
          py::cast<std::tuple<uint32_t, bool, py::object>>(sensor);
      const auto sensor_idx = static_cast<int>(scene.sensors.size());
      if (is_reference) rig.ref_sensor_idx = sensor_idx;
      rig.sensor_idxs.push_back(sensor_idx);
      scene.sensors.push_back(
          {"", rig_idx, IndexOf(model->camera_idx, camera_id, "camera"), {}});
      model->reconstruction.sensor_from_rig.push_back(ReadOptionalPose(pose));
    }
    scene.rigs.push_back(std::move(rig));
  }
}

void AddFrames(const py::dict& arrays, IndexedModel* model) {
  Scene& scene = model->scene;
  for (const py::handle item : arrays["frames"]) {
    const auto [id, rig_id, pose, image_ids] = py::cast<
        std::tuple<uint32_t, uint32_t, py::object, std::vector<uint32_t>>>(
        item);
    for (const uint32_t image_id : image_ids) {
      model->frame_of_image[image_id] = static_cast<int>(scene.frames.size());
    }
    scene.frames.push_back({FrameId(id),
                            std::to_string(id),
                            IndexOf(model->rig_idx, rig_id, "rig"),
                            {}});
    model->reconstruction.rig_from_world.push_back(ReadOptionalPose(pose));
  }
}

// The sensor of a rig with a camera.
int FindSensor(const Scene& scene, int rig_idx, int camera_idx,
               const std::string& image_name) {
  for (const int sensor_idx : scene.rigs[rig_idx].sensor_idxs) {
    if (scene.sensors[sensor_idx].camera_idx == camera_idx) return sensor_idx;
  }
  throw Error("the rig of image '" + image_name + "' lacks its camera");
}

void AddImages(const py::dict& arrays, IndexedModel* model) {
  Scene& scene = model->scene;
  const auto names = py::cast<std::vector<std::string>>(arrays["image_names"]);
  const auto num_images = static_cast<py::ssize_t>(names.size());
  const auto ids = GetArray<uint32_t>(arrays, "image_ids", num_images);
  const auto camera_ids =
      GetArray<uint32_t>(arrays, "image_camera_ids", num_images);
  const auto offsets =
      GetArray<int64_t>(arrays, "keypoint_offsets", num_images + 1);
  const auto keypoints_px =
      GetArray<double>(arrays, "keypoints_px", offsets.at(num_images), 2);
  for (py::ssize_t i = 0; i < num_images; ++i) {
    const uint32_t id = ids.at(i);
    Image image{ImageId(id), names[i], 0, 0, 0, {}};
    image.camera_idx = IndexOf(model->camera_idx, camera_ids.at(i), "camera");
    image.frame_idx = IndexOf(model->frame_of_image, id, "a frame of image");
    image.sensor_idx = FindSensor(scene, scene.frames[image.frame_idx].rig_idx,
                                  image.camera_idx, image.name);
    for (int64_t k = offsets.at(i); k < offsets.at(i + 1); ++k) {
      image.keypoints_px.emplace_back(
          static_cast<float>(keypoints_px.at(k, 0)),
          static_cast<float>(keypoints_px.at(k, 1)));
    }
    const auto image_idx = static_cast<int>(scene.images.size());
    model->image_idx[id] = image_idx;
    scene.frames[image.frame_idx].image_idxs.push_back(image_idx);
    scene.images.push_back(std::move(image));
  }
}

Observation ReadObservation(const IndexedModel& model, uint32_t image_id,
                            uint32_t keypoint_idx) {
  const int image_idx = IndexOf(model.image_idx, image_id, "image");
  const Image& image = model.scene.images[image_idx];
  if (keypoint_idx >= image.keypoints_px.size()) {
    throw Error("image '" + image.name + "' has no keypoint " +
                std::to_string(keypoint_idx));
  }
  if (!model.reconstruction.IsRegistered(model.scene, image_idx)) {
    throw Error("image '" + image.name +
                "' observes points without a pose; call deregister_frame, or "
                "set the poses of its frame and sensor");
  }
  return {image_idx, static_cast<int>(keypoint_idx)};
}

void AddPoints(const py::dict& arrays, IndexedModel* model) {
  const auto xyz = GetArray<double>(arrays, "xyz", -1, 3);
  const py::ssize_t num_points = xyz.shape(0);
  const auto rgb = GetArray<uint8_t>(arrays, "rgb", num_points, 3);
  const auto errors_px = GetArray<double>(arrays, "errors_px", num_points);
  const auto offsets =
      GetArray<int64_t>(arrays, "track_offsets", num_points + 1);
  const auto track =
      GetArray<uint32_t>(arrays, "track_elements", offsets.at(num_points), 2);
  for (py::ssize_t i = 0; i < num_points; ++i) {
    Point3D point;
    for (int k = 0; k < 3; ++k) {
      point.point_in_world[k] = xyz.at(i, k);
      point.color[k] = rgb.at(i, k);
    }
    if (errors_px.at(i) >= 0.0) point.error_px = errors_px.at(i);
    for (int64_t k = offsets.at(i); k < offsets.at(i + 1); ++k) {
      point.track.push_back(
          ReadObservation(*model, track.at(k, 0), track.at(k, 1)));
    }
    model->reconstruction.points.push_back(std::move(point));
  }
}

void WriteModelArrays(const std::filesystem::path& folder,
                      const py::dict& arrays, const std::string& format) {
  IndexedModel model;
  AddCameras(arrays, &model);
  AddRigs(arrays, &model);
  AddFrames(arrays, &model);
  AddImages(arrays, &model);
  AddPoints(arrays, &model);
  const auto model_format = EnumValue<ModelFormat>(format);
  const py::gil_scoped_release release;
  std::filesystem::create_directories(folder);
  WriteModel(folder, model.scene, model.reconstruction, model_format);
}

}  // namespace

void BindModels(py::module_* module) {
  module->def("read_model", &ReadModelArrays, py::arg("folder"));
  module->def("write_model", &WriteModelArrays, py::arg("folder"),
              py::arg("arrays"), py::arg("format"));
}

}  // namespace mgsfm::python
