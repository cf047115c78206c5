// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/retriangulation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "geometry/triangulation.h"
#include "math/item_groups.h"

namespace mgsfm {
namespace {

// A keypoint of a group that does not belong to an accepted point yet.
struct Candidate {
  Observation observation;
  const ImageView* view = nullptr;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};
using Candidates = std::vector<Candidate>;  // sorted by observation

// A point and the candidates that agree with it.
struct Hypothesis {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  std::vector<int> inliers;  // ascending, at most one per image
  double squared_error = 0.0;

  bool IsBetterThan(const Hypothesis& other) const {
    return inliers.size() != other.inliers.size()
               ? inliers.size() > other.inliers.size()
               : squared_error < other.squared_error;
  }
};

Candidates CollectCandidates(const Scene& scene,
                             const std::vector<ImageView>& views,
                             const Observation* begin, const Observation* end) {
  Candidates candidates;
  for (const Observation* o = begin; o != end; ++o) {
    const ImageView& view = views[o->image_idx];
    if (!view.is_registered) continue;
    candidates.push_back({*o, &view,
                          scene.images[o->image_idx]
                              .keypoints_px[o->keypoint_idx]
                              .cast<double>()});
  }
  return candidates;
}

int NumImages(const Candidates& candidates) {
  int num_images = 0;
  for (size_t i = 0; i < candidates.size(); ++i) {
    num_images += i == 0 || candidates[i].view != candidates[i - 1].view;
  }
  return num_images;
}

Hypothesis FindInliers(const Candidates& candidates, double max_error_px,
                       const Eigen::Vector3d& point) {
  Hypothesis hypothesis;
  hypothesis.point = point;
  double last_error = 0.0;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& candidate = candidates[i];
    const double error =
        candidate.view->ReprojectionError(point, candidate.pixel);
    if (!(error <= max_error_px)) continue;
    const bool is_same_image =
        !hypothesis.inliers.empty() &&
        candidates[hypothesis.inliers.back()].view == candidate.view;
    if (is_same_image) {
      if (error >= last_error) continue;
      hypothesis.squared_error -= last_error * last_error;
      hypothesis.inliers.pop_back();
    }
    hypothesis.inliers.push_back(static_cast<int>(i));
    hypothesis.squared_error += error * error;
    last_error = error;
  }
  return hypothesis;
}

// The Gauss-Newton step of the point on the reprojection errors of its inliers;
// nullopt if undefined.
std::optional<Eigen::Vector3d> GaussNewtonStep(const Candidates& candidates,
                                               const Hypothesis& hypothesis) {
  Eigen::Matrix3d lhs = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
  for (const int i : hypothesis.inliers) {
    const Candidate& candidate = candidates[i];
    Eigen::Matrix<double, 2, 3> by_camera;
    const Eigen::Vector2d residual =
        *candidate.view->Project(hypothesis.point, &by_camera) -
        candidate.pixel;
    const Eigen::Matrix<double, 2, 3> jacobian =
        by_camera * candidate.view->cam_from_world;
    lhs += jacobian.transpose() * jacobian;
    rhs -= jacobian.transpose() * residual;
  }
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(lhs);
  const Eigen::Vector3d step = ldlt.solve(rhs);
  if (ldlt.info() != Eigen::Success || !step.allFinite()) return std::nullopt;
  return step;
}

// Takes Gauss-Newton steps as long as they improve the hypothesis.
Hypothesis RefineHypothesis(const Candidates& candidates, double max_error_px,
                            Hypothesis hypothesis) {
  // The start is a triangulated point, so the steps converge quadratically.
  for (int i = 0; i < 3; ++i) {
    if (hypothesis.inliers.size() < 2) break;
    const auto step = GaussNewtonStep(candidates, hypothesis);
    if (!step) break;
    Hypothesis next =
        FindInliers(candidates, max_error_px, hypothesis.point + *step);
    if (!next.IsBetterThan(hypothesis)) break;
    const bool has_converged =
        next.inliers == hypothesis.inliers &&
        next.squared_error > 0.99 * hypothesis.squared_error;
    hypothesis = std::move(next);
    if (has_converged) break;
  }
  return hypothesis;
}

std::optional<Eigen::Vector3d> TriangulateAll(const Candidates& candidates,
                                              double max_error_px) {
  std::vector<Eigen::Vector3d> centers, rays;
  double max_error_rad = 0.0;
  for (const Candidate& candidate : candidates) {
    const ImageView& view = *candidate.view;
    const auto ray = RayFromPixel(view.model, view.params, candidate.pixel);
    if (!ray) continue;
    centers.push_back(view.center);
    rays.emplace_back(view.cam_from_world.transpose() * *ray);
    max_error_rad = std::max(
        max_error_rad, max_error_px / PixelsPerRadian(view.model, view.params));
  }
  RobustTriangulationOptions robust;
  robust.max_error_rad = max_error_rad;
  const auto result = TriangulateRobust(centers, rays, robust);
  if (!result) return std::nullopt;
  return result->point;
}

Hypothesis FindBestHypothesis(const Candidates& candidates, double max_error_px,
                              const std::vector<Eigen::Vector3d>& old_points) {
  Hypothesis best;
  const auto consider = [&](const Eigen::Vector3d& point) {
    Hypothesis hypothesis = RefineHypothesis(
        candidates, max_error_px, FindInliers(candidates, max_error_px, point));
    if (hypothesis.IsBetterThan(best)) best = std::move(hypothesis);
  };
  for (const Eigen::Vector3d& point : old_points) consider(point);
  if (static_cast<int>(best.inliers.size()) == NumImages(candidates)) {
    return best;
  }
  if (const auto point = TriangulateAll(candidates, max_error_px)) {
    consider(*point);
  }
  return best;
}

bool IsAcceptable(const Scene& scene, const Candidates& candidates,
                  const Hypothesis& hypothesis, int min_num_inliers,
                  const PointFilterOptions& options) {
  if (static_cast<int>(hypothesis.inliers.size()) < min_num_inliers ||
      !IsPrecise(hypothesis.squared_error, hypothesis.inliers.size(),
                 options)) {
    return false;
  }
  const std::vector<Eigen::Vector3d> centers = Transformed(
      hypothesis.inliers, [&](int i) { return candidates[i].view->center; });
  if (!IsWellPlaced(centers, hypothesis.point, options)) return false;
  const std::vector<Observation> track = Transformed(
      hypothesis.inliers, [&](int i) { return candidates[i].observation; });
  return IsDistanceMeasured(
      scene, track, NearestDistance(centers, hypothesis.point), options);
}

// Moves the inliers from the candidates to a new point.
Point3D MakePoint(const Hypothesis& hypothesis, Candidates* candidates) {
  Point3D point;
  point.point_in_world = hypothesis.point;
  point.track.reserve(hypothesis.inliers.size());
  size_t next = 0;
  size_t num_left = 0;
  for (size_t i = 0; i < candidates->size(); ++i) {
    if (next < hypothesis.inliers.size() &&
        hypothesis.inliers[next] == static_cast<int>(i)) {
      point.track.push_back((*candidates)[i].observation);
      ++next;
    } else {
      (*candidates)[num_left++] = (*candidates)[i];
    }
  }
  candidates->resize(num_left);
  return point;
}

// Marks keypoints and points without a group. An int instead of std::optional
// saves memory.
constexpr int kNoGroup = -1;

// Per point, the group of its first observation that is in a group, or
// kNoGroup.
std::vector<int> FindGroups(const Scene& scene, const ObservationGroups& groups,
                            const std::vector<Point3D>& points) {
  std::vector<size_t> first_of_image = {0};
  for (const Image& image : scene.images) {
    first_of_image.push_back(first_of_image.back() + image.keypoints_px.size());
  }
  std::vector<int> group_of_keypoint(first_of_image.back(), kNoGroup);
  const auto group_of = [&](const Observation& o) -> int& {
    return group_of_keypoint[first_of_image[o.image_idx] + o.keypoint_idx];
  };
  for (size_t g = 0; g < groups.size(); ++g) {
    for (const Observation* o = groups.begin(g); o != groups.end(g); ++o) {
      group_of(*o) = static_cast<int>(g);
    }
  }
  std::vector<int> group_of_point;
  for (const Point3D& point : points) {
    const auto in_group = std::find_if(
        point.track.begin(), point.track.end(),
        [&](const Observation& o) { return group_of(o) != kNoGroup; });
    group_of_point.push_back(
        in_group == point.track.end() ? kNoGroup : group_of(*in_group));
  }
  return group_of_point;
}

// Bounds the memory of points that are not yet in the model.
constexpr size_t kGroupsAtATime = 4096;

std::vector<Eigen::Vector3d> PointsOfGroup(
    const ItemGroups<int>& points_of_group,
    const std::vector<Eigen::Vector3d>& points, size_t g) {
  std::vector<Eigen::Vector3d> of_group;
  for (const int* i = points_of_group.begin(g); i != points_of_group.end(g);
       ++i) {
    of_group.push_back(points[*i]);
  }
  return of_group;
}

}  // namespace

