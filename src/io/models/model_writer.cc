// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <iomanip>
#include <locale>
#include <string>
#include <vector>

#include "base/ranges.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/models/model_io.h"
#include "models/model_file.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

constexpr double kNoError = -1.0;  // in the file format of COLMAP

// One file of a model. Numbers are little-endian, as on every machine that
// Debian's COLMAP runs on.
class ModelFile {
 public:
  ModelFile(const std::filesystem::path& folder, const std::string& name,
            ModelFormat format)
      : is_text_(format == ModelFormat::kText),
        path_(ModelFilePath(folder, name, format)) {
    errno = 0;  // for Close()
    stream_.open(path_, std::ios::binary | std::ios::trunc);
    stream_.imbue(std::locale::classic());
    stream_ << std::setprecision(17);
  }

  bool is_text() const { return is_text_; }

  void Close() {
    stream_.close();
    if (!stream_) ThrowWriteError(path_);
  }

  // Writes a number with the binary type T; text uses spaces as separators.
  template <class T>
  void Write(T value) {
    if (is_text_) {
      Separate();
      stream_ << +value;
    } else {
      stream_.write(reinterpret_cast<const char*>(&value), sizeof(value));
    }
  }
  void WriteWord(const std::string& word) {
    Separate();
    stream_ << word;
  }
  void WriteName(const std::string& name) {
    if (is_text_) {
      WriteWord(name);
    } else {
      stream_.write(name.c_str(),
                    static_cast<std::streamsize>(name.size()) + 1);
    }
  }
  // Binary files begin with a count, and each list is preceded by one.
  void WriteCount(uint64_t count) {
    if (!is_text_) Write<uint64_t>(count);
  }
  void WriteSensorType() {
    if (is_text_) {
      WriteWord("CAMERA");
    } else {
      Write<int32_t>(kModelCameraType);
    }
  }
  void WritePose(const Rigid3& pose) {
    const Eigen::Quaterniond& q = pose.rotation;
    for (const double value : {q.w(), q.x(), q.y(), q.z()}) Write(value);
    for (const double value : pose.translation) Write(value);
  }
  void EndLine() {
    if (is_text_) stream_ << '\n';
    is_line_start_ = true;
  }

 private:
  void Separate() {
    if (!is_line_start_) stream_ << ' ';
    is_line_start_ = false;
  }

  bool is_text_;
  bool is_line_start_ = true;
  std::filesystem::path path_;
  std::ofstream stream_;
};

// Writes the elements sorted by id, with a camera for each sensor.
class ModelWriter {
 public:
  ModelWriter(const Scene& scene, const Reconstruction& reconstruction,
              const Context& context)
      : scene_(scene), model_(reconstruction), context_(context) {
    SelectImages();
    AssignCameras();
  }

  void Write(const std::filesystem::path& folder, ModelFormat format) const {
    WriteCameras(ModelFile(folder, "cameras", format));
    WriteRigs(ModelFile(folder, "rigs", format));
    WriteFrames(ModelFile(folder, "frames", format));
    WriteImages(ModelFile(folder, "images", format));
    WritePoints(ModelFile(folder, "points3D", format));
  }

 private:
  struct WrittenCamera {
    uint32_t id;
    int camera_idx;
  };

  void SelectImages();
  void AssignCameras();
  void WriteCameras(ModelFile file) const;
  void WriteRigs(ModelFile file) const;
  void WriteFrames(ModelFile file) const;
  void WriteImages(ModelFile file) const;
  void WritePoints(ModelFile file) const;

  const Scene& scene_;
  const Reconstruction& model_;
  const Context& context_;
  std::vector<int> image_idxs_, frame_idxs_, rig_idxs_;
  std::vector<WrittenCamera> cameras_;
  std::vector<uint32_t> camera_id_of_sensor_;
};

// The selected array positions by the ids of the elements.
template <class Item, class Predicate>
std::vector<int> SelectById(const std::vector<Item>& items,
                            const Predicate& is_selected) {
  std::vector<int> idxs = Indices(items.size());
  EraseIf(&idxs, [&](int idx) { return !is_selected(idx); });
  SortBy(&idxs, [&](int idx) { return items[idx].id; });
  return idxs;
}

