// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/imaging/undistorted_model.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// An item of the original scene and a view.
using ViewKey = std::pair<int, int>;

struct NamedView {
  std::string name;
  UndistortedModel::Source source;
};

// ------------------------------------------------------------------- names

// The name without '/' and without dots, except for the extension.
std::string FlatName(const std::string& name, int copy) {
  const size_t slash = name.rfind('/');
  const size_t dot = name.rfind('.');
  const bool has_extension =
      dot != std::string::npos && (slash == std::string::npos || dot > slash);
  std::string stem = has_extension ? name.substr(0, dot) : name;
  std::replace(stem.begin(), stem.end(), '/', '_');
  std::replace(stem.begin(), stem.end(), '.', '_');
  if (copy > 0) stem += "_copy" + std::to_string(copy);
  return stem + (has_extension ? name.substr(dot) : "");
}

void FlattenNames(std::vector<NamedView>* views) {
  std::set<std::string> used;
  for (NamedView& view : *views) {
    const auto stem = [](const std::string& name) {
      return name.substr(0, name.find('.'));
    };
    std::string flat = FlatName(view.name, 0);
    for (int copy = 1; !used.insert(stem(flat)).second; ++copy) {
      flat = FlatName(view.name, copy);
    }
    view.name = std::move(flat);
  }
}

// Outputs must not leave their folder.
void CheckName(const std::string& name) {
  if (StaysInFolder(name)) return;
  throw Error("image '" + name +
              "' has a name outside of the folder of images; rename it in the "
              "model");
}

std::vector<NamedView> NameViews(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<std::vector<View>>& views_of_camera, ViewNaming naming) {
  std::vector<NamedView> named;
  for (const int image_idx : Indices(scene.images.size())) {
    const Image& image = scene.images[image_idx];
    if (!reconstruction.IsRegistered(scene, image_idx)) continue;
    CheckName(image.name);
    const std::vector<View>& views = views_of_camera[image.camera_idx];
    for (size_t k = 0; k < views.size(); ++k) {
      named.push_back({NameOfView(image.name, views[k].name),
                       {image_idx, static_cast<int>(k)}});
    }
  }
  if (naming == ViewNaming::kFlat) FlattenNames(&named);
  StableSortBy(&named, &NamedView::name);
  const auto same = std::adjacent_find(
      named.begin(), named.end(),
      [](const NamedView& a, const NamedView& b) { return a.name == b.name; });
  if (same != named.end()) {
    throw Error("undistorted images of '" +
                scene.images[same->source.image_idx].name + "' and '" +
                scene.images[std::next(same)->source.image_idx].name +
                "' would both be named '" + same->name +
                "'; use a layout with flat names, or rename a folder");
  }
  return named;
}

// -------------------------------------------------------------------- scene

std::string NameOfSensor(const std::string& sensor, const std::string& view) {
  return view.empty() || sensor.empty() ? sensor + view : sensor + "_" + view;
}

// Numbers items in the order in which images refer to them.
class SceneMaker {
 public:
  SceneMaker(const Scene& original, const Reconstruction& reconstruction,
             const std::vector<std::vector<View>>& views_of_camera)
      : original_(original),
        reconstruction_(reconstruction),
        views_of_camera_(views_of_camera) {}

  void AddImage(const NamedView& named) {
    Scene& scene = result_.scene;
    const Image& from = original_.images[named.source.image_idx];
    const int image_idx = static_cast<int>(scene.images.size());
    const int sensor_idx = SensorIdx(from.sensor_idx, named.source.view_idx);
    const int frame_idx = FrameIdx(from.frame_idx);
    scene.images.push_back({ImageId(static_cast<uint32_t>(image_idx + 1)),
                            named.name,
                            scene.sensors[sensor_idx].camera_idx,
                            sensor_idx,
                            frame_idx,
                            {},
                            from.timestamp_s});
    scene.frames[frame_idx].image_idxs.push_back(image_idx);
    result_.sources.push_back(named.source);
  }

  UndistortedModel Take() {
    for (const auto& [rig_idx, new_idx] : rigs_) {
      result_.scene.rigs[new_idx].ref_sensor_idx =
          sensors_.at({original_.rigs[rig_idx].ref_sensor_idx, 0});
    }
    result_.reconstruction.cameras = result_.scene.cameras;
    return std::move(result_);
  }

 private:
  int CameraIdx(int camera_idx, int view_idx) {
    const auto [found, is_new] = cameras_.emplace(
        ViewKey(camera_idx, view_idx), static_cast<int>(cameras_.size()));
    if (is_new) {
      Camera camera = views_of_camera_[camera_idx][view_idx].camera;
      camera.id = CameraId(static_cast<uint32_t>(cameras_.size()));
      result_.scene.cameras.push_back(std::move(camera));
    }
    return found->second;
  }

  int RigIdx(int rig_idx) {
    const auto [found, is_new] =
        rigs_.emplace(rig_idx, static_cast<int>(rigs_.size()));
    if (is_new) {
      result_.scene.rigs.push_back({original_.rigs[rig_idx].id, 0, {}});
    }
    return found->second;
  }

