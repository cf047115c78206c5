// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "bundle_adjustment/problem_builder.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

int SensorOf(const Scene& scene, const Observation& observation) {
  return scene.images[observation.image_idx].sensor_idx;
}

UnionFind TiedSensors(const Scene& scene, const std::vector<Point3D>& points) {
  std::map<std::pair<int, int>, int> num_shared;
  for (const Point3D& point : points) {
    std::set<int> sensors;
    for (const Observation& o : point.track) {
      sensors.insert(SensorOf(scene, o));
    }
    for (auto a = sensors.begin(); a != sensors.end(); ++a) {
      for (auto b = std::next(a); b != sensors.end(); ++b) {
        ++num_shared[{*a, *b}];
      }
    }
  }
  UnionFind tied(scene.sensors.size());
  for (const auto& [sensors, number] : num_shared) {
    if (number >= kMinNumSensorTies) tied.Union(sensors.first, sensors.second);
  }
  return tied;
}

}  // namespace

void SeparateUntiedSensors(const Scene& scene, Reconstruction* reconstruction) {
  std::vector<Point3D>& points = reconstruction->points;
  UnionFind tied = TiedSensors(scene, points);
  for (Point3D& point : points) {
    std::map<size_t, int> num_observations;  // of sets of tied sensors
    for (const Observation& o : point.track) {
      ++num_observations[tied.Find(SensorOf(scene, o))];
    }
    if (num_observations.size() == 1) continue;
    const size_t most =
        std::max_element(
            num_observations.begin(), num_observations.end(),
            [](const auto& a, const auto& b) { return a.second < b.second; })
            ->first;
    EraseIf(&point.track, [&](const Observation& o) {
      return tied.Find(SensorOf(scene, o)) != most;
    });
  }
  EraseIf(&points, [](const Point3D& point) { return point.track.size() < 2; });
}

namespace {

std::vector<int> CountFrameObservations(const BundleProblem& problem) {
  std::vector<int> counts(problem.frame_masks.size(), 0);
  for (const PixelObservation& o : problem.observations) {
    ++counts[problem.images[o.image].frame];
  }
  return counts;
}

// Whether a frame has images of two sensors at different centers that are fixed
// or have priors.
bool ScaleIsObservable(const BundleState& state, const BundleProblem& problem) {
  Mask has_prior(problem.sensor_masks.size(), false);
  for (const SensorPrior& prior : problem.sensor_priors) {
    has_prior[prior.sensor] = !prior.factor.rightCols<3>().isZero(0.0);
  }
  std::vector<std::optional<Eigen::Vector3d>> fixed_center(state.frames.size());
  for (const BundleProblem::Image& image : problem.images) {
    const PoseMask& mask = problem.sensor_masks[image.sensor];
    if (!mask.tail<3>().isZero(0.0) && !has_prior[image.sensor]) continue;
    const Eigen::Vector3d center = state.sensors[image.sensor].Center();
    std::optional<Eigen::Vector3d>& other = fixed_center[image.frame];
    if (!other) {
      other = center;
    } else if (*other != center) {
      return true;
    }
  }
  return false;
}

int LargestCoordinate(const Eigen::Vector3d& v) {
  int axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return axis;
}

// A frame at the 75 % quantile of the distances from `origin`: far, but robust
// to frames with wrong, distant positions.
int DistantFrame(const BundleState& state, const Eigen::Vector3d& origin) {
  std::vector<std::pair<double, int>> distances;
  for (size_t i = 0; i < state.frames.size(); ++i) {
    distances.emplace_back((state.frames[i].center - origin).norm(),
                           static_cast<int>(i));
  }
  const auto nth = distances.begin() + (distances.size() * 3) / 4;
  std::nth_element(distances.begin(), nth, distances.end());
  return nth->second;
}

// Fixes the largest coordinate that is proportional to scale.
void FixScale(const BundleState& state, int fixed_frame,
              BundleProblem* problem) {
  const Eigen::Vector3d& origin = state.frames[fixed_frame].center;
  const int frame = DistantFrame(state, origin);
  const Eigen::Vector3d to_frame = state.frames[frame].center - origin;
  double* fixed = nullptr;
  double largest = 0.0;
  const auto consider = [&](const Eigen::Vector3d& v, PoseMask* mask) {
    const int axis = LargestCoordinate(v);
    if (std::abs(v[axis]) <= largest || (*mask)[3 + axis] == 0.0) return;
    largest = std::abs(v[axis]);
    fixed = &(*mask)[3 + axis];
  };
  consider(to_frame, &problem->frame_masks[frame]);
  for (size_t i = 0; i < state.sensors.size(); ++i) {
    consider(state.sensors[i].translation, &problem->sensor_masks[i]);
  }
  if (fixed != nullptr) *fixed = 0.0;
}

// Gravity terms leave only the rotation about gravity free, which is not a
// coordinate of a frame. A weak heading prior fixes it, with negligible
// influence on the tilt.
void FixHeading(const BundleState& state, int frame, BundleProblem* problem) {
  const GravityPrior& level = problem->gravity_priors.front();
  for (size_t i = 0; i < problem->images.size(); ++i) {
    const BundleProblem::Image& image = problem->images[i];
    if (image.frame != frame) continue;
    GravityPrior heading;
    heading.image = static_cast<int>(i);
    heading.down = level.down.unitOrthogonal();
    heading.direction = state.sensors[image.sensor].rotation *
                        (state.frames[frame].rig_from_world * heading.down);
    // 11 degrees: weak compared with the gravity terms.
    heading.sigma_rad = 0.2;
    problem->frame_masks[frame].tail<3>().setZero();
    problem->gravity_priors.push_back(heading);
    return;
  }
}

// Fixes the frame with the most observations and returns it; nullopt if there
// are no frames.
std::optional<int> FixFrame(const BundleState& state, BundleProblem* problem) {
  const std::vector<int> counts = CountFrameObservations(*problem);
  if (counts.empty()) return std::nullopt;
  const int fixed_frame = static_cast<int>(
      std::max_element(counts.begin(), counts.end()) - counts.begin());
  if (problem->gravity_priors.empty() ||
      problem->frame_masks[fixed_frame].head<3>().isZero(0.0)) {
    problem->frame_masks[fixed_frame].setZero();
  } else {
    FixHeading(state, fixed_frame, problem);
  }
  return fixed_frame;
}

}  // namespace

void FixGauge(const BundleState& state, BundleProblem* problem) {
  const std::optional<int> fixed_frame = FixFrame(state, problem);
  if (fixed_frame && !ScaleIsObservable(state, *problem)) {
    FixScale(state, *fixed_frame, problem);
  }
}

void FixGaugeAndScale(const BundleState& state, BundleProblem* problem) {
  const std::optional<int> fixed_frame = FixFrame(state, problem);
  if (fixed_frame) FixScale(state, *fixed_frame, problem);
}

}  // namespace mgsfm
