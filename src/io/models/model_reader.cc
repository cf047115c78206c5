// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/model_io.h"
#include "models/model_file.h"
#include "scene/item_lists.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// One file of a COLMAP model in either format. A file is read as
//
//   while (file.NextRecord()) { file.ReadId(); ...; file.EndRecord(); }
//
// and a list within a record, whose length only binary files give, as
//
//   file.BeginList();
//   while (file.NextItem()) { ... }
//
// All functions throw Error, naming the file, for missing, superfluous or
// impossible values.
class ModelFileReader {
 public:
  // Reads a file into memory.
  ModelFileReader(const std::filesystem::path& path, ModelFormat format)
      : path_(path) {
    if (format == ModelFormat::kText) {
      lines_.emplace(path_);
    } else {
      data_ = ReadFile(path_);
      num_records_left_ = Read<uint64_t>();
    }
  }

  bool NextRecord() {
    if (is_text()) {
      const bool has_record = lines_->NextContent();
      rest_ = lines_->line();
      return has_record;
    }
    if (num_records_left_ > 0) {
      --num_records_left_;
      return true;
    }
    if (position_ < data_.size()) {
      ThrowBad(std::to_string(data_.size() - position_) +
               " bytes follow the last record; write the model again with the "
               "program that made it");
    }
    return false;
  }

  void EndRecord() const {
    if (TrimBlanks(rest_).empty()) return;
    ThrowBad("'" + Printable(TrimBlanks(rest_)) +
             "' follows what the line should hold");
  }

  uint32_t ReadId() { return ReadUnsigned<uint32_t>(); }
  uint64_t ReadLongId() { return ReadUnsigned<uint64_t>(); }
  uint8_t ReadByte() { return ReadUnsigned<uint8_t>(); }
  bool ReadFlag() { return ReadUnsigned<uint8_t>(1) != 0; }

  std::optional<uint64_t> ReadOptionalLongId() {
    const auto id = ReadUnsigned<uint64_t>(kMaxInteger, -1);
    if (id == kModelNoPoint) return std::nullopt;
    return id;
  }

  double ReadNumber() {
    if (!is_text()) return Read<double>();
    const std::string_view word = ReadWord();
    const std::optional<double> number = ParseDouble(word);
    if (!number) ThrowBad("'" + Printable(word) + "' is not a finite number");
    return *number;
  }

  // COLMAP writes -1 or, in text, nan for an unknown error.
  double ReadErrorPx() {
    const std::string_view next = TrimBlanks(rest_);
    for (const std::string_view word : {"nan", "-nan", "inf"}) {
      if (next.substr(0, next.find_first_of(" \t")) != word) continue;
      ReadWord();
      return -1.0;
    }
    return ReadNumber();
  }

  // Names may have blanks: in text files, a name is the rest of the line.
  std::string ReadName() {
    if (is_text()) {
      const std::string_view name = TrimBlanks(rest_);
      if (name.empty()) ThrowBad("the line ends before the name of an image");
      rest_ = {};
      return std::string(name);
    }
    const size_t end = data_.find('\0', position_);
    if (end == std::string::npos) ThrowBad(kTruncated);
    std::string name = data_.substr(position_, end - position_);
    position_ = end + 1;
    return name;
  }

  // Seven numbers: a quaternion w, x, y, z and a translation.
  Rigid3 ReadPose() {
    double v[7];
    for (double& value : v) value = ReadNumber();
    return PoseOfFile({v[0], v[1], v[2], v[3]}, {v[4], v[5], v[6]});
  }

  const CameraModelInfo& ReadCameraModel() {
    std::string name;
    const CameraModelInfo* info = nullptr;
    if (is_text()) {
      const std::string_view word = ReadWord();
      info = FindCameraModel(word);
      name = "'" + Printable(word) + "'";
    } else {
      const auto id = Read<int32_t>();
      info = FindCameraModel(id);
      name = std::to_string(id);
    }
    // It has an unknown number of parameters, so reading must end.
    if (info == nullptr) ThrowBad("camera model " + name + " is not known");
    return *info;
  }

