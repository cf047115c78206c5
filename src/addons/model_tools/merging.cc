// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/model_tools/model_tools.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

// Per item of the second model, the same item of the first; nullopt for items
// that only the second model has.
struct ModelUnion {
  std::vector<std::optional<int>> first_image;   // per image of the second
  std::vector<std::optional<int>> first_sensor;  // per sensor
  std::vector<std::optional<int>> first_rig;     // per rig
  std::vector<std::optional<int>> first_frame;   // per frame
};

// Keypoints of one image in two models differ by rounding, others by more.
constexpr double kMaxKeypointDistancePx = 1.0;

// Throws Error if rigs, frames, cameras or keypoints contradict each other.
class UnionFinder {
 public:
  UnionFinder(const Scene& first, const Scene& second)
      : first_(first), second_(second) {
    union_.first_image.resize(second.images.size());
    union_.first_sensor.resize(second.sensors.size());
    union_.first_rig.resize(second.rigs.size());
    union_.first_frame.resize(second.frames.size());
  }

  ModelUnion Run() {
    FindImages();
    FindRigsByName();
    FindSensorsByName();
    FindFramesByName();
    CheckFrames();
    return std::move(union_);
  }

 private:
  void FindImages() {
    const auto image_of_name = IndexByName(first_.images);
    for (size_t i = 0; i < second_.images.size(); ++i) {
      const Image& b = second_.images[i];
      const auto found = image_of_name.find(b.name);
      if (found == image_of_name.end()) continue;
      const Image& a = first_.images[found->second];
      CheckImage(a, b);
      union_.first_image[i] = found->second;
      const std::string remedy =
          "; give both models the same rigs (rig_name_rule or rig_config_path)";
      Assign(a.sensor_idx,
             "images of camera '" + second_.sensors[b.sensor_idx].name +
                 "', such as '" + b.name +
                 "', are of several cameras in the first model" + remedy,
             &union_.first_sensor[b.sensor_idx]);
      Assign(first_.sensors[a.sensor_idx].rig_idx,
             "the rig of image '" + b.name +
                 "' is several rigs in the first model" + remedy,
             &union_.first_rig[second_.sensors[b.sensor_idx].rig_idx]);
      Assign(a.frame_idx,
             "the frame of image '" + b.name +
                 "' is several frames in the first model" + remedy,
             &union_.first_frame[b.frame_idx]);
    }
  }

  // Rigs without common images are the same if their sensors have the same
  // names.
  void FindRigsByName() {
    std::map<std::set<std::string>, std::vector<int>> rigs_of_names;
    for (size_t i = 0; i < first_.rigs.size(); ++i) {
      rigs_of_names[SensorNames(first_, first_.rigs[i])].push_back(
          static_cast<int>(i));
    }
    for (size_t i = 0; i < second_.rigs.size(); ++i) {
      if (union_.first_rig[i]) continue;
      const auto found =
          rigs_of_names.find(SensorNames(second_, second_.rigs[i]));
      if (found == rigs_of_names.end() || found->second.size() > 1) continue;
      union_.first_rig[i] = found->second.front();
    }
  }

  void FindSensorsByName() {
    for (size_t i = 0; i < second_.sensors.size(); ++i) {
      const Sensor& sensor = second_.sensors[i];
      const auto rig = union_.first_rig[sensor.rig_idx];
      if (union_.first_sensor[i] || !rig) continue;
      for (const int sensor_idx : first_.rigs[*rig].sensor_idxs) {
        if (first_.sensors[sensor_idx].name == sensor.name) {
          union_.first_sensor[i] = sensor_idx;
        }
      }
    }
  }

  void FindFramesByName() {
    std::map<std::pair<int, std::string>, int> frame_of_name;
    for (size_t i = 0; i < first_.frames.size(); ++i) {
      frame_of_name[{first_.frames[i].rig_idx, first_.frames[i].name}] =
          static_cast<int>(i);
    }
    for (size_t i = 0; i < second_.frames.size(); ++i) {
      const Frame& frame = second_.frames[i];
      const auto rig = union_.first_rig[frame.rig_idx];
      if (union_.first_frame[i] || !rig) continue;
      const auto found = frame_of_name.find({*rig, frame.name});
      if (found != frame_of_name.end()) union_.first_frame[i] = found->second;
    }
  }