void ModelWriter::SelectImages() {
  Mask has_image(scene_.frames.size(), false);
  Mask has_frame(scene_.rigs.size(), false);
  image_idxs_ = SelectById(
      scene_.images, [&](int i) { return model_.IsRegistered(scene_, i); });
  for (const int i : image_idxs_) has_image[scene_.images[i].frame_idx] = true;
  frame_idxs_ = SelectById(scene_.frames, [&](int i) { return has_image[i]; });
  for (const int i : frame_idxs_) has_frame[scene_.frames[i].rig_idx] = true;
  rig_idxs_ = SelectById(scene_.rigs, [&](int i) { return has_frame[i]; });
}

void ModelWriter::AssignCameras() {
  uint32_t next_id = 1;
  for (const Camera& camera : scene_.cameras) {
    next_id = std::max(next_id, camera.id.value() + 1);
  }
  Mask is_taken(scene_.cameras.size(), false);
  camera_id_of_sensor_.resize(scene_.sensors.size());
  for (const int rig_idx : rig_idxs_) {
    for (const int sensor_idx : scene_.rigs[rig_idx].sensor_idxs) {
      const int camera_idx = scene_.sensors[sensor_idx].camera_idx;
      const uint32_t id = is_taken[camera_idx]
                              ? next_id++
                              : scene_.cameras[camera_idx].id.value();
      is_taken[camera_idx] = true;
      camera_id_of_sensor_[sensor_idx] = id;
      cameras_.push_back({id, camera_idx});
    }
  }
  SortBy(&cameras_, &WrittenCamera::id);
}

void ModelWriter::WriteCameras(ModelFile file) const {
  file.WriteCount(cameras_.size());
  for (const WrittenCamera& written : cameras_) {
    const Camera& camera = model_.cameras[written.camera_idx];
    file.Write<uint32_t>(written.id);
    if (file.is_text()) {
      const CameraModelInfo* info =
          FindCameraModel(static_cast<int32_t>(camera.model));
      MGSFM_CHECK(info != nullptr);
      file.WriteWord(std::string(info->name));
    } else {
      file.Write<int32_t>(static_cast<int32_t>(camera.model));
    }
    file.Write<uint64_t>(camera.width_px);
    file.Write<uint64_t>(camera.height_px);
    for (const double param : camera.params) file.Write(param);
    file.EndLine();
  }
  file.Close();
}

void ModelWriter::WriteRigs(ModelFile file) const {
  file.WriteCount(rig_idxs_.size());
  for (const int rig_idx : rig_idxs_) {
    const Rig& rig = scene_.rigs[rig_idx];
    file.Write<uint32_t>(rig.id.value());
    file.Write<uint32_t>(static_cast<uint32_t>(rig.sensor_idxs.size()));
    file.WriteSensorType();
    file.Write<uint32_t>(camera_id_of_sensor_[rig.ref_sensor_idx]);
    for (const int sensor_idx : rig.sensor_idxs) {
      if (sensor_idx == rig.ref_sensor_idx) continue;
      const std::optional<Rigid3>& pose = model_.sensor_from_rig[sensor_idx];
      file.WriteSensorType();
      file.Write<uint32_t>(camera_id_of_sensor_[sensor_idx]);
      file.Write<uint8_t>(pose.has_value() ? 1 : 0);
      if (pose) file.WritePose(*pose);
    }
    file.EndLine();
  }
  file.Close();
}

void ModelWriter::WriteFrames(ModelFile file) const {
  file.WriteCount(frame_idxs_.size());
  for (const int frame_idx : frame_idxs_) {
    const Frame& frame = scene_.frames[frame_idx];
    file.Write<uint32_t>(frame.id.value());
    file.Write<uint32_t>(scene_.rigs[frame.rig_idx].id.value());
    file.WritePose(*model_.rig_from_world[frame_idx]);
    std::vector<int> image_idxs = frame.image_idxs;
    EraseIf(&image_idxs,
            [&](int i) { return !model_.IsRegistered(scene_, i); });
    file.Write<uint32_t>(static_cast<uint32_t>(image_idxs.size()));
    for (const int image_idx : image_idxs) {
      const Image& image = scene_.images[image_idx];
      file.WriteSensorType();
      file.Write<uint32_t>(camera_id_of_sensor_[image.sensor_idx]);
      file.Write<uint64_t>(image.id.value());
    }
    file.EndLine();
  }
  file.Close();
}