  int SensorIdx(int sensor_idx, int view_idx) {
    const auto [found, is_new] = sensors_.emplace(
        ViewKey(sensor_idx, view_idx), static_cast<int>(sensors_.size()));
    if (is_new) {
      const Sensor& from = original_.sensors[sensor_idx];
      const View& view = views_of_camera_[from.camera_idx][view_idx];
      const Rigid3 view_from_rig =
          Rigid3{view.view_from_cam, Eigen::Vector3d::Zero()} *
          *reconstruction_.sensor_from_rig[sensor_idx];
      const int rig_idx = RigIdx(from.rig_idx);
      result_.scene.sensors.push_back(
          {NameOfSensor(from.name, view.name), rig_idx,
           CameraIdx(from.camera_idx, view_idx), view_from_rig});
      result_.scene.rigs[rig_idx].sensor_idxs.push_back(found->second);
      result_.reconstruction.sensor_from_rig.emplace_back(view_from_rig);
    }
    return found->second;
  }

  int FrameIdx(int frame_idx) {
    const auto [found, is_new] =
        frames_.emplace(frame_idx, static_cast<int>(frames_.size()));
    if (is_new) {
      const Frame& from = original_.frames[frame_idx];
      result_.scene.frames.push_back(
          {from.id, from.name, RigIdx(from.rig_idx), {}});
      result_.reconstruction.rig_from_world.push_back(
          reconstruction_.rig_from_world[frame_idx]);
    }
    return found->second;
  }

  const Scene& original_;
  const Reconstruction& reconstruction_;
  const std::vector<std::vector<View>>& views_of_camera_;
  std::map<ViewKey, int> cameras_, sensors_;
  std::map<int, int> rigs_, frames_;
  UndistortedModel result_;
};

// ------------------------------------------------------------- observations

// Per image and keypoint of the original scene.
using MovedKeypoints = std::vector<std::vector<std::optional<ViewPixel>>>;

MovedKeypoints MoveKeypoints(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<std::vector<View>>& views_of_camera,
    const Context& context) {
  MovedKeypoints moved(scene.images.size());
  const auto move = [&](size_t i) {
    context.CheckInterrupted();
    const Image& image = scene.images[i];
    if (!reconstruction.IsRegistered(scene, static_cast<int>(i))) return;
    moved[i] = Transformed(
        image.keypoints_px, [&](const Eigen::Vector2f& keypoint_px) {
          return FindInViews(reconstruction.cameras[image.camera_idx],
                             views_of_camera[image.camera_idx],
                             keypoint_px.cast<double>());
        });
  };
  ParallelFor(scene.images.size(), context.num_threads, move, 1);
  return moved;
}

// Adds the keypoints to the images of the result. Returns the new observation
// of each, if any.
std::vector<std::vector<std::optional<Observation>>> PlaceKeypoints(
    const MovedKeypoints& moved, UndistortedModel* result) {
  std::map<ViewKey, int> image_of_view;
  for (size_t i = 0; i < result->sources.size(); ++i) {
    const UndistortedModel::Source& source = result->sources[i];
    image_of_view[{source.image_idx, source.view_idx}] = static_cast<int>(i);
  }
  std::vector<std::vector<std::optional<Observation>>> placed(moved.size());
  for (size_t i = 0; i < moved.size(); ++i) {
    placed[i].resize(moved[i].size());
    for (size_t k = 0; k < moved[i].size(); ++k) {
      if (!moved[i][k]) continue;
      const int image_idx =
          image_of_view.at({static_cast<int>(i), moved[i][k]->view_idx});
      auto& keypoints_px = result->scene.images[image_idx].keypoints_px;
      placed[i][k] =
          Observation{image_idx, static_cast<int>(keypoints_px.size())};
      keypoints_px.emplace_back(moved[i][k]->pixel.cast<float>());
    }
  }
  return placed;
}

std::optional<double> MeanError(const UndistortedModel& model,
                                const Point3D& point) {
  double sum_px = 0.0;
  for (const Observation& o : point.track) {
    const Image& image = model.scene.images[o.image_idx];
    const Camera& camera = model.scene.cameras[image.camera_idx];
    const Rigid3 cam_from_world =
        *model.reconstruction.CamFromWorld(model.scene, o.image_idx);
    const auto pixel =
        ProjectToPixel(camera, cam_from_world * point.point_in_world);
    if (!pixel) return std::nullopt;
    sum_px +=
        (*pixel - image.keypoints_px[o.keypoint_idx].cast<double>()).norm();
  }
  return sum_px / static_cast<double>(point.track.size());
}

}  // namespace

std::string NameOfView(const std::string& image_name,
                       const std::string& view_name) {
  if (view_name.empty()) return image_name;
  const size_t slash = image_name.rfind('/');
  if (slash == std::string::npos) return view_name + "/" + image_name;
  return image_name.substr(0, slash) + "_" + view_name +
         image_name.substr(slash);
}

UndistortedModel UndistortModel(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<std::vector<View>>& views_of_camera, ViewNaming naming,
    const Context& context) {
  SceneMaker maker(scene, reconstruction, views_of_camera);
  for (const NamedView& named :
       NameViews(scene, reconstruction, views_of_camera, naming)) {
    maker.AddImage(named);
  }
  UndistortedModel result = maker.Take();
  const auto placed = PlaceKeypoints(
      MoveKeypoints(scene, reconstruction, views_of_camera, context), &result);
  for (const Point3D& from : reconstruction.points) {
    Point3D point{from.point_in_world, from.color, std::nullopt, {}};
    for (const Observation& o : from.track) {
      if (placed[o.image_idx].empty()) continue;  // not registered
      const auto& observation = placed[o.image_idx][o.keypoint_idx];
      if (observation) point.track.push_back(*observation);
    }
    if (point.track.size() < 2) continue;
    std::sort(point.track.begin(), point.track.end());
    point.error_px = MeanError(result, point);
    result.reconstruction.points.push_back(std::move(point));
  }
  return result;
}

}  // namespace mgsfm
