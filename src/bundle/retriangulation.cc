// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/retriangulation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "bundle/image_views.h"
#include "geometry/triangulation.h"
#include "math/index_groups.h"

namespace mgsfm {
namespace {

// A keypoint of the group that belongs to no accepted point yet.
struct Candidate {
  Observation observation;
  const ImageView* view = nullptr;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// A point and the candidates that agree with it.
struct Hypothesis {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  std::vector<int> inliers;  // ascending, no two of one image
  double squared_error = 0.0;

  bool IsBetterThan(const Hypothesis& other) const {
    return inliers.size() != other.inliers.size()
               ? inliers.size() > other.inliers.size()
               : squared_error < other.squared_error;
  }
};

class GroupTriangulator {
 public:
  GroupTriangulator(const Scene& scene, const std::vector<ImageView>& views,
                    const PointFilterOptions& options)
      : scene_(scene), views_(views), options_(options) {}

  std::vector<Point3D> Run(const Observation* begin, const Observation* end,
                           std::vector<Eigen::Vector3d> old_points) {
    old_points_ = std::move(old_points);
    CollectCandidates(begin, end);
    min_num_inliers_ = std::max(
        {2, options_.min_num_observations,
         static_cast<int>(std::ceil(options_.min_group_share * NumImages()))});
    std::vector<Point3D> points;
    while (candidates_.size() >= 2) {
      const Hypothesis best = FindBest();
      if (!IsAcceptable(best)) break;
      points.push_back(TakeOut(best));
    }
    return points;
  }

 private:
  void CollectCandidates(const Observation* begin, const Observation* end);
  Hypothesis FindBest();
  Hypothesis Agree(const Eigen::Vector3d& point) const;
  Hypothesis Polish(Hypothesis hypothesis) const;
  std::optional<Eigen::Vector3d> Triangulate() const;
  bool IsAcceptable(const Hypothesis& hypothesis) const;
  Point3D TakeOut(const Hypothesis& hypothesis);
  int NumImages() const;

