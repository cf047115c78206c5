// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/models/trajectory_io.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "base/file_reading.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Deviation of the norm of a quaternion from 1; files with four digits stay
// below it.
constexpr double kQuaternionTolerance = 1e-3;

// The finite numbers a text consists of; none if there is any other word.
std::vector<double> ParseNumbers(const std::string& text) {
  TextInput words(text);
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    const std::optional<double> number = ParseDouble(word);
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

[[noreturn]] void ThrowBadLine(const std::filesystem::path& path, int line,
                               const std::string& expected) {
  throw Error("'" + path.string() + "', line " + std::to_string(line) +
              ": expected " + expected);
}

// nullopt unless the quaternion has unit length.
std::optional<Rigid3> CamFromWorld(const Eigen::Vector3d& center,
                                   const Eigen::Quaterniond& world_from_cam) {
  if (!(std::abs(world_from_cam.norm() - 1.0) < kQuaternionTolerance)) {
    return std::nullopt;
  }
  return Rigid3{world_from_cam.normalized(), center}.Inverse();
}

bool IsBlank(const std::string& line) {
  return line.find_first_not_of(" \t\r") == std::string::npos;
}

}  // namespace

std::vector<Rigid3> ReadKittiPoses(const std::filesystem::path& path) {
  TextInput file(ReadFile(path));
  std::vector<Rigid3> poses;
  std::string line;
  for (int line_number = 1; std::getline(file, line); ++line_number) {
    if (IsBlank(line)) continue;
    const std::vector<double> numbers = ParseNumbers(line);
    std::optional<Rigid3> world_from_cam;
    if (numbers.size() == 12) {
      world_from_cam =
          RigidFromMatrix(Eigen::Map<const RigidMatrix>(numbers.data()));
    }
    if (!world_from_cam) {
      ThrowBadLine(path, line_number, "a 3x4 pose matrix (12 numbers)");
    }
    poses.push_back(world_from_cam->Inverse());
  }
  return poses;
}

std::vector<TimedPose> ReadTumPoses(const std::filesystem::path& path) {
  TextInput file(ReadFile(path));
  std::vector<TimedPose> poses;
  std::string line;
  for (int line_number = 1; std::getline(file, line); ++line_number) {
    if (IsBlank(line) || line[0] == '#') continue;
    const std::vector<double> n = ParseNumbers(line);
    std::optional<Rigid3> pose;
    if (n.size() == 8) {
      pose = CamFromWorld({n[1], n[2], n[3]}, {n[7], n[4], n[5], n[6]});
    }
    if (!pose)
      ThrowBadLine(path, line_number, "timestamp tx ty tz qx qy qz qw");
    poses.push_back({n[0], *pose});
  }
  return poses;
}

std::vector<TimedPose> ReadEurocPoses(const std::filesystem::path& path) {
  TextInput file(ReadFile(path));
  std::vector<TimedPose> poses;
  std::string line;
  for (int line_number = 1; std::getline(file, line); ++line_number) {
    if (IsBlank(line) || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    const std::vector<double> n = ParseNumbers(line);
    std::optional<Rigid3> pose;
    if (n.size() >= 8) {
      pose = CamFromWorld({n[1], n[2], n[3]}, {n[4], n[5], n[6], n[7]});
    }
    if (!pose) {
      ThrowBadLine(path, line_number, "timestamp [ns],px,py,pz,qw,qx,qy,qz");
    }
    poses.push_back({1e-9 * n[0], *pose});
  }
  return poses;
}

std::vector<Rigid3> ReadKittiCalibration(const std::filesystem::path& path) {
  TextInput file(ReadFile(path));
  std::vector<Rigid3> cameras;
  std::string line;
  for (int line_number = 1; std::getline(file, line); ++line_number) {
    const size_t colon = line.find(':');
    const std::vector<double> numbers = ParseNumbers(
        colon == std::string::npos ? line : line.substr(colon + 1));
    if (numbers.size() != 12) {
      const bool is_camera = colon != std::string::npos && line[0] == 'P';
      if (is_camera) ThrowBadLine(path, line_number, "12 numbers");
      continue;
    }
    const Eigen::Map<const RigidMatrix> projection(numbers.data());
    const Eigen::Matrix3d intrinsics = projection.leftCols<3>();
    if (std::abs(intrinsics.determinant()) < 1e-12) {
      ThrowBadLine(path, line_number, "a projection matrix K [I | t]");
    }
    Rigid3 cam_from_cam0;
    cam_from_cam0.translation = intrinsics.inverse() * projection.col(3);
    cameras.push_back(cam_from_cam0);
  }
  if (cameras.empty()) {
    throw Error("'" + path.string() + "' holds no 3x4 projection matrix");
  }
  return cameras;
}

Rigid3 ReadEurocCalibration(const std::filesystem::path& path) {
  const std::string text = ReadFile(path);
  size_t begin = text.find("T_BS");
  if (begin != std::string::npos) begin = text.find("data:", begin);
  if (begin != std::string::npos) begin = text.find('[', begin);
  const size_t end = begin == std::string::npos ? begin : text.find(']', begin);
  if (end == std::string::npos) {
    throw Error("'" + path.string() + "' holds no matrix T_BS");
  }
  std::string data = text.substr(begin + 1, end - begin - 1);
  for (char& c : data) {
    if (c == ',') c = ' ';
  }
  const std::vector<double> numbers = ParseNumbers(data);
  std::optional<Rigid3> body_from_sensor;
  if (numbers.size() == 16) {
    body_from_sensor =
        RigidFromMatrix(Eigen::Map<const RigidMatrix>(numbers.data()));
  }
  if (!body_from_sensor) {
    throw Error("'" + path.string() + "': T_BS is not a 4x4 rigid transform");
  }
  return body_from_sensor->Inverse();
}

}  // namespace mgsfm