std::vector<Point3D> TriangulateGroup(
    const Scene& scene, const std::vector<ImageView>& views,
    const Observation* begin, const Observation* end,
    const std::vector<Eigen::Vector3d>& old_points,
    const PointFilterOptions& options) {
  Candidates candidates = CollectCandidates(scene, views, begin, end);
  const int min_num_inliers =
      std::max({2, options.min_num_observations,
                static_cast<int>(std::ceil(options.min_group_share *
                                           NumImages(candidates)))});
  std::vector<Point3D> points;
  while (candidates.size() >= 2) {
    const Hypothesis best =
        FindBestHypothesis(candidates, options.max_error_px, old_points);
    if (!IsAcceptable(scene, candidates, best, min_num_inliers, options)) break;
    points.push_back(MakePoint(best, &candidates));
  }
  return points;
}

void Retriangulate(const Scene& scene, const ObservationGroups& groups,
                   const PointFilterOptions& options, int num_threads,
                   Reconstruction* reconstruction) {
  PointFilterOptions visible;
  visible.max_error_px = std::numeric_limits<double>::max();
  visible.min_num_observations = 1;
  FilterPoints(scene, visible, num_threads, reconstruction);
  const std::vector<int> group_of_point =
      FindGroups(scene, groups, reconstruction->points);
  const auto points_of_group =
      GroupItems<int>(groups.size(), [&](const auto& add) {
        for (size_t i = 0; i < group_of_point.size(); ++i) {
          if (group_of_point[i] != kNoGroup) add(group_of_point[i], i);
        }
      });

  const std::vector<ImageView> views = MakeImageViews(scene, *reconstruction);
  // Keeps only positions, so that a model is not in memory twice.
  std::vector<Eigen::Vector3d> old_points;
  old_points.reserve(reconstruction->points.size());
  std::vector<Point3D> kept;
  for (size_t i = 0; i < reconstruction->points.size(); ++i) {
    Point3D& point = reconstruction->points[i];
    old_points.push_back(point.point_in_world);
    if (group_of_point[i] == kNoGroup) kept.push_back(std::move(point));
  }
  reconstruction->points = std::move(kept);
  FilterPoints(scene, options, num_threads, reconstruction);
  std::vector<Point3D> result = std::move(reconstruction->points);
  result.reserve(result.size() + groups.size());
  for (size_t begin = 0; begin < groups.size(); begin += kGroupsAtATime) {
    const size_t end = std::min(groups.size(), begin + kGroupsAtATime);
    std::vector<std::vector<Point3D>> points(end - begin);
    ParallelFor(points.size(), num_threads, [&](size_t i) {
      const size_t g = begin + i;
      points[i] = TriangulateGroup(
          scene, views, groups.begin(g), groups.end(g),
          PointsOfGroup(points_of_group, old_points, g), options);
    });
    for (std::vector<Point3D>& of_group : points) {
      for (Point3D& point : of_group) result.push_back(std::move(point));
    }
  }
  reconstruction->points = std::move(result);
}

}  // namespace mgsfm
