// SPDX-License-Identifier: BSD-3-Clause
#include "io/models/model_file_readers.h"

#include <cmath>
#include <limits>
#include <locale>

#include "base/file_reading.h"
#include "geometry/so3.h"
#include "io/models/model_format.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// x and y as doubles, and the id of the point.
constexpr uint64_t kBytesPerKeypoint = 24;

// Seven numbers: a quaternion w, x, y, z of any length, and a translation.
template <class File>
Rigid3 ReadPoseOf(File* file) {
  double v[7];
  for (double& value : v) value = file->ReadNumber();
  const Eigen::Quaterniond rotation(v[0], v[1], v[2], v[3]);
  const Eigen::Vector3d translation(v[4], v[5], v[6]);
  if (!(rotation.norm() > 0.0) || !std::isfinite(rotation.norm()) ||
      !translation.allFinite()) {
    file->ThrowBad("a pose is not a rotation and a translation");
  }
  return {ToUnitQuaternion(rotation), translation};
}

}  // namespace

BinaryModelFile::BinaryModelFile(const std::filesystem::path& folder,
                                 const std::string& stem)
    : path_(folder / (stem + kExtension)), data_(ReadFile(path_)) {
  num_records_left_ = Read<uint64_t>();
}

void BinaryModelFile::Require(uint64_t size) const {
  if (size > data_.size() - position_) {
    ThrowBad("the file is truncated or not COLMAP's");
  }
}

void BinaryModelFile::ThrowBad(const std::string& what) const {
  throw Error("'" + path_.string() + "': " + what);
}

bool BinaryModelFile::NextRecord() {
  if (num_records_left_ == 0) return false;
  --num_records_left_;
  return true;
}

bool BinaryModelFile::NextItem() {
  if (num_items_left_ == 0) return false;
  --num_items_left_;
  return true;
}

std::optional<uint64_t> BinaryModelFile::ReadOptionalLongId() {
  const auto id = Read<uint64_t>();
  if (id == kModelNoPoint) return std::nullopt;
  return id;
}

std::string BinaryModelFile::ReadName() {
  const size_t end = data_.find('\0', position_);
  if (end == std::string::npos) {
    ThrowBad("the file is truncated or not COLMAP's");
  }
  std::string name = data_.substr(position_, end - position_);
  position_ = end + 1;
  return name;
}

Rigid3 BinaryModelFile::ReadPose() { return ReadPoseOf(this); }

const CameraModelInfo& BinaryModelFile::ReadCameraModel() {
  const auto id = Read<int32_t>();
  const CameraModelInfo* info = FindCameraModel(id);
  // An unknown model has an unknown number of parameters, so reading must end.
  if (info == nullptr) {
    ThrowBad("camera model " + std::to_string(id) + " is not known");
  }
  return *info;
}

bool BinaryModelFile::ReadSensorIsCamera() {
  return Read<int32_t>() == kModelCameraType;
}

void BinaryModelFile::SkipKeypoints() {
  const auto count = Read<uint64_t>();
  Require(count);  // so that the product does not overflow
  Require(count * kBytesPerKeypoint);
  position_ += count * kBytesPerKeypoint;
}

TextModelFile::TextModelFile(const std::filesystem::path& folder,
                             const std::string& stem)
    : path_(folder / (stem + kExtension)), file_(ReadFile(path_)) {
  line_.imbue(std::locale::classic());
}

void TextModelFile::ThrowBad(const std::string& what) const {
  throw Error("'" + path_.string() + "', line " + std::to_string(line_number_) +
              ": " + what);
}

bool TextModelFile::NextLine(std::string* text) {
  ++line_number_;
  return static_cast<bool>(std::getline(file_, *text));
}

bool TextModelFile::NextRecord() {
  std::string text;
  while (NextLine(&text)) {
    const size_t first = text.find_first_not_of(" \t\r");
    if (first == std::string::npos || text[first] == '#') continue;
    line_.clear();
    line_.str(text);
    return true;
  }
  return false;
}

bool TextModelFile::NextItem() {
  line_ >> std::ws;
  return line_.peek() != std::istream::traits_type::eof();
}

int64_t TextModelFile::ReadInteger(int64_t max) {
  const auto value = Read<int64_t>();
  if (value < 0 || value > max) {
    ThrowBad(std::to_string(value) + " is out of range");
  }
  return value;
}

uint32_t TextModelFile::ReadId() {
  return static_cast<uint32_t>(
      ReadInteger(std::numeric_limits<uint32_t>::max()));
}

uint64_t TextModelFile::ReadLongId() {
  return static_cast<uint64_t>(
      ReadInteger(std::numeric_limits<int64_t>::max()));
}

std::optional<uint64_t> TextModelFile::ReadOptionalLongId() {
  const auto id = Read<int64_t>();
  if (id == -1) return std::nullopt;
  if (id < 0) ThrowBad(std::to_string(id) + " is not an id");
  return static_cast<uint64_t>(id);
}

uint8_t TextModelFile::ReadByte() {
  return static_cast<uint8_t>(ReadInteger(255));
}

Rigid3 TextModelFile::ReadPose() { return ReadPoseOf(this); }

const CameraModelInfo& TextModelFile::ReadCameraModel() {
  const auto name = Read<std::string>();
  const CameraModelInfo* info = FindCameraModel(name);
  if (info == nullptr) ThrowBad("camera model '" + name + "' is not known");
  return *info;
}

bool TextModelFile::ReadSensorIsCamera() {
  return Read<std::string>() == "CAMERA";
}

void TextModelFile::BeginKeypoints() {
  std::string text;
  NextLine(&text);  // the last line of a file may lack
  line_.clear();
  line_.str(text);
}

void TextModelFile::SkipKeypoints() { BeginKeypoints(); }

}  // namespace mgsfm