  // A frame has at most one image of a sensor.
  void CheckFrames() const {
    std::map<std::pair<int, int>, int> image_of_place;
    for (size_t i = 0; i < first_.images.size(); ++i) {
      const Image& image = first_.images[i];
      image_of_place[{image.frame_idx, image.sensor_idx}] = static_cast<int>(i);
    }
    for (size_t i = 0; i < second_.images.size(); ++i) {
      const Image& image = second_.images[i];
      const auto frame = union_.first_frame[image.frame_idx];
      const auto sensor = union_.first_sensor[image.sensor_idx];
      if (union_.first_image[i] || !frame || !sensor) continue;
      const auto found = image_of_place.find({*frame, *sensor});
      if (found == image_of_place.end()) continue;
      throw Error("images '" + first_.images[found->second].name + "' and '" +
                  image.name +
                  "' have the same camera and frame; rename the images of one "
                  "model");
    }
  }

  void CheckImage(const Image& a, const Image& b) const {
    const Camera& camera_a =
        first_.cameras[first_.sensors[a.sensor_idx].camera_idx];
    const Camera& camera_b =
        second_.cameras[second_.sensors[b.sensor_idx].camera_idx];
    if (camera_a.model != camera_b.model ||
        camera_a.width_px != camera_b.width_px ||
        camera_a.height_px != camera_b.height_px) {
      throw Error(
          "image '" + a.name +
          "' has another camera model or size in the second model; merge "
          "models of the same images");
    }
    bool is_same = a.keypoints_px.size() == b.keypoints_px.size();
    for (size_t i = 0; is_same && i < a.keypoints_px.size(); ++i) {
      is_same = (a.keypoints_px[i] - b.keypoints_px[i]).norm() <=
                kMaxKeypointDistancePx;
    }
    if (!is_same) {
      throw Error("image '" + a.name +
                  "' has other keypoints in the second model; merge models of "
                  "one database");
    }
  }

  static std::set<std::string> SensorNames(const Scene& scene, const Rig& rig) {
    std::set<std::string> names;
    for (const int sensor_idx : rig.sensor_idxs) {
      names.insert(scene.sensors[sensor_idx].name);
    }
    return names;
  }

  static void Assign(int first, const std::string& problem,
                     std::optional<int>* place) {
    if (place->value_or(first) != first) throw Error(problem);
    *place = first;
  }

  const Scene& first_;
  const Scene& second_;
  ModelUnion union_;
};

// Two calibrations of one rig differ by noise, far below this.
constexpr double kMaxSensorRotationDeg = 5.0;

// Assigns unused ids: the requested one if possible.
template <class Id>
class FreeIds {
 public:
  template <class Items>
  explicit FreeIds(const Items& items) {
    for (const auto& item : items) taken_.insert(item.id.value());
  }
  Id Take(Id wanted) {
    if (taken_.insert(wanted.value()).second) return wanted;
    const uint32_t id = *taken_.rbegin() + 1;
    taken_.insert(id);
    return Id(id);
  }

 private:
  std::set<uint32_t> taken_;
};

// Adds the rigs of the second model, with their sensors and cameras, to the
// first.
class RigMerger {
 public:
  // All arguments must outlive this object.
  RigMerger(const SceneModel& second, SceneModel* first, ModelUnion* common)
      : union_(common),
        a_(&first->scene),
        b_(second.scene),
        in_a_(&first->reconstruction),
        in_b_(second.reconstruction) {}

  void Merge() {
    for (size_t i = 0; i < b_.rigs.size(); ++i) {
      const int rig_idx = static_cast<int>(i);
      if (union_->first_rig[i]) {
        AddSensors(rig_idx);
      } else {
        AddRig(rig_idx);
      }
    }
  }

