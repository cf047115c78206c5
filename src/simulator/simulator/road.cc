// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/road.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace mgsfm {
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
  return Eigen::Quaterniond::FromTwoVectors(-down.normalized(),
                                            Eigen::Vector3d::UnitZ());
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

std::vector<Eigen::Vector2d> Positions(const std::vector<RoadNode>& nodes) {
  std::vector<Eigen::Vector2d> positions;
  positions.reserve(nodes.size());
  for (const RoadNode& node : nodes) {
    positions.emplace_back(node.ground.head<2>());
  }
  return positions;
}

}  // namespace

Road::Road(const Drive& drive, int extension_m)
    : extension_(extension_m),
      level_from_world_(LevelFromWorld(drive)),
      grid_(Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero(), kGridCell_m) {
  std::vector<Eigen::Vector3d> grounds;
  for (const Rigid3& rig_from_world : drive.rig_from_world) {
    grounds.emplace_back(level_from_world_ * rig_from_world.Center() -
                         kCameraHeight_m * Eigen::Vector3d::UnitZ());
  }
  AddNodes(grounds, MeanHeading(drive, level_from_world_));
  SetHeadings();
  grid_ = CellGrid::OfPoints(Positions(nodes_), kGridCell_m);
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
