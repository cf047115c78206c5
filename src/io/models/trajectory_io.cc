// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/trajectory_io.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "calibration/yaml_value.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"
#include "rigs/image_times.h"
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

// Sorts poses by time and keeps equal ones once. Throws Error for different
// poses at one time.
std::vector<TimedPose> InOrder(std::vector<TimedPose> poses,
                               const std::filesystem::path& path) {
  StableSortBy(&poses, &TimedPose::timestamp_s);
  const auto is_repeated = [&path](const TimedPose& a, const TimedPose& b) {
    if (a.timestamp_s != b.timestamp_s) return false;
    if (a.cam_from_world == b.cam_from_world) return true;
    throw Error("'" + path.string() + "' has two different poses at the time " +
                FormatDouble(a.timestamp_s, std::chars_format::fixed, 9) +
                "; remove one of them");
  };
  poses.erase(std::unique(poses.begin(), poses.end(), is_repeated),
              poses.end());
  return poses;
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
      world_from_cam = RigidFromNumbers(*numbers);
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
  return InOrder(std::move(poses), path);
}

std::vector<TimedPose> ReadEurocPoses(const std::filesystem::path& path) {
  constexpr size_t kNumFields = 8;  // velocities and biases follow
  TextLines lines(path);
  std::vector<TimedPose> poses;
  while (lines.NextContent()) {
    std::vector<double> n;
    for (const std::string& field : SplitFields(lines.line(), ',')) {
      if (field.empty() && n.size() >= kNumFields) continue;  // at the end
      n.push_back(lines.Number(field));
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
  return InOrder(std::move(poses), path);
}

std::vector<Rigid3> ReadKittiCalibration(const std::filesystem::path& path) {
  TextLines lines(path);
  std::multimap<std::string, Rigid3> cameras;  // by name; "" without names
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
    if (const auto problem = WhyImplausible(cam_from_cam0)) {
      lines.Throw("the pose of the camera " + *problem);
    }
    cameras.emplace(has_name ? line.substr(0, colon) : "", cam_from_cam0);
  }
  if (cameras.empty()) {
    throw Error("'" + path.string() + "' holds no 3x4 projection matrix");
  }
  return Transformed(cameras, [](const auto& entry) { return entry.second; });
}

Rigid3 ReadEurocCalibration(const std::filesystem::path& path) {
  const YamlValue file(path.string(), ReadText(path));
  return file["T_BS"].Pose().Inverse();
}

}  // namespace mgsfm