 private:
  void AddRig(int rig_idx) {
    const Rig& rig = b_.rigs[rig_idx];
    union_->first_rig[rig_idx] = static_cast<int>(a_->rigs.size());
    a_->rigs.push_back({FreeIds<RigId>(a_->rigs).Take(rig.id), 0, {}});
    for (const int sensor_idx : rig.sensor_idxs) {
      AddSensor(sensor_idx, in_b_.sensor_from_rig[sensor_idx],
                b_.sensors[sensor_idx].sensor_from_rig.has_value());
    }
    const int ref_sensor_idx = *union_->first_sensor[rig.ref_sensor_idx];
    a_->rigs.back().ref_sensor_idx = ref_sensor_idx;
    a_->sensors[ref_sensor_idx].sensor_from_rig = Rigid3();
  }

  int AddCamera(int camera_idx) {
    const auto [known, is_new] = camera_of_second_.emplace(
        camera_idx, static_cast<int>(a_->cameras.size()));
    if (!is_new) return known->second;
    Camera camera = in_b_.cameras[camera_idx];
    camera.id = FreeIds<CameraId>(a_->cameras).Take(camera.id);
    a_->cameras.push_back(camera);
    in_a_->cameras.push_back(camera);
    return known->second;
  }

  // Relates the sensors of a common rig to one that is posed in both models.
  void AddSensors(int rig_idx) {
    const std::vector<int>& sensor_idxs = b_.rigs[rig_idx].sensor_idxs;
    const auto common = std::find_if(
        sensor_idxs.begin(), sensor_idxs.end(), [&](int sensor_idx) {
          const auto first = union_->first_sensor[sensor_idx];
          return first && in_a_->sensor_from_rig[*first] &&
                 in_b_.sensor_from_rig[sensor_idx];
        });
    if (common == sensor_idxs.end()) {
      throw Error(
          "no camera of the rig of '" +
          b_.sensors[b_.rigs[rig_idx].ref_sensor_idx].name +
          "' has a pose in both models; merge models that share a camera");
    }
    const Rigid3 rig_a_from_rig_b =
        in_a_->sensor_from_rig[*union_->first_sensor[*common]]->Inverse() *
        *in_b_.sensor_from_rig[*common];
    const bool common_is_known =
        b_.sensors[*common].sensor_from_rig.has_value() &&
        a_->sensors[*union_->first_sensor[*common]].sensor_from_rig.has_value();
    for (const int sensor_idx : sensor_idxs) {
      const std::optional<Rigid3>& in_b = in_b_.sensor_from_rig[sensor_idx];
      std::optional<Rigid3> pose;
      if (in_b) pose = *in_b * rig_a_from_rig_b.Inverse();
      const auto first = union_->first_sensor[sensor_idx];
      if (!first) {
        AddSensor(sensor_idx, pose,
                  common_is_known &&
                      b_.sensors[sensor_idx].sensor_from_rig.has_value());
      } else if (!in_a_->sensor_from_rig[*first]) {
        in_a_->sensor_from_rig[*first] = pose;
      } else {
        CheckSensor(sensor_idx, *common);
      }
    }
  }

  // A pose that is known in the second model stays known.
  void AddSensor(int sensor_idx, const std::optional<Rigid3>& pose,
                 bool is_known) {
    Sensor sensor = b_.sensors[sensor_idx];
    const auto new_idx = static_cast<int>(a_->sensors.size());
    const int rig_idx = *union_->first_rig[sensor.rig_idx];
    sensor.rig_idx = rig_idx;
    sensor.camera_idx = AddCamera(sensor.camera_idx);
    sensor.sensor_from_rig = is_known ? pose : std::nullopt;
    a_->rigs[rig_idx].sensor_idxs.push_back(new_idx);
    a_->sensors.push_back(sensor);
    in_a_->sensor_from_rig.push_back(pose);
    union_->first_sensor[sensor_idx] = new_idx;
  }

