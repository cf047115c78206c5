// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_file_readers.h"

#include <charconv>
#include <limits>
#include <system_error>

#include "base/file_reading.h"
#include "base/text.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// x and y as doubles, and the id of the point.
constexpr uint64_t kBytesPerKeypoint = 24;

// Seven numbers: a quaternion w, x, y, z and a translation.
template <class File>
Rigid3 ReadPoseOf(File* file) {
  double v[7];
  for (double& value : v) value = file->ReadNumber();
  const Eigen::Quaterniond rotation(v[0], v[1], v[2], v[3]);
  return PoseOfFile(rotation, {v[4], v[5], v[6]});
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
  const auto type = Read<int32_t>();
  if (type != kModelCameraType && type != kModelImuType) {
    ThrowBad(std::to_string(type) + " is not the type of a sensor");
  }
  return type == kModelCameraType;
}

void BinaryModelFile::SkipKeypoints() {
  const auto count = Read<uint64_t>();
  Require(count);  // so that the product does not overflow
  Require(count * kBytesPerKeypoint);
  position_ += count * kBytesPerKeypoint;
}

TextModelFile::TextModelFile(const std::filesystem::path& folder,
                             const std::string& stem)
    : lines_(folder / (stem + kExtension)) {}

void TextModelFile::ThrowBad(const std::string& what) const {
  lines_.Throw(what);
}

bool TextModelFile::NextRecord() {
  const bool has_record = lines_.NextContent();
  rest_ = lines_.line();
  return has_record;
}

void TextModelFile::EndRecord() const {
  if (TrimBlanks(rest_).empty()) return;
  ThrowBad("'" + Printable(TrimBlanks(rest_)) +
           "' follows what the line should hold");
}

bool TextModelFile::NextItem() { return !TrimBlanks(rest_).empty(); }

std::string_view TextModelFile::ReadWord() {
  const std::string_view word = TakeWord(&rest_);
  if (word.empty()) ThrowBad("the line ends early");
  return word;
}

int64_t TextModelFile::ReadInteger(int64_t max, int64_t min) {
  const std::string_view word = ReadWord();
  int64_t value = 0;
  const char* end = word.data() + word.size();
  const auto [parsed_end, error] = std::from_chars(word.data(), end, value);
  if (error != std::errc() || parsed_end != end || value < min || value > max) {
    ThrowBad("'" + Printable(word) + "' is not an integer from " +
             std::to_string(min) + " to " + std::to_string(max));
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
  const int64_t id = ReadInteger(std::numeric_limits<int64_t>::max(), -1);
  if (id < 0) return std::nullopt;
  return static_cast<uint64_t>(id);
}

uint8_t TextModelFile::ReadByte() {
  return static_cast<uint8_t>(ReadInteger(255));
}

double TextModelFile::ReadNumber() {
  const std::string_view word = ReadWord();
  const std::optional<double> number = ParseDouble(word);
  if (!number) ThrowBad("'" + Printable(word) + "' is not a finite number");
  return *number;
}

double TextModelFile::ReadErrorPx() {
  const std::string_view next = TrimBlanks(rest_);
  for (const std::string_view word : {"nan", "-nan", "inf"}) {
    if (next.substr(0, next.find_first_of(" \t")) != word) continue;
    ReadWord();
    return -1.0;
  }
  return ReadNumber();
}

std::string TextModelFile::ReadName() {
  const std::string_view name = TrimBlanks(rest_);
  if (name.empty()) ThrowBad("the line ends before the name of an image");
  rest_ = {};
  return std::string(name);
}

Rigid3 TextModelFile::ReadPose() { return ReadPoseOf(this); }

const CameraModelInfo& TextModelFile::ReadCameraModel() {
  const std::string_view name = ReadWord();
  const CameraModelInfo* info = FindCameraModel(name);
  if (info == nullptr) {
    ThrowBad("camera model '" + Printable(name) + "' is not known");
  }
  return *info;
}

void TextModelFile::CheckNumParams(const CameraModelInfo& info) const {
  const size_t num_words = SplitWords(rest_).size();
  if (num_words == static_cast<size_t>(info.num_params)) return;
  ThrowBad(std::string(info.name) + " has " + std::to_string(info.num_params) +
           " parameters, not " + std::to_string(num_words));
}

bool TextModelFile::ReadSensorIsCamera() {
  const std::string_view type = ReadWord();
  if (type != "CAMERA" && type != "IMU") {
    ThrowBad("'" + Printable(type) + "' is not the type of a sensor");
  }
  return type == "CAMERA";
}

void TextModelFile::BeginKeypoints() {
  lines_.Next();  // the last line of a file may lack
  rest_ = lines_.line();
  constexpr size_t kWordsPerKeypoint = 3;
  if (SplitWords(rest_).size() % kWordsPerKeypoint != 0) {
    ThrowBad(
        "expected the keypoints of the image above, 'x y point_id' each; leave "
        "a line empty for an image without keypoints");
  }
}

void TextModelFile::SkipKeypoints() {
  BeginKeypoints();
  while (NextItem()) {
    ReadNumber();
    ReadNumber();
    ReadOptionalLongId();
  }
}

}  // namespace mgsfm
