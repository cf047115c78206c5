// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {

// All that the five files of a COLMAP model hold, read by a program of its own
// so that writer and reader are not tested by each other.

using ParsedPose = std::array<double, 7>;  // qw qx qy qz tx ty tz

struct ParsedCamera {
  int32_t model_id;
  uint64_t width, height;
  std::vector<double> params;
};

struct ParsedSensor {
  uint32_t camera_id;
  std::optional<ParsedPose> sensor_from_rig;  // absent for the reference
};

struct ParsedFrame {
  uint32_t rig_id;
  ParsedPose rig_from_world;
  std::vector<std::pair<uint32_t, uint64_t>> data;  // camera and image
};

struct ParsedKeypoint {
  double x, y;
  int64_t point_id;
};

struct ParsedImage {
  ParsedPose cam_from_world;
  uint32_t camera_id;
  std::string name;
  std::vector<ParsedKeypoint> keypoints;
};

struct ParsedPoint {
  std::array<double, 3> xyz;
  std::array<int, 3> rgb;
  double error;
  std::vector<std::pair<uint32_t, uint32_t>> track;
};

struct ParsedModel {
  std::map<uint32_t, ParsedCamera> cameras;
  std::map<uint32_t, std::vector<ParsedSensor>> rigs;  // reference first
  std::map<uint32_t, ParsedFrame> frames;
  std::map<uint32_t, ParsedImage> images;
  std::map<uint64_t, ParsedPoint> points;
};

// A file read field by field. In binary, each field has the given type; in
// text, fields are words and lists end with the line.
class ModelFields {
 public:
  ModelFields(const std::filesystem::path& folder, const std::string& name,
              bool is_text)
      : is_text_(is_text),
        data_(ReadTextFile(folder / (name + (is_text ? ".txt" : ".bin")))),
        lines_(data_) {
    if (!is_text_) num_items_ = Get<uint64_t>();
  }