  void CheckSensor(int sensor_idx, int common_idx) const {
    const int first = *union_->first_sensor[sensor_idx];
    const int first_common = *union_->first_sensor[common_idx];
    if (!in_a_->sensor_from_rig[first] || !in_b_.sensor_from_rig[sensor_idx]) {
      return;
    }
    const Rigid3 in_a = *in_a_->sensor_from_rig[first] *
                        in_a_->sensor_from_rig[first_common]->Inverse();
    const Rigid3 in_b = *in_b_.sensor_from_rig[sensor_idx] *
                        in_b_.sensor_from_rig[common_idx]->Inverse();
    if (RadToDeg(AngleBetween(in_a.rotation, in_b.rotation)) <=
        kMaxSensorRotationDeg) {
      return;
    }
    throw Error(
        "the rotation between cameras '" + b_.sensors[sensor_idx].name +
        "' and '" + b_.sensors[common_idx].name +
        "' differs between the models by more than 5 degrees; if the rig "
        "has changed, give the images of one model other folders");
  }

  ModelUnion* union_;
  Scene* a_;
  const Scene& b_;
  Reconstruction* in_a_;
  const Reconstruction& in_b_;
  std::map<int, int> camera_of_second_;
};

class ModelMerger {
 public:
  ModelMerger(SceneModel* second, SceneModel* first)
      : union_(UnionFinder(first->scene, second->scene).Run()),
        a_(first->scene),
        b_(second->scene),
        in_a_(first->reconstruction),
        in_b_(second->reconstruction),
        first_(first),
        second_(second) {}

  MergeSummary Run(const MergeOptions& options) {
    if (options.first_from_second) {
      summary_.first_from_second = *options.first_from_second;
      TransformWorld(summary_.first_from_second, &in_b_);
    } else {
      Align(options.min_common_images);
    }
    AddRigsOrNone();
    AddFrames();
    AddImages();
    AddPoints();
    RemoveLargeErrors(options.max_reproj_error_px, first_);
    CheckConsistent(a_);
    return summary_;
  }

 private:
  std::vector<ImagePoses> CommonPoses() {
    std::vector<ImagePoses> poses;
    for (size_t i = 0; i < b_.frames.size(); ++i) {
      const auto frame = union_.first_frame[i];
      if (!frame) continue;
      ++summary_.num_common_frames;
      for (const int sensor_idx : b_.rigs[b_.frames[i].rig_idx].sensor_idxs) {
        const auto sensor = union_.first_sensor[sensor_idx];
        if (!sensor || !in_a_.sensor_from_rig[*sensor] ||
            !in_b_.sensor_from_rig[sensor_idx] ||
            !in_a_.rig_from_world[*frame] || !in_b_.rig_from_world[i]) {
          continue;
        }
        poses.push_back(
            {b_.frames[i].name, b_.IsReference(sensor_idx),
             *in_b_.sensor_from_rig[sensor_idx] * *in_b_.rig_from_world[i],
             *in_a_.sensor_from_rig[*sensor] * *in_a_.rig_from_world[*frame]});
      }
    }
    return poses;
  }

  void Align(int min_common_images) {
    const std::vector<ImagePoses> common = CommonPoses();
    summary_.num_common_images = static_cast<int>(common.size());
    if (summary_.num_common_images < min_common_images) {
      throw Error("the models have " + std::to_string(common.size()) +
                  " images in common, but " +
                  std::to_string(min_common_images) +
                  " are needed; merge models that overlap");
    }
    summary_.first_from_second = *AlignPoses(common);
    const ImageAgreement agreement =
        CompareCenters(common, summary_.first_from_second, in_a_);
    summary_.median_distance = Median(agreement.distances);
    const auto num_common = static_cast<double>(common.size());
    if (agreement.num_agreeing < min_common_images ||
        agreement.num_agreeing < kMinAgreeingShare * num_common) {
      throw Error(
          "the models differ in shape: after alignment, only " +
          std::to_string(agreement.num_agreeing) + " of " +
          std::to_string(common.size()) +
          " common images are within a tenth of the extent of the first "
          "model; merge models of the same images");
    }
    TransformWorld(summary_.first_from_second, &in_b_);
  }

  // Leaves the first model unchanged if a rig contradicts it.
  void AddRigsOrNone() {
    const std::tuple before(a_.rigs, a_.sensors, a_.cameras, in_a_.cameras,
                            in_a_.sensor_from_rig);
    try {
      RigMerger(*second_, first_, &union_).Merge();
    } catch (...) {
      std::tie(a_.rigs, a_.sensors, a_.cameras, in_a_.cameras,
               in_a_.sensor_from_rig) = before;
      throw;
    }
  }

