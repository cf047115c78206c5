// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "synthetic/cell_grid.h"
#include "synthetic/drive.h"
#include "synthetic/road.h"
#include "synthetic/street_surfaces.h"

namespace mgsfm {

// A point that images have features of, and from where it is recognised.
struct WorldPoint {
  Eigen::Vector3d position;
  // Unit, from the point to where it is seen best; recognised within an angle
  // of that, and on the side of the normal.
  Eigen::Vector3d best_view = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double min_cos_turn = -1.0;
  // Between these distances, for a camera of kReferenceFocal.
  double min_distance_m = 0.0;
  double max_distance_m = 0.0;
  double repeatability = 1.0;
  double strength = 0.0;  // the strongest become features
  // The point it looks like: itself, or the original of a copy.
  int appearance = -1;
  int duplicate = -1;  // of World::copy_from_original, for both
  bool is_copy = false;
};

constexpr double kReferenceFocal_px = 707.0912;
// The road goes on for so long beyond both ends of the drive.
constexpr int kRoadExtension_m = 120;

// Points by their reach, so that few have to be looked at.
class PointIndex {
 public:
  PointIndex() = default;
  PointIndex(const std::vector<WorldPoint>& points,
             const Eigen::Quaterniond& level_from_world);

  // Calls function(point) for all that a camera there may recognise.
  // `distance_scale` times a distance is that for the reference focal length.
  template <class Function>
  void ForEachNear(const Eigen::Vector2d& position_in_level,
                   double distance_scale, const Function& function) const {
    for (const Level& level : levels_) {
      level.grid.ForEachNear(position_in_level, level.reach_m / distance_scale,
                             [&](int item) { function(level.points[item]); });
    }
  }

 private:
  struct Level {
    double reach_m;
    std::vector<int> points;
    CellGrid grid;
  };
  std::vector<Level> levels_;
};

struct World {
  Road road;
  std::optional<StreetSurfaces> surfaces;
  std::vector<WorldPoint> points;
  std::vector<Rigid3> copy_from_original;  // of duplicates, in the world frame
  PointIndex index;
  bool distances_scale = false;  // with the focal length

  // Whether a surface hides a point from a camera.
  bool IsHidden(const Eigen::Vector3d& point,
                const Eigen::Vector3d& camera_center) const;
};

// The points of a street are found by rays from places along the drive, so
// that every camera of the rig has about as many as it needs, each where the
// ray meets the first surface.
World MakeWorld(const SimulationOptions& options,
                const std::vector<SimulatedCamera>& rig, const Drive& drive,
                int num_duplicates, const Context& context);

}  // namespace mgsfm
