// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/road.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

std::vector<Rigid3> MakePath(const SimulationOptions& options) {
  std::vector<Rigid3> rig_from_world;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const double loop_turn = 2.0 * kPi / options.num_frames;
  for (int i = 0; i < options.num_frames; ++i) {
    const double distance = i * options.frame_spacing_m;
    double yaw = 0.0, pitch = 0.0, roll = 0.0;
    if (options.path == PathPreset::kLoop) {
      yaw = loop_turn * i;
    } else if (options.path == PathPreset::kCurve) {
      yaw = 0.7 * std::sin(distance / 12.0);
      pitch = 0.08 * std::sin(distance / 7.0);
      roll = 0.05 * std::sin(distance / 5.0 + 1.0);
    }
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0)) *
        ExpSO3(Eigen::Vector3d(pitch, 0.0, 0.0)) *
        ExpSO3(Eigen::Vector3d(0.0, 0.0, roll));
    rig_from_world.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    if (options.path != PathPreset::kStanding) {
      // The step is the chord of the arc between frames, so that loops close
      // exactly.
      const double half_turn =
          options.path == PathPreset::kLoop ? 0.5 * loop_turn : 0.0;
      center +=
          options.frame_spacing_m *
          (world_from_rig * (ExpSO3(Eigen::Vector3d(0.0, half_turn, 0.0)) *
                             Eigen::Vector3d::UnitZ()));
    }
  }
  return rig_from_world;
}

void SetTimes(const SimulationOptions& options,
              const std::vector<double>& timestamps_s, Drive* drive) {
  const size_t num_poses = drive->rig_from_world.size();
  if (timestamps_s.empty()) {
    for (size_t i = 0; i < num_poses; ++i) {
      drive->times_s.push_back(static_cast<double>(i) / options.frame_rate_hz);
    }
    return;
  }
  if (timestamps_s.size() != num_poses) {
    throw Error("the trajectory has " + std::to_string(num_poses) +
                " poses, but " + std::to_string(timestamps_s.size()) +
                " timestamps; provide one timestamp per pose, or none");
  }
  for (size_t i = 1; i < num_poses; ++i) {
    if (!(timestamps_s[i] > timestamps_s[i - 1])) {
      throw Error("the timestamp of pose " + std::to_string(i) +
                  " of the trajectory does not exceed the previous one; sort "
                  "the poses by time");
    }
  }
  drive->times_s = timestamps_s;
}

}  // namespace

Rigid3 Drive::PoseAt(double time_s) const {
  if (rig_from_world.size() < 2) return rig_from_world.front();
  const auto after =
      std::upper_bound(times_s.begin() + 1, times_s.end() - 1, time_s);
  const auto i = static_cast<size_t>(after - times_s.begin());
  const double ratio =
      (time_s - times_s[i - 1]) / (times_s[i] - times_s[i - 1]);
  const Rigid3& pose1 = rig_from_world[i - 1];
  const Rigid3& pose2 = rig_from_world[i];
  const Eigen::Vector3d turn =
      LogSO3(pose2.rotation * pose1.rotation.conjugate());
  const Eigen::Vector3d center =
      pose1.Center() + ratio * (pose2.Center() - pose1.Center());
  return Rigid3::FromRotationAndCenter(
      (ExpSO3(ratio * turn) * pose1.rotation).normalized(), center);
}

Drive MakeDrive(const SimulationOptions& options,
                const SimulationInput& input) {
  Drive drive;
  const bool is_given = !input.rig_from_world_path.empty();
  if (is_given) {
    drive.rig_from_world = input.rig_from_world_path;
  } else {
    MGSFM_CHECK_GT(options.num_frames, 0);
    drive.rig_from_world = MakePath(options);
    drive.is_closed = options.path == PathPreset::kLoop;
  }
  SetTimes(options, input.timestamps_s, &drive);
  const int step = is_given ? options.frame_step : 1;
  MGSFM_CHECK_GT(step, 0);
  for (size_t i = 0; i < drive.rig_from_world.size(); i += step) {
    drive.pose_of_frame.push_back(static_cast<int>(i));
  }
  return drive;
}

