// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Messages of ROS 1 and 2. They have the same fields, in the same order, except
// that headers of ROS 1 begin with a counter. Views are into the message.

struct MessageHeader {
  int64_t stamp_ns = 0;  // 0: not set
  std::string frame_id;  // without a leading '/'
};

struct ImageMessage {
  uint32_t height_px = 0;
  uint32_t width_px = 0;
  std::string encoding;
  bool is_big_endian = false;
  uint32_t row_bytes = 0;
  std::string_view data;
};

struct CompressedImageMessage {
  std::string format;
  std::string_view data;
};

struct CameraInfoMessage {
  uint32_t height_px = 0;
  uint32_t width_px = 0;
  std::string distortion_model;
  std::vector<double> D;
  std::array<double, 9> K{};   // camera matrix
  std::array<double, 9> R{};   // rectified_from_cam
  std::array<double, 12> P{};  // camera matrix of rectified images, in 3x4
  // How the driver reduced the images: first cropped, then binned. Zeros mean
  // neither.
  std::array<uint32_t, 2> binning{};  // x, y
  std::array<uint32_t, 4> crop_px{};  // x, y, height, width
};

struct TransformMessage {
  std::string parent;
  std::string child;
  Rigid3 parent_from_child;
  int64_t stamp_ns = 0;  // 0: not set
};

// A position with a time, as coordinates (Odometry) or as latitude, longitude
// and altitude (NavSatFix, whose pose has no rotation).
struct PoseMessage {
  MessageHeader header;
  std::string child;  // the frame that has the pose
  Rigid3 world_from_child;
  bool is_valid = true;  // false: no fix
};

// A quantity is nullopt if the sensor does not measure it, or if its numbers
// are beyond those of any sensor.
struct ImuMessage {
  int64_t stamp_ns = 0;  // 0: not set
  std::optional<Eigen::Quaterniond> world_from_imu;
  std::optional<Eigen::Vector3d> angular_velocity;  // rad/s
  std::optional<Eigen::Vector3d> acceleration;      // m/s^2; upward at rest
};

// All functions throw BytesError for malformed messages. `encoding` is "ros1"
// or "cdr".

MessageHeader ReadMessageHeader(std::string_view message,
                                const std::string& encoding);
ImageMessage ReadImageMessage(std::string_view message,
                              const std::string& encoding);
CompressedImageMessage ReadCompressedImageMessage(std::string_view message,
                                                  const std::string& encoding);
CameraInfoMessage ReadCameraInfoMessage(std::string_view message,
                                        const std::string& encoding);
// Without transforms that are not finite or no rotation.
std::vector<TransformMessage> ReadTransformMessages(
    std::string_view message, const std::string& encoding);
PoseMessage ReadNavSatFixMessage(std::string_view message,
                                 const std::string& encoding);
PoseMessage ReadOdometryMessage(std::string_view message,
                                const std::string& encoding);
ImuMessage ReadImuMessage(std::string_view message,
                          const std::string& encoding);

}  // namespace mgsfm