  // Returns whether there is another item; binary files store their number.
  bool NextItem() {
    if (is_text_) return NextLine();
    return num_items_-- > 0;
  }
  bool NextLine() {
    std::string line;
    if (!is_text_) return true;
    if (!std::getline(lines_, line)) return false;
    line_ = std::istringstream(line);
    return true;
  }
  template <class T>
  T Get() {
    T value;
    if (is_text_) {
      // A wider type, because a stream reads a byte as a character.
      std::conditional_t<sizeof(T) == 1, int, T> word;
      MGSFM_CHECK(static_cast<bool>(line_ >> word));
      return static_cast<T>(word);
    }
    MGSFM_CHECK_LE(position_ + sizeof(T), data_.size());
    std::memcpy(&value, data_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  std::string GetName() {
    std::string name;
    if (is_text_) {
      MGSFM_CHECK(static_cast<bool>(line_ >> name));
    } else {
      name = data_.c_str() + position_;
      position_ += name.size() + 1;
    }
    return name;
  }
  // The length of a list that in text goes to the end of the line.
  size_t GetCount(size_t num_words_per_item) {
    if (!is_text_) return Get<uint64_t>();
    const std::streampos begin = line_.tellg();
    size_t num_words = 0;
    for (std::string word; line_ >> word;) ++num_words;
    line_.clear();
    line_.seekg(begin);
    MGSFM_CHECK_EQ(num_words % num_words_per_item, 0u);
    return num_words / num_words_per_item;
  }
  void ExpectCamera() {
    MGSFM_CHECK(is_text_ ? GetName() == "CAMERA" : Get<int32_t>() == 0);
  }
  ParsedPose GetPose() {
    ParsedPose pose;
    for (double& value : pose) value = Get<double>();
    return pose;
  }
  bool IsAtEnd() { return is_text_ ? !NextLine() : position_ == data_.size(); }

 private:
  bool is_text_;
  std::string data_;
  std::istringstream lines_, line_;
  size_t position_ = 0;
  uint64_t num_items_ = 0;
};

inline void ParseCameras(const std::filesystem::path& folder, bool is_text,
                         ParsedModel* model) {
  // Models used in tests: number in binary, name, number of parameters.
  const std::map<std::string, std::pair<int32_t, size_t>> camera_models = {
      {"PINHOLE", {1, 4}}, {"OPENCV_FISHEYE", {5, 8}}};
  ModelFields cameras(folder, "cameras", is_text);
  while (cameras.NextItem()) {
    ParsedCamera& camera = model->cameras[cameras.Get<uint32_t>()];
    camera.model_id = is_text ? camera_models.at(cameras.GetName()).first
                              : cameras.Get<int32_t>();
    camera.width = cameras.Get<uint64_t>();
    camera.height = cameras.Get<uint64_t>();
    for (const auto& entry : camera_models) {
      if (entry.second.first != camera.model_id) continue;
      camera.params.resize(entry.second.second);
    }
    for (double& param : camera.params) param = cameras.Get<double>();
  }
  MGSFM_CHECK(cameras.IsAtEnd());
}

inline void ParseRigs(const std::filesystem::path& folder, bool is_text,
                      ParsedModel* model) {
  ModelFields rigs(folder, "rigs", is_text);
  while (rigs.NextItem()) {
    std::vector<ParsedSensor>& rig = model->rigs[rigs.Get<uint32_t>()];
    rig.resize(rigs.Get<uint32_t>());
    for (size_t i = 0; i < rig.size(); ++i) {
      rigs.ExpectCamera();
      rig[i].camera_id = rigs.Get<uint32_t>();
      if (i > 0 && rigs.Get<uint8_t>() == 1) {
        rig[i].sensor_from_rig = rigs.GetPose();
      }
    }
  }
  MGSFM_CHECK(rigs.IsAtEnd());
}

inline void ParseFrames(const std::filesystem::path& folder, bool is_text,
                        ParsedModel* model) {
  ModelFields frames(folder, "frames", is_text);
  while (frames.NextItem()) {
    ParsedFrame& frame = model->frames[frames.Get<uint32_t>()];
    frame.rig_id = frames.Get<uint32_t>();
    frame.rig_from_world = frames.GetPose();
    frame.data.resize(frames.Get<uint32_t>());
    for (auto& [camera_id, image_id] : frame.data) {
      frames.ExpectCamera();
      camera_id = frames.Get<uint32_t>();
      image_id = frames.Get<uint64_t>();
    }
  }
  MGSFM_CHECK(frames.IsAtEnd());
}

inline void ParseImages(const std::filesystem::path& folder, bool is_text,
                        ParsedModel* model) {
  ModelFields images(folder, "images", is_text);
  while (images.NextItem()) {
    ParsedImage& image = model->images[images.Get<uint32_t>()];
    image.cam_from_world = images.GetPose();
    image.camera_id = images.Get<uint32_t>();
    image.name = images.GetName();
    MGSFM_CHECK(images.NextLine());
    image.keypoints.resize(images.GetCount(3));
    for (ParsedKeypoint& keypoint : image.keypoints) {
      keypoint.x = images.Get<double>();
      keypoint.y = images.Get<double>();
      keypoint.point_id = images.Get<int64_t>();
    }
  }
  MGSFM_CHECK(images.IsAtEnd());
}

inline void ParsePoints(const std::filesystem::path& folder, bool is_text,
                        ParsedModel* model) {
  ModelFields points(folder, "points3D", is_text);
  while (points.NextItem()) {
    ParsedPoint& point = model->points[points.Get<uint64_t>()];
    for (double& value : point.xyz) value = points.Get<double>();
    for (int& value : point.rgb) value = points.Get<uint8_t>();
    point.error = points.Get<double>();
    point.track.resize(points.GetCount(2));
    for (auto& [image_id, keypoint_idx] : point.track) {
      image_id = points.Get<uint32_t>();
      keypoint_idx = points.Get<uint32_t>();
    }
  }
  MGSFM_CHECK(points.IsAtEnd());
}

inline ParsedModel ParseModel(const std::filesystem::path& folder,
                              bool is_text) {
  ParsedModel model;
  ParseCameras(folder, is_text, &model);
  ParseRigs(folder, is_text, &model);
  ParseFrames(folder, is_text, &model);
  ParseImages(folder, is_text, &model);
  ParsePoints(folder, is_text, &model);
  return model;
}

}  // namespace mgsfm