Drive SamplePlan(const SimulationOptions& options, const WorldPlan& plan) {
  Drive drive;
  drive.is_level = true;
  drive.num_rigs = static_cast<int>(plan.world_from_rigs.size());
  const double step_s = 1.0 / (options.frame_rate_hz * drive.num_rigs);
  for (const auto& [begin_s, end_s] : plan.sessions_s) {
    const auto num_poses =
        static_cast<int>(std::floor((end_s - begin_s) / step_s + 1e-6));
    for (int i = 0; i < num_poses; ++i) {
      const double time_s = begin_s + i * step_s;
      const int pose = static_cast<int>(drive.times_s.size());
      drive.pose_of_frame.push_back(pose);
      drive.times_s.push_back(time_s);
      drive.rig_from_world.push_back(
          plan.world_from_rigs[pose % drive.num_rigs](time_s).Inverse());
    }
  }
  return drive;
}

namespace {

constexpr double kCameraHeight_m = 1.65;  // as in KITTI
// Criteria for a revisited street: maximum horizontal and vertical distance,
// and minimum number of nodes between both passes.
constexpr double kStreetWidth_m = 10.0;
constexpr double kStoreyHeight_m = 4.0;
constexpr int kMinRevisitNodes = 40;
// Nodes on each side that determine the heading of the road.
constexpr int kHeadingNodes = 3;
constexpr double kGridCell_m = 10.0;  // affects only the time of searches

// The up direction is opposite to the mean y axis of the reference camera.
Eigen::Quaterniond LevelFromWorld(const Drive& drive) {
  if (drive.is_level) return Eigen::Quaterniond::Identity();
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  for (const Rigid3& rig_from_world : drive.rig_from_world) {
    down += rig_from_world.rotation.conjugate() * Eigen::Vector3d::UnitY();
  }
  return RotationBetween(-down.normalized(), Eigen::Vector3d::UnitZ());
}

Eigen::Vector2d MeanHeading(const Drive& drive,
                            const Eigen::Quaterniond& level_from_world) {
  Eigen::Vector3d ahead = Eigen::Vector3d::Zero();
  for (const Rigid3& rig_from_world : drive.rig_from_world) {
    ahead += rig_from_world.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  }
  const Eigen::Vector2d heading = (level_from_world * ahead).head<2>();
  return heading.norm() > 1e-6 ? Eigen::Vector2d(heading.normalized())
                               : Eigen::Vector2d::UnitX();
}

}  // namespace

Road::Road(const Drive& drive, int extension_m)
    : extension_(extension_m),
      level_from_world_(LevelFromWorld(drive)),
      grid_(CellGrid::OfPoints({}, kGridCell_m)) {
  const std::vector<Eigen::Vector3d> grounds =
      Transformed(drive.rig_from_world, [&](const Rigid3& rig_from_world) {
        return Eigen::Vector3d(level_from_world_ * rig_from_world.Center() -
                               kCameraHeight_m * Eigen::Vector3d::UnitZ());
      });
  AddNodes(grounds, MeanHeading(drive, level_from_world_));
  SetHeadings();
  grid_ = CellGrid::OfPoints(Positions(), kGridCell_m);
  FindRevisits();
}

void Road::AddNodes(const std::vector<Eigen::Vector3d>& grounds,
                    const Eigen::Vector2d& default_heading) {
  // Nodes of the drive, and the arc length at each pose.
  std::vector<Eigen::Vector3d> driven = {grounds.front()};
  double arc_length = 0.0;
  for (size_t i = 0; i < grounds.size(); ++i) {
    if (i > 0) {
      const Eigen::Vector3d step = grounds[i] - grounds[i - 1];
      const double length = step.head<2>().norm();
      for (double next = static_cast<double>(driven.size());
           next <= arc_length + length; next += 1.0) {
        driven.emplace_back(grounds[i - 1] +
                            (next - arc_length) / length * step);
      }
      arc_length += length;
    }
    arc_of_pose_.push_back(arc_length + extension_);
  }
  const size_t span = std::min<size_t>(driven.size() - 1, 5);
  Eigen::Vector2d heading_begin = default_heading, heading_end = heading_begin;
  if (span > 0) {
    heading_begin = (driven[span] - driven.front()).head<2>().normalized();
    heading_end = (driven.back() - driven[driven.size() - 1 - span])
                      .head<2>()
                      .normalized();
  }
  const auto extended = [](const Eigen::Vector3d& end,
                           const Eigen::Vector2d& heading, double distance) {
    Eigen::Vector3d ground = end;
    ground.head<2>() += distance * heading;
    return ground;
  };
  for (int i = extension_; i > 0; --i) {
    nodes_.push_back({extended(driven.front(), heading_begin, -i)});
  }
  for (const Eigen::Vector3d& ground : driven) nodes_.push_back({ground});
  for (int i = 1; i <= extension_; ++i) {
    nodes_.push_back({extended(driven.back(), heading_end, i)});
  }
}

