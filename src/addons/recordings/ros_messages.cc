// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/ros_messages.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "recordings/byte_reader.h"

namespace mgsfm {
namespace {

// Takes values of a serialized message:
// - ROS 1: without padding, little-endian, strings without a final zero
//   (https://wiki.ros.org/msg).
// - CDR of ROS 2: four bytes that state the byte order, then values at
//   multiples of their size, strings with a final zero (OMG, DDS-XTypes 1.3,
//   7.4, XCDR version 1).
class MessageReader {
 public:
  MessageReader(std::string_view message, const std::string& encoding)
      : bytes_(message), is_cdr_(encoding == "cdr") {
    MGSFM_CHECK(is_cdr_ || encoding == "ros1");
    if (!is_cdr_) return;
    const std::string_view start = bytes_.TakeBytes(4);
    if (start[0] != 0 || (start[1] != 0 && start[1] != 1)) {
      throw BytesError("is not plain CDR");
    }
    is_big_endian_ = start[1] == 0;
  }

  template <class T>
  T Take() {
    if (is_cdr_) {
      const size_t offset = (bytes_.position() - 4) % sizeof(T);
      if (offset != 0) (void)bytes_.TakeBytes(sizeof(T) - offset);
    }
    std::array<char, sizeof(T)> raw;
    const std::string_view taken = bytes_.TakeBytes(sizeof(T));
    std::copy(taken.begin(), taken.end(), raw.begin());
    if (is_big_endian_) std::reverse(raw.begin(), raw.end());
    T value;
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  std::string_view TakeBytes() {
    const auto size = Take<uint32_t>();
    return bytes_.TakeBytes(size);
  }
  std::string TakeText() {
    std::string_view text = TakeBytes();
    if (is_cdr_ && !text.empty()) text.remove_suffix(1);
    return std::string(text);
  }
  template <class Values>
  void TakeAll(Values* values) {
    for (auto& value : *values) {
      value = Take<std::decay_t<decltype(value)>>();
    }
  }
  std::vector<double> TakeDoubles() {
    const auto size = Take<uint32_t>();
    if (size > bytes_.NumLeft() / sizeof(double)) {
      throw BytesError("ends within a value");
    }
    std::vector<double> values(size);
    TakeAll(&values);
    return values;
  }
  MessageHeader TakeHeader() {
    if (!is_cdr_) (void)Take<uint32_t>();  // counter
    MessageHeader header;
    const auto seconds = Take<uint32_t>();
    const auto nanoseconds = Take<uint32_t>();
    header.stamp_ns = int64_t{seconds} * kNsPerSecond + nanoseconds;
    header.frame_id = TakeFrame();
    return header;
  }
  std::string TakeFrame() {
    std::string frame = TakeText();
    if (!frame.empty() && frame.front() == '/') frame.erase(0, 1);
    return frame;
  }
  // Position, and a quaternion in the order x, y, z, w; nullopt if they are not
  // finite or no rotation.
  std::optional<Rigid3> TakePose() {
    std::array<double, 7> v{};
    TakeAll(&v);
    const Eigen::Quaterniond rotation(v[6], v[3], v[4], v[5]);
    const bool is_valid =
        AllOf(v, [](double value) { return std::isfinite(value); }) &&
        std::abs(rotation.norm() - 1.0) < 0.1;
    if (!is_valid) return std::nullopt;
    return Rigid3{rotation.normalized(), {v[0], v[1], v[2]}};
  }
  // Numbers and their covariance, which begins with -1 for no measurement.
  template <size_t kSize>
  std::optional<Eigen::Matrix<double, kSize, 1>> TakeMeasured() {
    // No sensor on a camera measures nearly as much, in m/s^2 or rad/s.
    constexpr double kMaxNorm = 1000.0;
    Eigen::Matrix<double, kSize, 1> values;
    std::array<double, 9> covariance{};
    for (double& value : values) value = Take<double>();
    TakeAll(&covariance);
    const bool is_measured =
        covariance[0] != -1.0 && values.allFinite() && values.norm() < kMaxNorm;
    return is_measured ? std::make_optional(values) : std::nullopt;
  }

 private:
  ByteReader bytes_;
  const bool is_cdr_;
  bool is_big_endian_ = false;
};

}  // namespace

MessageHeader ReadMessageHeader(std::string_view message,
                                const std::string& encoding) {
  return MessageReader(message, encoding).TakeHeader();
}

ImageMessage ReadImageMessage(std::string_view message,
                              const std::string& encoding) {
  MessageReader reader(message, encoding);
  ImageMessage image;
  (void)reader.TakeHeader();
  image.height_px = reader.Take<uint32_t>();
  image.width_px = reader.Take<uint32_t>();
  image.encoding = reader.TakeText();
  image.is_big_endian = reader.Take<uint8_t>() != 0;
  image.row_bytes = reader.Take<uint32_t>();
  image.data = reader.TakeBytes();
  return image;
}

CompressedImageMessage ReadCompressedImageMessage(std::string_view message,
                                                  const std::string& encoding) {
  MessageReader reader(message, encoding);
  CompressedImageMessage image;
  (void)reader.TakeHeader();
  image.format = reader.TakeText();
  image.data = reader.TakeBytes();
  return image;
}

CameraInfoMessage ReadCameraInfoMessage(std::string_view message,
                                        const std::string& encoding) {
  MessageReader reader(message, encoding);
  CameraInfoMessage info;
  (void)reader.TakeHeader();
  info.height_px = reader.Take<uint32_t>();
  info.width_px = reader.Take<uint32_t>();
  info.distortion_model = reader.TakeText();
  info.D = reader.TakeDoubles();
  reader.TakeAll(&info.K);
  reader.TakeAll(&info.R);
  reader.TakeAll(&info.P);
  reader.TakeAll(&info.binning);
  reader.TakeAll(&info.crop_px);
  return info;
}

std::vector<TransformMessage> ReadTransformMessages(
    std::string_view message, const std::string& encoding) {
  MessageReader reader(message, encoding);
  std::vector<TransformMessage> transforms;
  const auto size = reader.Take<uint32_t>();
  for (uint32_t i = 0; i < size; ++i) {
    TransformMessage transform;
    MessageHeader header = reader.TakeHeader();
    transform.stamp_ns = header.stamp_ns;
    transform.parent = std::move(header.frame_id);
    transform.child = reader.TakeFrame();
    const auto pose = reader.TakePose();
    if (!pose) continue;
    transform.parent_from_child = *pose;
    transforms.push_back(std::move(transform));
  }
  return transforms;
}

PoseMessage ReadNavSatFixMessage(std::string_view message,
                                 const std::string& encoding) {
  MessageReader reader(message, encoding);
  PoseMessage pose;
  pose.header = reader.TakeHeader();
  pose.child = pose.header.frame_id;
  const auto status = reader.Take<int8_t>();
  (void)reader.Take<uint16_t>();  // satellite system
  Eigen::Vector3d& position = pose.world_from_child.translation;
  for (double& value : position) value = reader.Take<double>();
  pose.is_valid = status >= 0 && position.allFinite();
  return pose;
}

ImuMessage ReadImuMessage(std::string_view message,
                          const std::string& encoding) {
  MessageReader reader(message, encoding);
  ImuMessage imu;
  imu.stamp_ns = reader.TakeHeader().stamp_ns;
  const auto xyzw = reader.TakeMeasured<4>();
  if (xyzw && std::abs(xyzw->norm() - 1.0) < 0.1) {
    imu.world_from_imu = Eigen::Quaterniond(xyzw->normalized());
  }
  imu.angular_velocity = reader.TakeMeasured<3>();
  imu.acceleration = reader.TakeMeasured<3>();
  return imu;
}

PoseMessage ReadOdometryMessage(std::string_view message,
                                const std::string& encoding) {
  MessageReader reader(message, encoding);
  PoseMessage pose;
  pose.header = reader.TakeHeader();
  pose.child = reader.TakeFrame();
  const auto world_from_child = reader.TakePose();
  if (!world_from_child) {
    throw BytesError("has a pose that is not finite or no rotation");
  }
  pose.world_from_child = *world_from_child;
  return pose;
}

}  // namespace mgsfm