  // Checks text files, where width, height and parameters follow.
  void CheckNumParams(const CameraModelInfo& info) const {
    const size_t num_words = SplitWords(rest_).size();
    if (!is_text() || num_words == static_cast<size_t>(info.num_params)) return;
    ThrowBad(std::string(info.name) + " has " +
             std::to_string(info.num_params) + " parameters, not " +
             std::to_string(num_words));
  }

  bool ReadSensorIsCamera() {
    if (is_text()) {
      const std::string_view type = ReadWord();
      if (type == "CAMERA" || type == "IMU") return type == "CAMERA";
      ThrowBad("'" + Printable(type) + "' is not the type of a sensor");
    }
    constexpr int32_t kModelImuType = 1;
    const auto type = Read<int32_t>();
    if (type != kModelCameraType && type != kModelImuType) {
      ThrowBad(std::to_string(type) + " is not the type of a sensor");
    }
    return type == kModelCameraType;
  }

  void BeginList() {
    if (!is_text()) num_items_left_ = Read<uint64_t>();
  }

  bool NextItem() {
    if (is_text()) return !TrimBlanks(rest_).empty();
    if (num_items_left_ == 0) return false;
    --num_items_left_;
    return true;
  }

  // Keypoints of an image are a list; text files have them on their own line.
  void BeginKeypoints() {
    if (!is_text()) return BeginList();
    lines_->Next();  // the last line of a file may lack
    rest_ = lines_->line();
    constexpr size_t kWordsPerKeypoint = 3;
    if (SplitWords(rest_).size() % kWordsPerKeypoint != 0) {
      ThrowBad(
          "expected the keypoints of the image above, 'x y point_id' each; "
          "leave a line empty for an image without keypoints");
    }
  }

  void SkipKeypoints() {
    BeginKeypoints();
    if (!is_text()) {
      // x, y and the id of the point.
      constexpr uint64_t kBytesPerKeypoint = 24;
      Require(num_items_left_);  // so that the product does not overflow
      Require(num_items_left_ * kBytesPerKeypoint);
      position_ += num_items_left_ * kBytesPerKeypoint;
      return;
    }
    while (NextItem()) {
      ReadNumber();
      ReadNumber();
      ReadOptionalLongId();
    }
  }

  [[noreturn]] void ThrowBad(const std::string& what) const {
    if (is_text()) lines_->Throw(what);
    throw Error("'" + path_.string() + "': " + what);
  }

 private:
  static constexpr char kTruncated[] = "the file is truncated or not COLMAP's";
  static constexpr int64_t kMaxInteger = std::numeric_limits<int64_t>::max();

  bool is_text() const { return lines_.has_value(); }