  // The pose of a frame is computed from its image of the reference sensor, or
  // else from its first image.
  void AddFrames() {
    FreeIds<FrameId> ids(a_.frames);
    for (size_t i = 0; i < b_.frames.size(); ++i) {
      if (union_.first_frame[i]) continue;
      const Frame& frame = b_.frames[i];
      const int rig_idx = *union_.first_rig[frame.rig_idx];
      std::optional<Rigid3> rig_from_world;
      for (const int image_idx : frame.image_idxs) {
        const int sensor_idx =
            *union_.first_sensor[b_.images[image_idx].sensor_idx];
        const auto pose = in_b_.CamFromWorld(b_, image_idx);
        const bool is_reference = a_.rigs[rig_idx].ref_sensor_idx == sensor_idx;
        if (!pose || (rig_from_world && !is_reference)) continue;
        rig_from_world = in_a_.sensor_from_rig[sensor_idx]->Inverse() * *pose;
      }
      union_.first_frame[i] = static_cast<int>(a_.frames.size());
      a_.frames.push_back({ids.Take(frame.id), frame.name, rig_idx, {}});
      in_a_.rig_from_world.push_back(rig_from_world);
    }
  }

  void AddImages() {
    FreeIds<ImageId> ids(a_.images);
    is_common_.assign(a_.images.size(), false);
    for (size_t i = 0; i < b_.images.size(); ++i) {
      if (union_.first_image[i]) {
        is_common_[*union_.first_image[i]] = true;
        continue;
      }
      Image image = b_.images[i];
      image.id = ids.Take(image.id);
      image.sensor_idx = *union_.first_sensor[image.sensor_idx];
      image.camera_idx = a_.sensors[image.sensor_idx].camera_idx;
      image.frame_idx = *union_.first_frame[image.frame_idx];
      const auto new_idx = static_cast<int>(a_.images.size());
      union_.first_image[i] = new_idx;
      a_.frames[image.frame_idx].image_idxs.push_back(new_idx);
      a_.images.push_back(std::move(image));
      is_common_.push_back(false);
      ++summary_.num_new_images;
    }
  }

  void AddPoints() {
    std::map<Observation, size_t> point_of;
    for (size_t i = 0; i < in_a_.points.size(); ++i) {
      for (const Observation& o : in_a_.points[i].track) {
        if (is_common_[o.image_idx]) point_of.emplace(o, i);
      }
    }
    for (Point3D& point : in_b_.points) AddPoint(std::move(point), &point_of);
  }

  void AddPoint(Point3D point, std::map<Observation, size_t>* point_of) {
    std::set<size_t> same;
    for (Observation& o : point.track) {
      o.image_idx = *union_.first_image[o.image_idx];
      const auto found = point_of->find(o);
      if (found != point_of->end()) same.insert(found->second);
    }
    if (same.size() > 1) {
      ++summary_.num_dropped_points;
      return;
    }
    if (same.empty()) {
      std::sort(point.track.begin(), point.track.end());
      for (const Observation& o : point.track) {
        if (is_common_[o.image_idx]) point_of->emplace(o, in_a_.points.size());
      }
      in_a_.points.push_back(std::move(point));
      return;
    }
    ++summary_.num_merged_points;
    std::vector<Observation>& track = in_a_.points[*same.begin()].track;
    for (const Observation& o : point.track) {
      const bool is_new = !is_common_[o.image_idx] ||
                          point_of->emplace(o, *same.begin()).second;
      if (is_new) track.push_back(o);
    }
    std::sort(track.begin(), track.end());
  }

  ModelUnion union_;
  Scene& a_;
  Scene& b_;
  Reconstruction& in_a_;
  Reconstruction& in_b_;
  SceneModel* first_;
  const SceneModel* second_;
  Mask is_common_;  // per image of the result: both models have it
  MergeSummary summary_;
};

}  // namespace

MergeSummary MergeModels(SceneModel second, const MergeOptions& options,
                         SceneModel* first) {
  return ModelMerger(&second, first).Run(options);
}

}  // namespace mgsfm
