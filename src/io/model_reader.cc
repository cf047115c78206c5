// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <locale>
#include <sstream>
#include <string>
#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/io/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr int32_t kCameraSensorType = 0;
constexpr uint64_t kBytesPerKeypoint = 24;

std::string ReadFile(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error("cannot read '" + path.string() + "'");
  return {std::istreambuf_iterator<char>(file),
          std::istreambuf_iterator<char>()};
}

// A binary file in memory, read from front to back.
class BinaryFile {
 public:
  explicit BinaryFile(const fs::path& path)
      : path_(path), data_(ReadFile(path)) {}

  template <class T>
  T Read() {
    Require(sizeof(T));
    T value;
    std::memcpy(&value, data_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  Rigid3 ReadPose() {
    double v[7];
    for (double& value : v) value = Read<double>();
    return {Eigen::Quaterniond(v[0], v[1], v[2], v[3]).normalized(),
            {v[4], v[5], v[6]}};
  }
  std::string ReadName() {
    const size_t end = data_.find('\0', position_);
    if (end == std::string::npos) ThrowTruncated();
    std::string name = data_.substr(position_, end - position_);
    position_ = end + 1;
    return name;
  }
  void Skip(uint64_t count, uint64_t size) {
    if (count > data_.size()) ThrowTruncated();
    Require(count * size);
    position_ += count * size;
  }

 private:
  void Require(uint64_t size) const {
    if (size > data_.size() - position_) ThrowTruncated();
  }
  [[noreturn]] void ThrowTruncated() const {
    throw Error("'" + path_.string() + "' is truncated or no COLMAP file");
  }

  fs::path path_;
  std::string data_;
  size_t position_ = 0;
};

// A text file, line by line, without comments.
class TextFile {
 public:
  explicit TextFile(const fs::path& path) : path_(path), file_(path) {
    if (!file_) throw Error("cannot read '" + path_.string() + "'");
    line_.imbue(std::locale::classic());
  }

  // Of the next line that holds something; false at the end.
  bool NextLine() {
    std::string text;
    while (NextRawLine(&text)) {
      const size_t first = text.find_first_not_of(" \t\r");
      if (first == std::string::npos || text[first] == '#') continue;
      line_.clear();
      line_.str(text);
      return true;
    }
    return false;
  }
  // Also an empty one.
  bool NextRawLine(std::string* text) {
    ++line_number_;
    return static_cast<bool>(std::getline(file_, *text));
  }
  template <class T>
  T Read() {
    T value{};
    if (!(line_ >> value)) {
      throw Error("'" + path_.string() + "', line " +
                  std::to_string(line_number_) + " is not as expected");
    }
    return value;
  }
  Rigid3 ReadPose() {
    double v[7];
    for (double& value : v) value = Read<double>();
    return {Eigen::Quaterniond(v[0], v[1], v[2], v[3]).normalized(),
            {v[4], v[5], v[6]}};
  }

 private:
  fs::path path_;
  std::ifstream file_;
  std::istringstream line_;
  int line_number_ = 0;
};

std::vector<ModelImage> ReadImages(BinaryFile file) {
  std::vector<ModelImage> images;
  const auto num_images = file.Read<uint64_t>();
  for (uint64_t i = 0; i < num_images; ++i) {
    file.Read<uint32_t>();
    const Rigid3 pose = file.ReadPose();
    const CameraId camera_id(file.Read<uint32_t>());
    images.push_back({file.ReadName(), camera_id, pose});
    file.Skip(file.Read<uint64_t>(), kBytesPerKeypoint);
  }
  return images;
}

std::vector<ModelImage> ReadImages(TextFile file) {
  std::vector<ModelImage> images;
  while (file.NextLine()) {
    file.Read<uint32_t>();
    const Rigid3 pose = file.ReadPose();
    const CameraId camera_id(file.Read<uint32_t>());
    images.push_back({file.Read<std::string>(), camera_id, pose});
    std::string keypoints;
    file.NextRawLine(&keypoints);
  }
  return images;
}

std::vector<ModelRig> ReadRigs(BinaryFile file) {
  std::vector<ModelRig> rigs;
  const auto num_rigs = file.Read<uint64_t>();
  for (uint64_t i = 0; i < num_rigs; ++i) {
    ModelRig rig{RigId(file.Read<uint32_t>()), {}};
    const auto num_sensors = file.Read<uint32_t>();
    for (uint32_t k = 0; k < num_sensors; ++k) {
      const auto type = file.Read<int32_t>();
      ModelSensor sensor{CameraId(file.Read<uint32_t>()), k == 0, Rigid3()};
      if (k > 0) {
        sensor.sensor_from_rig.reset();
        if (file.Read<uint8_t>() != 0) sensor.sensor_from_rig = file.ReadPose();
      }
      if (type == kCameraSensorType) rig.sensors.push_back(sensor);
    }
    rigs.push_back(rig);
  }
  return rigs;
}

std::vector<ModelRig> ReadRigs(TextFile file) {
  std::vector<ModelRig> rigs;
  while (file.NextLine()) {
    ModelRig rig{RigId(file.Read<uint32_t>()), {}};
    const auto num_sensors = file.Read<uint32_t>();
    for (uint32_t k = 0; k < num_sensors; ++k) {
      const auto type = file.Read<std::string>();
      ModelSensor sensor{CameraId(file.Read<uint32_t>()), k == 0, Rigid3()};
      if (k > 0) {
        sensor.sensor_from_rig.reset();
        if (file.Read<int>() != 0) sensor.sensor_from_rig = file.ReadPose();
      }
      if (type == "CAMERA") rig.sensors.push_back(sensor);
    }
    rigs.push_back(rig);
  }
  return rigs;
}

}  // namespace

PoseModel ReadModelPoses(const fs::path& folder) {
  PoseModel model;
  if (fs::exists(folder / "images.bin")) {
    model.images = ReadImages(BinaryFile(folder / "images.bin"));
    if (fs::exists(folder / "rigs.bin")) {
      model.rigs = ReadRigs(BinaryFile(folder / "rigs.bin"));
    }
  } else if (fs::exists(folder / "images.txt")) {
    model.images = ReadImages(TextFile(folder / "images.txt"));
    if (fs::exists(folder / "rigs.txt")) {
      model.rigs = ReadRigs(TextFile(folder / "rigs.txt"));
    }
  } else {
    throw Error("'" + folder.string() +
                "' holds no model (neither images.bin nor images.txt)");
  }
  std::sort(
      model.images.begin(), model.images.end(),
      [](const ModelImage& a, const ModelImage& b) { return a.name < b.name; });
  return model;
}

}  // namespace mgsfm