  // Reads a number of a binary file.
  template <class T>
  T Read() {
    Require(sizeof(T));
    T value;
    std::memcpy(&value, data_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  void Require(uint64_t size) const {
    if (size > data_.size() - position_) ThrowBad(kTruncated);
  }

  // Of a text file.
  std::string_view ReadWord() {
    const std::string_view word = TakeWord(&rest_);
    if (word.empty()) ThrowBad("the line ends early");
    return word;
  }

  // In text, an integer from `min` to `max`.
  template <class T>
  T ReadUnsigned(int64_t max = std::min<uint64_t>(std::numeric_limits<T>::max(),
                                                  kMaxInteger),
                 int64_t min = 0) {
    if (!is_text()) return Read<T>();
    const std::string_view word = ReadWord();
    int64_t value = 0;
    const char* end = word.data() + word.size();
    const auto [parsed_end, error] = std::from_chars(word.data(), end, value);
    if (error != std::errc() || parsed_end != end || value < min ||
        value > max) {
      ThrowBad("'" + Printable(word) + "' is not an integer from " +
               std::to_string(min) + " to " + std::to_string(max));
    }
    return static_cast<T>(value);
  }

  std::filesystem::path path_;
  // The content of a binary file.
  std::string data_;
  size_t position_ = 0;
  uint64_t num_records_left_ = 0;
  uint64_t num_items_left_ = 0;
  // Of a text file.
  std::optional<TextLines> lines_;
  std::string_view rest_;  // of the current line
};

constexpr char kStaleTables[] =
    "; if another program wrote the images, remove the files rigs and frames";

void ThrowIf(const std::optional<std::string>& problem,
             const ModelFileReader& file, const std::string& element) {
  if (problem) file.ThrowBad(element + ' ' + *problem);
}

std::vector<Camera> ReadCameras(ModelFileReader file) {
  constexpr uint64_t kMaxSize = std::numeric_limits<int>::max();
  std::vector<Camera> cameras;
  while (file.NextRecord()) {
    const CameraId id(file.ReadId());
    const CameraModelInfo& info = file.ReadCameraModel();
    const uint64_t width = file.ReadLongId(), height = file.ReadLongId();
    if (width > kMaxSize || height > kMaxSize) {
      file.ThrowBad("the size of an image is out of range");
    }
    Camera camera{
        id, info.id, static_cast<int>(width), static_cast<int>(height), {}};
    file.CheckNumParams(info);
    for (int i = 0; i < info.num_params; ++i) {
      camera.params.push_back(file.ReadNumber());
    }
    ThrowIf(WhyImplausible(camera), file,
            "camera " + std::to_string(id.value()));
    file.EndRecord();
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

struct ImageRecord {
  ModelImage image;
  std::vector<ModelKeypoint> keypoints;
};

std::vector<ImageRecord> ReadImages(ModelFileReader file, bool with_keypoints) {
  std::vector<ImageRecord> records;
  while (file.NextRecord()) {
    const ImageId id(file.ReadId());
    const Rigid3 pose = file.ReadPose();
    const CameraId camera_id(file.ReadId());
    records.push_back({{id, file.ReadName(), camera_id, pose}, {}});
    const std::string& name = records.back().image.name;
    ThrowIf(WhyUnusable(name), file, "the name of image '" + name + "'");
    ThrowIf(WhyImplausible(pose), file, "the pose of image '" + name + "'");
    if (!with_keypoints) {
      file.SkipKeypoints();
      continue;
    }
    file.BeginKeypoints();
    while (file.NextItem()) {
      ModelKeypoint keypoint;
      keypoint.position_px.x() = file.ReadNumber();
      keypoint.position_px.y() = file.ReadNumber();
      keypoint.point_id = file.ReadOptionalLongId();
      ThrowIf(WhyImplausible(keypoint.position_px), file, "a keypoint");
      records.back().keypoints.push_back(keypoint);
    }
  }
  SortBy(
      &records,
      [](const ImageRecord& a) -> const auto& { return a.image.name; });
  return records;
}

std::vector<ModelPoint> ReadPoints(ModelFileReader file) {
  std::vector<ModelPoint> points;
  while (file.NextRecord()) {
    ModelPoint point;
    point.id = file.ReadLongId();
    for (double& value : point.point_in_world) value = file.ReadNumber();
    ThrowIf(WhyImplausible(point.point_in_world), file,
            "point " + std::to_string(point.id));
    for (uint8_t& value : point.color) value = file.ReadByte();
    const double error_px = file.ReadErrorPx();
    if (error_px >= 0.0 && std::isfinite(error_px)) point.error_px = error_px;
    file.BeginList();
    while (file.NextItem()) {
      const ImageId image_id(file.ReadId());
      point.track.push_back({image_id, file.ReadId()});
    }
    points.push_back(std::move(point));
  }
  return points;
}

std::vector<RigRow> ReadRigs(ModelFileReader file) {
  std::vector<RigRow> rigs;
  while (file.NextRecord()) {
    RigRow rig{RigId(file.ReadId()), {}, {}};
    const uint32_t num_sensors = file.ReadId();
    for (uint32_t k = 0; k < num_sensors; ++k) {
      const bool is_camera = file.ReadSensorIsCamera();
      RigSensorRow sensor{CameraId(file.ReadId()), std::nullopt};
      if (k == 0) {
        sensor.sensor_from_rig = Rigid3();
        if (is_camera) rig.ref_camera_id = sensor.camera_id;
      } else if (file.ReadFlag()) {
        sensor.sensor_from_rig = file.ReadPose();
        ThrowIf(WhyImplausible(*sensor.sensor_from_rig), file,
                "a sensor of rig " + std::to_string(rig.id.value()));
      }
      if (is_camera) rig.sensors.push_back(std::move(sensor));
    }
    file.EndRecord();
    rigs.push_back(std::move(rig));
  }
  return rigs;
}

std::vector<ModelFrame> ReadFrames(ModelFileReader file,
                                   const std::vector<ModelImage>& images) {
  const auto image_of_id = IndexById(images);
  std::vector<ModelFrame> frames;
  while (file.NextRecord()) {
    const FrameId id(file.ReadId());
    const RigId rig_id(file.ReadId());
    ModelFrame frame{id, rig_id, file.ReadPose(), {}};
    ThrowIf(WhyImplausible(frame.rig_from_world), file,
            "the pose of frame " + std::to_string(id.value()));
    const uint32_t num_data = file.ReadId();
    for (uint32_t k = 0; k < num_data; ++k) {
      const bool is_camera = file.ReadSensorIsCamera();
      const CameraId camera_id(file.ReadId());
      const uint64_t data_id = file.ReadLongId();
      if (!is_camera) continue;
      if (data_id > std::numeric_limits<uint32_t>::max()) {
        file.ThrowBad("the id of an image is out of range");
      }
      frame.image_ids.emplace_back(static_cast<uint32_t>(data_id));
      const auto image = image_of_id.find(frame.image_ids.back());
      if (image == image_of_id.end()) continue;
      const CameraId known_id = images[image->second].camera_id;
      if (known_id == camera_id) continue;
      file.ThrowBad("frame " + std::to_string(id.value()) + " has image " +
                    std::to_string(data_id) + " of camera " +
                    std::to_string(camera_id.value()) +
                    ", which is of camera " + std::to_string(known_id.value()) +
                    " in the file of images" + kStaleTables);
    }
    file.EndRecord();
    frames.push_back(std::move(frame));
  }
  return frames;
}

uint64_t NumberOf(uint64_t id) { return id; }
template <class Id>
uint64_t NumberOf(Id id) {
  return id.value();
}

constexpr char kWriteAgain[] =
    "; write the model again with the program that made it";

[[noreturn]] void Throw(const fs::path& folder, const std::string& problem) {
  throw Error("the model in '" + folder.string() + "' " + problem);
}

template <class Item>
void CheckIdsDiffer(const fs::path& folder, const std::string& kind,
                    const std::vector<Item>& items) {
  std::vector<uint64_t> ids =
      Transformed(items, [&](const Item& item) { return NumberOf(item.id); });
  std::sort(ids.begin(), ids.end());
  const auto twice = std::adjacent_find(ids.begin(), ids.end());
  if (twice == ids.end()) return;
  Throw(folder,
        "has " + kind + " " + std::to_string(*twice) + " twice" + kWriteAgain);
}

// Images are sorted by name.
void CheckNamesDiffer(const fs::path& folder,
                      const std::vector<ModelImage>& images) {
  const auto twice =
      std::adjacent_find(images.begin(), images.end(),
                         [](const ModelImage& a, const ModelImage& b) {
                           return a.name == b.name;
                         });
  if (twice == images.end()) return;
  Throw(folder, "has two images '" + twice->name + "'" + kWriteAgain);
}

Model ReadFiles(const fs::path& folder, ModelFormat format, bool poses_only) {
  const auto exists = [&](const char* stem) {
    return fs::exists(ModelFilePath(folder, stem, format));
  };
  const auto open = [&](const char* stem) {
    return ModelFileReader(ModelFilePath(folder, stem, format), format);
  };
  Model model;
  for (ImageRecord& record : ReadImages(open("images"), !poses_only)) {
    model.poses.images.push_back(std::move(record.image));
    model.keypoints.push_back(std::move(record.keypoints));
  }
  if (exists("rigs")) model.poses.rigs = ReadRigs(open("rigs"));
  if (exists("frames")) {
    model.poses.frames = ReadFrames(open("frames"), model.poses.images);
  }
  if (!poses_only) {
    model.cameras = ReadCameras(open("cameras"));
    model.points = ReadPoints(open("points3D"));
  }
  CheckNamesDiffer(folder, model.poses.images);
  CheckIdsDiffer(folder, "image", model.poses.images);
  CheckIdsDiffer(folder, "rig", model.poses.rigs);
  CheckIdsDiffer(folder, "frame", model.poses.frames);
  CheckIdsDiffer(folder, "camera", model.cameras);
  CheckIdsDiffer(folder, "point", model.points);
  return model;
}

// Throws Error if a table is in the other format: it would be ignored, and the
// rigs with it.
void CheckOneFormat(const fs::path& folder, ModelFormat format) {
  const ModelFormat other =
      format == ModelFormat::kText ? ModelFormat::kBinary : ModelFormat::kText;
  for (const char* stem : {"rigs", "frames"}) {
    const fs::path ignored = ModelFilePath(folder, stem, other);
    if (fs::exists(ModelFilePath(folder, stem, format)) ||
        !fs::exists(ignored)) {
      continue;
    }
    const std::string name = ignored.filename().string();
    Throw(folder, "has " + ModelFilePath("", "images", format).string() +
                      " but " + name +
                      "; write it in one format with the program that made it, "
                      "or remove " +
                      name + " if it is of another model");
  }
}

Model ReadEitherFormat(const fs::path& folder, bool poses_only) {
  for (const ModelFormat format : {ModelFormat::kBinary, ModelFormat::kText}) {
    if (!fs::exists(ModelFilePath(folder, "images", format))) continue;
    CheckOneFormat(folder, format);
    return ReadFiles(folder, format, poses_only);
  }
  throw Error(
      "'" + folder.string() +
      "' holds no model (neither images.bin nor images.txt); check the path");
}

void CheckCameras(const fs::path& folder, const Model& model) {
  const auto camera_of_id = IndexById(model.cameras);
  for (const ModelImage& image : model.poses.images) {
    if (camera_of_id.count(image.camera_id) == 0) {
      Throw(folder, "lacks camera " + std::to_string(image.camera_id.value()) +
                        " of image '" + image.name + "'" + kWriteAgain);
    }
  }
}

std::string Name(const ModelObservation& o) {
  return "keypoint " + std::to_string(o.keypoint_idx) + " of image " +
         std::to_string(o.image_id.value());
}

// Checks that each observation is of a keypoint that refers to its point, that
// each keypoint is observed once, and that there are no other references.
void CheckTracks(const fs::path& folder, const Model& model) {
  const auto position_of_image = IndexById(model.poses.images);
  std::vector<std::vector<bool>> is_observed;
  size_t num_references = 0;
  for (size_t i = 0; i < model.poses.images.size(); ++i) {
    is_observed.emplace_back(model.keypoints[i].size(), false);
    for (const ModelKeypoint& keypoint : model.keypoints[i]) {
      num_references += keypoint.point_id.has_value() ? 1 : 0;
    }
  }
  size_t num_observations = 0;
  for (const ModelPoint& point : model.points) {
    for (const ModelObservation& o : point.track) {
      const auto it = position_of_image.find(o.image_id);
      if (it == position_of_image.end() ||
          o.keypoint_idx >= model.keypoints[it->second].size() ||
          model.keypoints[it->second][o.keypoint_idx].point_id != point.id) {
        Throw(folder, "is inconsistent: no " + Name(o) + " refers to point " +
                          std::to_string(point.id) + ", which it observes");
      }
      if (is_observed[it->second][o.keypoint_idx]) {
        Throw(folder, "is inconsistent: the track of point " +
                          std::to_string(point.id) + " has " + Name(o) +
                          " twice");
      }
      is_observed[it->second][o.keypoint_idx] = true;
      ++num_observations;
    }
  }
  if (num_observations != num_references) {
    Throw(folder,
          "is inconsistent: keypoints refer to points that do not have them in "
          "their tracks");
  }
}

}  // namespace

PoseModel ReadModelPoses(const fs::path& folder) {
  return ReadEitherFormat(folder, true).poses;
}

Model ReadModel(const fs::path& folder) {
  Model model = ReadEitherFormat(folder, false);
  SortBy(&model.cameras, &Camera::id);
  SortBy(&model.points, &ModelPoint::id);
  CheckCameras(folder, model);
  CheckTracks(folder, model);
  return model;
}

}  // namespace mgsfm