void ModelWriter::WriteImages(ModelFile file) const {
  std::vector<std::vector<uint64_t>> point_ids(scene_.images.size());
  for (const int image_idx : image_idxs_) {
    point_ids[image_idx].assign(scene_.images[image_idx].keypoints_px.size(),
                                kModelNoPoint);
  }
  for (size_t i = 0; i < model_.points.size(); ++i) {
    for (const Observation& o : model_.points[i].track) {
      point_ids[o.image_idx][o.keypoint_idx] = i + 1;
    }
  }

  file.WriteCount(image_idxs_.size());
  for (const int image_idx : image_idxs_) {
    context_.CheckInterrupted();
    const Image& image = scene_.images[image_idx];
    file.Write<uint32_t>(image.id.value());
    file.WritePose(*model_.CamFromWorld(scene_, image_idx));
    file.Write<uint32_t>(camera_id_of_sensor_[image.sensor_idx]);
    file.WriteName(image.name);
    file.EndLine();
    file.WriteCount(image.keypoints_px.size());
    for (size_t i = 0; i < image.keypoints_px.size(); ++i) {
      file.Write<double>(image.keypoints_px[i].x());
      file.Write<double>(image.keypoints_px[i].y());
      const uint64_t point_id = point_ids[image_idx][i];
      if (file.is_text()) {
        file.Write<int64_t>(static_cast<int64_t>(point_id));
      } else {
        file.Write<uint64_t>(point_id);
      }
    }
    file.EndLine();
  }
  file.Close();
}

void ModelWriter::WritePoints(ModelFile file) const {
  file.WriteCount(model_.points.size());
  for (size_t i = 0; i < model_.points.size(); ++i) {
    context_.CheckInterrupted();
    const Point3D& point = model_.points[i];
    file.Write<uint64_t>(i + 1);
    for (const double value : point.point_in_world) file.Write(value);
    for (const uint8_t value : point.color) file.Write(value);
    file.Write(point.error_px.value_or(kNoError));
    file.WriteCount(point.track.size());
    for (const Observation& o : point.track) {
      file.Write<uint32_t>(scene_.images[o.image_idx].id.value());
      file.Write<uint32_t>(static_cast<uint32_t>(o.keypoint_idx));
    }
    file.EndLine();
  }
  file.Close();
}

// Rejects values that no reader would accept.
void CheckValues(const Scene& scene, const Reconstruction& model) {
  const auto check = [](const std::optional<std::string>& problem,
                        const std::string& element, const std::string& name) {
    if (!problem) return;
    throw Error("the model is not written: " + element + " '" + name + "' " +
                *problem + "; check its matches, or fix fewer parameters");
  };
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    check(WhyImplausible(model.cameras[i]), "camera",
          std::to_string(scene.cameras[i].id.value()));
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const std::optional<Rigid3>& pose = model.sensor_from_rig[i];
    if (pose) check(WhyImplausible(*pose), "sensor", scene.sensors[i].name);
  }
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const std::optional<Rigid3>& pose = model.rig_from_world[i];
    if (pose) check(WhyImplausible(*pose), "frame", scene.frames[i].name);
  }
  for (size_t i = 0; i < model.points.size(); ++i) {
    check(WhyImplausible(model.points[i].point_in_world), "point",
          std::to_string(i + 1));
  }
}

}  // namespace

void CheckFormat(const Scene& scene, ModelFormat format) {
  for (const Image& image : scene.images) CheckFormat(image.name, format);
}

void CheckFormat(const std::string& image_name, ModelFormat format) {
  if (format != ModelFormat::kText) return;
  if (image_name.find_first_of(" \t\r\n\v\f") == std::string::npos) return;
  throw Error("the name of image '" + image_name +
              "' has a blank, which the text format cannot hold; write the "
              "model as binary");
}

void WriteModel(const std::filesystem::path& folder, const Scene& scene,
                const Reconstruction& reconstruction, ModelFormat format,
                const Context& context) {
  CheckFormat(scene, format);
  CheckValues(scene, reconstruction);
  ModelWriter(scene, reconstruction, context).Write(folder, format);
}

}  // namespace mgsfm
