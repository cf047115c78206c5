// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/models/trajectory_io.h"

#include <Eigen/LU>
#include <cmath>
#include <optional>
#include <string>

#include "base/text.h"
#include "base/text_lines.h"
#include "geometry/rigid_matrix.h"
#include "io/rigs/image_name_times.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// nullopt unless the quaternion has unit length.
std::optional<Rigid3> CamFromWorld(const Eigen::Vector3d& center,
                                   const Eigen::Quaterniond& world_from_cam) {
  const Rigid3 pose = PoseOfFile(world_from_cam, center);
  if (WhyImplausible(pose)) return std::nullopt;
  return pose.Inverse();
}

bool IsProjection(const Eigen::Matrix3d& K) {
  return std::abs(K.determinant()) > 1e-12 &&
         K.bottomLeftCorner<1, 2>().isZero();
}

}  // namespace

std::vector<Rigid3> ReadKittiPoses(const std::filesystem::path& path) {
  TextLines lines(path);
  std::vector<Rigid3> poses;
  while (lines.NextContent()) {
    const auto numbers = ParseNumbers(lines.line());
    std::optional<Rigid3> world_from_cam;
    if (numbers && numbers->size() == 12) {
      world_from_cam =
          RigidFromMatrix(Eigen::Map<const RigidMatrix>(numbers->data()));
    }
    if (!world_from_cam) {
      lines.Throw("expected a 3x4 pose matrix (12 numbers)");
    }
    poses.push_back(world_from_cam->Inverse());
  }
  return poses;
}

std::vector<TimedPose> ReadTumPoses(const std::filesystem::path& path) {
  TextLines lines(path);
  std::vector<TimedPose> poses;
  while (lines.NextContent()) {
    const auto n = ParseNumbers(lines.line());
    std::optional<Rigid3> pose;
    if (n && n->size() == 8) {
      const double* v = n->data();
      pose = CamFromWorld({v[1], v[2], v[3]}, {v[7], v[4], v[5], v[6]});
    }
    if (!pose) lines.Throw("expected timestamp tx ty tz qx qy qz qw");
    if (const auto problem = WhyNoTime(n->front())) {
      lines.Throw("the time " + *problem);
    }
    poses.push_back({n->front(), *pose});
  }
  return poses;
}

std::vector<TimedPose> ReadEurocPoses(const std::filesystem::path& path) {
  constexpr size_t kNumFields = 8;  // velocities and biases follow
  TextLines lines(path);
  std::vector<TimedPose> poses;
  while (lines.NextContent()) {
    std::vector<double> n;
    for (const std::string& field : SplitFields(lines.line(), ',')) {
      if (field.empty() && n.size() >= kNumFields) continue;  // at the end
      const std::optional<double> number = ParseDouble(field);
      if (!number) {
        lines.Throw("has '" + Printable(field) +
                    "' where a finite number should be");
      }
      n.push_back(*number);
    }
    std::optional<Rigid3> pose;
    if (n.size() >= kNumFields) {
      pose = CamFromWorld({n[1], n[2], n[3]}, {n[4], n[5], n[6], n[7]});
    }
    if (!pose || n[0] != std::floor(n[0])) {
      lines.Throw("expected timestamp [ns],px,py,pz,qw,qx,qy,qz");
    }
    poses.push_back({1e-9 * n[0], *pose});
  }
  return poses;
}

std::vector<Rigid3> ReadKittiCalibration(const std::filesystem::path& path) {
  TextLines lines(path);
  std::vector<Rigid3> cameras;
  while (lines.NextContent()) {
    const std::string_view line = lines.line();
    const size_t colon = line.find(':');
    const bool has_name = colon != std::string_view::npos;
    if (has_name && line.front() != 'P') continue;
    const auto numbers = ParseNumbers(has_name ? line.substr(colon + 1) : line);
    if (!numbers || numbers->size() != 12) lines.Throw("expected 12 numbers");
    const Eigen::Map<const RigidMatrix> projection(numbers->data());
    const Eigen::Matrix3d intrinsics = projection.leftCols<3>();
    if (!IsProjection(intrinsics)) {
      lines.Throw("expected a projection matrix K [I | t]");
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
  const std::string text = ReadText(path);
  size_t begin = text.find("T_BS");
  if (begin != std::string::npos) begin = text.find("data:", begin);
  if (begin != std::string::npos) begin = text.find('[', begin);
  const size_t end = begin == std::string::npos ? begin : text.find(']', begin);
  if (end == std::string::npos) {
    throw Error("'" + path.string() + "' holds no matrix T_BS");
  }
  std::string data = text.substr(begin + 1, end - begin - 1);
  for (char& c : data) {
    if (c == ',' || c == '\n') c = ' ';
  }
  const auto numbers = ParseNumbers(data);
  const auto body_from_sensor =
      numbers ? RigidFromNumbers(*numbers) : std::nullopt;
  if (!body_from_sensor) {
    throw Error("'" + path.string() + "': T_BS is not a 4x4 rigid transform");
  }
  return body_from_sensor->Inverse();
}

}  // namespace mgsfm