void Road::SetHeadings() {
  const int num_nodes = static_cast<int>(nodes_.size());
  Eigen::Vector2d last = Eigen::Vector2d::UnitX();
  for (int i = 0; i < num_nodes; ++i) {
    const RoadNode& before = nodes_[std::max(0, i - kHeadingNodes)];
    const RoadNode& after = nodes_[std::min(num_nodes - 1, i + kHeadingNodes)];
    const Eigen::Vector2d direction = (after.ground - before.ground).head<2>();
    if (direction.norm() > 1e-3) last = direction.normalized();
    nodes_[i].heading = last;
  }
}

void Road::FindRevisits() {
  const double min_same_direction = std::cos(0.25 * 3.14159265358979);
  for (size_t i = 0; i < nodes_.size(); ++i) {
    RoadNode& node = nodes_[i];
    const auto visit = [&](int j) {
      const RoadNode& earlier = nodes_[j];
      const Eigen::Vector3d offset = node.ground - earlier.ground;
      if (j + kMinRevisitNodes > static_cast<int>(i) ||
          offset.head<2>().norm() > kStreetWidth_m ||
          std::abs(offset.z()) > kStoreyHeight_m) {
        return;
      }
      node.is_revisited = true;
      // There are no points beyond the ends of the drive.
      const bool is_driven = j >= driven_begin() && j < driven_end();
      if (is_driven && node.heading.dot(earlier.heading) > min_same_direction) {
        node.is_repeated = true;
      }
    };
    grid_.ForEachNear(node.ground.head<2>(), kStreetWidth_m, visit);
  }
}

std::vector<Eigen::Vector2d> Road::Positions() const {
  return Transformed(nodes_, [](const RoadNode& node) {
    return Eigen::Vector2d(node.ground.head<2>());
  });
}

bool Road::IsNear(const Eigen::Vector2d& position, double distance_m) const {
  bool is_near = false;
  grid_.ForEachNear(position, distance_m, [&](int i) {
    is_near =
        is_near || (nodes_[i].ground.head<2>() - position).norm() < distance_m;
  });
  return is_near;
}

double Road::ArcAt(const Drive& drive, double time_s) const {
  const std::vector<double>& times = drive.times_s;
  const size_t last = times.size() - 1;
  if (time_s <= times.front()) return arc_of_pose_.front();
  if (time_s >= times[last]) return arc_of_pose_[last];
  const auto after = std::upper_bound(times.begin(), times.end(), time_s);
  const auto i = static_cast<size_t>(after - times.begin());
  const double ratio = (time_s - times[i - 1]) / (times[i] - times[i - 1]);
  return arc_of_pose_[i - 1] + ratio * (arc_of_pose_[i] - arc_of_pose_[i - 1]);
}

Rigid3 Road::WorldFromPlace(double arc_m, double left_m) const {
  const double arc =
      std::clamp(arc_m, 0.0, static_cast<double>(nodes_.size()) - 1.0);
  const size_t i = std::min(static_cast<size_t>(arc), nodes_.size() - 2);
  const double ratio = arc - static_cast<double>(i);
  const RoadNode& node1 = nodes_[i];
  const RoadNode& node2 = nodes_[i + 1];
  const Eigen::Vector2d heading =
      ((1.0 - ratio) * node1.heading + ratio * node2.heading).normalized();
  Eigen::Matrix3d axes;
  axes.col(0) << -heading.y(), heading.x(), 0.0;
  axes.col(1) = Eigen::Vector3d::UnitZ();
  axes.col(2) << heading, 0.0;
  const Eigen::Vector3d origin = (1.0 - ratio) * node1.ground +
                                 ratio * node2.ground + left_m * axes.col(0);
  const Rigid3 level_from_place{Eigen::Quaterniond(axes), origin};
  return Rigid3{level_from_world_.conjugate(), Eigen::Vector3d::Zero()} *
         level_from_place;
}

}  // namespace mgsfm
