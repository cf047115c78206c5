// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <charconv>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

#include "base/file_reading.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/model_io.h"
#include "scene/value_check.h"

namespace mgsfm {

// Values in COLMAP's model files: the sensor types, and the point id of a
// keypoint without a point.
constexpr int32_t kModelCameraType = 0;
constexpr int32_t kModelImuType = 1;
constexpr uint64_t kModelNoPoint = ~uint64_t{0};

// folder/stem.bin or .txt.
inline std::filesystem::path ModelFilePath(const std::filesystem::path& folder,
                                           const std::string& stem,
                                           ModelFormat format) {
  return folder / (stem + (format == ModelFormat::kText ? ".txt" : ".bin"));
}

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

  uint32_t ReadId() {
    if (!is_text()) return Read<uint32_t>();
    return static_cast<uint32_t>(
        ReadInteger(std::numeric_limits<uint32_t>::max()));
  }

  uint64_t ReadLongId() {
    if (!is_text()) return Read<uint64_t>();
    return static_cast<uint64_t>(
        ReadInteger(std::numeric_limits<int64_t>::max()));
  }

  std::optional<uint64_t> ReadOptionalLongId() {
    const auto id = is_text() ? static_cast<uint64_t>(ReadInteger(
                                    std::numeric_limits<int64_t>::max(), -1))
                              : Read<uint64_t>();
    if (id == kModelNoPoint) return std::nullopt;
    return id;
  }

  uint8_t ReadByte() {
    return is_text() ? static_cast<uint8_t>(ReadInteger(255)) : Read<uint8_t>();
  }

  bool ReadFlag() {
    return (is_text() ? ReadInteger(1) : Read<uint8_t>()) != 0;
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

  // In text the rest of the line, as names may have blanks.
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

  // In text, where width, height and parameters follow.
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

  bool is_text() const { return lines_.has_value(); }

  // Of a binary file.
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

  // An integer from `min` to `max`.
  int64_t ReadInteger(int64_t max, int64_t min = 0) {
    const std::string_view word = ReadWord();
    int64_t value = 0;
    const char* end = word.data() + word.size();
    const auto [parsed_end, error] = std::from_chars(word.data(), end, value);
    if (error != std::errc() || parsed_end != end || value < min ||
        value > max) {
      ThrowBad("'" + Printable(word) + "' is not an integer from " +
               std::to_string(min) + " to " + std::to_string(max));
    }
    return value;
  }

  std::filesystem::path path_;
  // Of a binary file.
  std::string data_;
  size_t position_ = 0;
  uint64_t num_records_left_ = 0;
  uint64_t num_items_left_ = 0;
  // Of a text file.
  std::optional<TextLines> lines_;
  std::string_view rest_;  // of the current line
};

}  // namespace mgsfm
