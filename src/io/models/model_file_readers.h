// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/text_lines.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Values in the model files of COLMAP: the types of sensors, and the point of a
// keypoint that has none.
constexpr int32_t kModelCameraType = 0;
constexpr int32_t kModelImuType = 1;
constexpr uint64_t kModelNoPoint = ~uint64_t{0};

// Two readers of one file of a COLMAP model with the same functions, so that
// each kind of record is parsed by one template. A file is read as
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

class BinaryModelFile {
 public:
  static constexpr char kExtension[] = ".bin";

  // Reads folder/stem.bin into memory.
  BinaryModelFile(const std::filesystem::path& folder, const std::string& stem);

  bool NextRecord();
  void EndRecord() {}
  uint32_t ReadId() { return Read<uint32_t>(); }
  uint32_t ReadCount() { return Read<uint32_t>(); }
  uint64_t ReadLongId() { return Read<uint64_t>(); }
  uint64_t ReadSize() { return Read<uint64_t>(); }
  std::optional<uint64_t> ReadOptionalLongId();
  uint8_t ReadByte() { return Read<uint8_t>(); }
  bool ReadFlag() { return Read<uint8_t>() != 0; }
  double ReadNumber() { return Read<double>(); }
  double ReadErrorPx() { return ReadNumber(); }
  std::string ReadName();
  Rigid3 ReadPose();
  const CameraModelInfo& ReadCameraModel();
  // Width, height and parameters follow.
  void CheckNumParams(const CameraModelInfo&) const {}
  bool ReadSensorIsCamera();
  void BeginList() { num_items_left_ = Read<uint64_t>(); }
  bool NextItem();
  // Keypoints of an image are a list; text files have them on their own line.
  void BeginKeypoints() { BeginList(); }
  void SkipKeypoints();

  [[noreturn]] void ThrowBad(const std::string& what) const;

 private:
  template <class T>
  T Read() {
    Require(sizeof(T));
    T value;
    std::memcpy(&value, data_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  void Require(uint64_t size) const;

  std::filesystem::path path_;
  std::string data_;
  size_t position_ = 0;
  uint64_t num_records_left_ = 0;
  uint64_t num_items_left_ = 0;
};

class TextModelFile {
 public:
  static constexpr char kExtension[] = ".txt";

  TextModelFile(const std::filesystem::path& folder, const std::string& stem);

  bool NextRecord();
  void EndRecord() const;
  uint32_t ReadId();
  uint32_t ReadCount() { return ReadId(); }
  uint64_t ReadLongId();
  uint64_t ReadSize() { return ReadLongId(); }
  std::optional<uint64_t> ReadOptionalLongId();
  uint8_t ReadByte();
  bool ReadFlag() { return ReadInteger(1) != 0; }
  double ReadNumber();
  // COLMAP writes -1 or nan for an unknown error.
  double ReadErrorPx();
  // The rest of the line, as names may have blanks.
  std::string ReadName();
  Rigid3 ReadPose();
  const CameraModelInfo& ReadCameraModel();
  void CheckNumParams(const CameraModelInfo& info) const;
  bool ReadSensorIsCamera();
  void BeginList() {}
  bool NextItem();
  void BeginKeypoints();
  void SkipKeypoints();

  [[noreturn]] void ThrowBad(const std::string& what) const;

 private:
  std::string_view ReadWord();
  // An integer from `min` to `max`.
  int64_t ReadInteger(int64_t max, int64_t min = 0);

  TextLines lines_;
  std::string_view rest_;  // of the current line
};

}  // namespace mgsfm
