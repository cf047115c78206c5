// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "simulator/ray_grid.h"
#include "simulator/road.h"
#include "simulator/street_surfaces.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {

// A detectable point and the viewpoints from which it can be matched.
struct WorldPoint {
  Eigen::Vector3d position;
  // Unit vector from the point to its best viewpoint. The point is detectable
  // within an angle of this direction, on the side of its normal.
  Eigen::Vector3d best_view = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double min_cos_turn = -1.0;
  // Range of distances for a camera with focal length kReferenceFocal.
  double min_distance_m = 0.0;
  double max_distance_m = 0.0;
  double repeatability = 1.0;
  double strength = 0.0;  // the strongest points become features
  // The point with the same appearance: itself, or the original of a copy.
  int appearance = -1;
  int duplicate = -1;  // index into copy_from_original, for both
  bool is_copy = false;
};

constexpr double kReferenceFocal_px = 707.0912;  // KITTI sequences 04 to 12
// Length of the road beyond each end of the drive.
constexpr int kRoadExtension_m = 120;

// An index of points by range of visibility, for fast lookup.
class PointIndex {
 public:
  PointIndex() = default;
  PointIndex(const std::vector<WorldPoint>& points,
             const Eigen::Quaterniond& level_from_world);

  // Calls function(point) for all points that may be detectable from a camera
  // center. `distance_scale` converts distances to the reference focal length.
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
  std::vector<TexturedBox> boxes;
  std::vector<WorldPoint> points;
  std::vector<int> weak_cuts;  // the frames of the drive before them
  std::vector<Rigid3> copy_from_original;  // per duplicate, in the world frame
  PointIndex index;
  bool distances_scale = false;  // distances scale with the focal length

  // Whether a surface occludes a point.
  bool IsHidden(const Eigen::Vector3d& point,
                const Eigen::Vector3d& camera_center) const;
};

// Points of a street are the first intersections of rays from positions along
// the drive, so that every camera of the rig observes about the required
// number.
World MakeWorld(const SimulationOptions& options,
                const std::vector<SimulatedCamera>& rig, const Drive& drive,
                int num_duplicates, const Context& context);
World MakeWorld(const WorldPlan& plan, uint64_t seed, const Drive& drive);

// The points on the surface of a box, in the frame that contains it.
std::vector<WorldPoint> PointsOnBox(const TexturedBox& box, uint64_t seed);

}  // namespace mgsfm