  const Scene& scene_;
  const std::vector<ImageView>& views_;
  const PointFilterOptions& options_;
  std::vector<Candidate> candidates_;  // sorted by observation
  std::vector<Eigen::Vector3d> old_points_;
  int min_num_inliers_ = 2;  // of a point of this group
};

void GroupTriangulator::CollectCandidates(const Observation* begin,
                                          const Observation* end) {
  candidates_.clear();
  for (const Observation* o = begin; o != end; ++o) {
    const ImageView& view = views_[o->image_idx];
    if (!view.is_registered) continue;
    candidates_.push_back({*o, &view,
                           scene_.images[o->image_idx]
                               .keypoints_px[o->keypoint_idx]
                               .cast<double>()});
  }
}

int GroupTriangulator::NumImages() const {
  int num_images = 0;
  for (size_t i = 0; i < candidates_.size(); ++i) {
    num_images += i == 0 || candidates_[i].view != candidates_[i - 1].view;
  }
  return num_images;
}

Hypothesis GroupTriangulator::FindBest() {
  Hypothesis best;
  for (const Eigen::Vector3d& point : old_points_) {
    Hypothesis hypothesis = Polish(Agree(point));
    if (hypothesis.IsBetterThan(best)) best = std::move(hypothesis);
  }
  if (static_cast<int>(best.inliers.size()) == NumImages()) return best;
  if (const auto point = Triangulate()) {
    Hypothesis hypothesis = Polish(Agree(*point));
    if (hypothesis.IsBetterThan(best)) best = std::move(hypothesis);
  }
  return best;
}

Hypothesis GroupTriangulator::Agree(const Eigen::Vector3d& point) const {
  Hypothesis hypothesis;
  hypothesis.point = point;
  double last_error = 0.0;
  for (size_t i = 0; i < candidates_.size(); ++i) {
    const Candidate& candidate = candidates_[i];
    const double error =
        candidate.view->ReprojectionError(point, candidate.pixel);
    if (!(error <= options_.max_error_px)) continue;
    const bool is_same_image =
        !hypothesis.inliers.empty() &&
        candidates_[hypothesis.inliers.back()].view == candidate.view;
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

// Gauss-Newton steps on the squared reprojection errors of the inliers, as
// long as they make the hypothesis better.
Hypothesis GroupTriangulator::Polish(Hypothesis hypothesis) const {
  constexpr int kMaxNumSteps = 3;
  for (int step = 0; step < kMaxNumSteps; ++step) {
    if (hypothesis.inliers.size() < 2) break;
    Eigen::Matrix3d lhs = Eigen::Matrix3d::Zero();
    Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
    for (const int i : hypothesis.inliers) {
      const Candidate& candidate = candidates_[i];
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
    const Eigen::Vector3d change = ldlt.solve(rhs);
    if (ldlt.info() != Eigen::Success || !change.allFinite()) break;
    Hypothesis next = Agree(hypothesis.point + change);
    if (!next.IsBetterThan(hypothesis)) break;
    const bool is_settled =
        next.inliers == hypothesis.inliers &&
        next.squared_error > 0.99 * hypothesis.squared_error;
    hypothesis = std::move(next);
    if (is_settled) break;
  }
  return hypothesis;
}

std::optional<Eigen::Vector3d> GroupTriangulator::Triangulate() const {
  std::vector<Eigen::Vector3d> centers, rays;
  double max_error_rad = 0.0;
  for (const Candidate& candidate : candidates_) {
    const ImageView& view = *candidate.view;
    const auto ray = RayFromPixel(view.model, view.params, candidate.pixel);
    if (!ray) continue;
    centers.push_back(view.center);
    rays.emplace_back(view.cam_from_world.transpose() * *ray);
    max_error_rad =
        std::max(max_error_rad, options_.max_error_px /
                                    PixelsPerRadian(view.model, view.params));
  }
  RobustTriangulationOptions robust;
  robust.max_error_rad = max_error_rad;
  const auto result = TriangulateRobust(centers, rays, robust);
  if (!result) return std::nullopt;
  return result->point;
}

bool GroupTriangulator::IsAcceptable(const Hypothesis& hypothesis) const {
  const int num_inliers = static_cast<int>(hypothesis.inliers.size());
  if (num_inliers < min_num_inliers_) return false;
  std::vector<Eigen::Vector3d> centers;
  for (const int i : hypothesis.inliers) {
    centers.push_back(candidates_[i].view->center);
  }
  return IsWellPlaced(centers, hypothesis.point, options_);
}

Point3D GroupTriangulator::TakeOut(const Hypothesis& hypothesis) {
  Point3D point;
  point.point_in_world = hypothesis.point;
  size_t next = 0;
  size_t num_left = 0;
  for (size_t i = 0; i < candidates_.size(); ++i) {
    if (next < hypothesis.inliers.size() &&
        hypothesis.inliers[next] == static_cast<int>(i)) {
      point.track.push_back(candidates_[i].observation);
      ++next;
    } else {
      candidates_[num_left++] = candidates_[i];
    }
  }
  candidates_.resize(num_left);
  return point;
}

// Per observation of an image's keypoints: the group that holds it, or -1.
class GroupLookup {
 public:
  GroupLookup(const Scene& scene, const ObservationGroups& groups) {
    begin_ = {0};
    for (const Image& image : scene.images) {
      begin_.push_back(begin_.back() + image.keypoints_px.size());
    }
    group_.assign(begin_.back(), -1);
    for (size_t g = 0; g < groups.size(); ++g) {
      for (const Observation* o = groups.begin(g); o != groups.end(g); ++o) {
        group_[begin_[o->image_idx] + o->keypoint_idx] = static_cast<int>(g);
      }
    }
  }

  // The group of the first observation that is in one; -1: none is.
  int FindAny(const Point3D& point) const {
    for (const Observation& o : point.track) {
      const int group = group_[begin_[o.image_idx] + o.keypoint_idx];
      if (group >= 0) return group;
    }
    return -1;
  }

 private:
  std::vector<size_t> begin_;
  std::vector<int> group_;
};

}  // namespace

void Retriangulate(const Scene& scene, const ObservationGroups& groups,
                   const PointFilterOptions& options, int num_threads,
                   Reconstruction* reconstruction) {
  FilterPoints(
      scene,
      PointFilterOptions{std::numeric_limits<double>::max(), 1, 0.0, 0.0},
      num_threads, reconstruction);
  const GroupLookup lookup(scene, groups);
  std::vector<int> group_of_point;
  for (const Point3D& point : reconstruction->points) {
    group_of_point.push_back(lookup.FindAny(point));
  }
  const IndexGroups points_of_group = GroupByKey(group_of_point, groups.size());

  const std::vector<ImageView> views = MakeImageViews(scene, *reconstruction);
  std::vector<std::vector<Point3D>> points(groups.size());
  ParallelFor(groups.size(), num_threads, [&](size_t g) {
    std::vector<Eigen::Vector3d> old_points;
    for (size_t k = points_of_group.begin[g]; k < points_of_group.begin[g + 1];
         ++k) {
      old_points.push_back(
          reconstruction->points[points_of_group.items[k]].point_in_world);
    }
    points[g] = GroupTriangulator(scene, views, options)
                    .Run(groups.begin(g), groups.end(g), std::move(old_points));
  });

  std::vector<Point3D>& result = reconstruction->points;
  size_t num_kept = 0;
  for (size_t i = 0; i < result.size(); ++i) {
    if (group_of_point[i] < 0) std::swap(result[num_kept++], result[i]);
  }
  result.resize(num_kept);
  FilterPoints(scene, options, num_threads, reconstruction);
  for (std::vector<Point3D>& of_group : points) {
    for (Point3D& point : of_group) result.push_back(std::move(point));
  }
}

}  // namespace mgsfm
