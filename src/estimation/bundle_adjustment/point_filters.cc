// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/point_filters.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/ranges.h"
#include "geometry/triangulation.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "scene/point_lookup.h"

namespace mgsfm {

double ImageView::ReprojectionError(const Eigen::Vector3d& point,
                                    const Eigen::Vector2d& pixel) const {
  const std::optional<Eigen::Vector2d> projected = Project(point);
  if (!projected) return std::numeric_limits<double>::infinity();
  return (*projected - pixel).norm();
}

ImageView MakeImageView(const Scene& scene,
                        const Reconstruction& reconstruction, int image_idx) {
  const std::optional<Rigid3> pose =
      reconstruction.CamFromWorld(scene, image_idx);
  if (!pose) return {};
  const Camera& camera =
      reconstruction.cameras[scene.images[image_idx].camera_idx];
  return {true, pose->rotation.toRotationMatrix(), pose->Center(), camera.model,
          camera.params.data()};
}

std::vector<ImageView> MakeImageViews(const Scene& scene,
                                      const Reconstruction& reconstruction) {
  std::vector<ImageView> views;
  views.reserve(scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    views.push_back(MakeImageView(scene, reconstruction, static_cast<int>(i)));
  }
  return views;
}

double ReprojectionError(const Scene& scene,
                         const std::vector<ImageView>& views,
                         const Observation& o, const Eigen::Vector3d& point) {
  return views[o.image_idx].ReprojectionError(
      point,
      scene.images[o.image_idx].keypoints_px[o.keypoint_idx].cast<double>());
}

namespace {

std::vector<Eigen::Vector3d> CentersOf(const std::vector<ImageView>& views,
                                       const Point3D& point) {
  std::vector<Eigen::Vector3d> centers;
  centers.reserve(point.track.size());
  for (const Observation& o : point.track) {
    if (views[o.image_idx].is_registered) {
      centers.push_back(views[o.image_idx].center);
    }
  }
  return centers;
}

// The offset of the errors of each point in ReprojectionErrors(), followed by
// the number of all errors.
std::vector<size_t> FirstErrorOfPoints(const Scene& scene,
                                       const Reconstruction& reconstruction) {
  std::vector<size_t> begin = {0};
  for (const Point3D& point : reconstruction.points) {
    const auto num_registered = CountIf(point.track, [&](const Observation& o) {
      return reconstruction.IsRegistered(scene, o.image_idx);
    });
    begin.push_back(begin.back() + num_registered);
  }
  return begin;
}

}  // namespace

std::vector<double> ReprojectionErrors(const Scene& scene,
                                       const Reconstruction& reconstruction,
                                       int num_threads) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  const std::vector<size_t> begin = FirstErrorOfPoints(scene, reconstruction);
  std::vector<double> errors(begin.back());
  ParallelFor(
      reconstruction.points.size(), num_threads,
      [&](size_t i) {
        const Point3D& point = reconstruction.points[i];
        size_t k = begin[i];
        for (const Observation& o : point.track) {
          if (!views[o.image_idx].is_registered) continue;
          errors[k++] =
              ReprojectionError(scene, views, o, point.point_in_world);
        }
      },
      256);
  return errors;
}

double NoiseSigmaPx(const Scene& scene, const Reconstruction& reconstruction,
                    int num_threads) {
  std::vector<double> errors =
      ReprojectionErrors(scene, reconstruction, num_threads);
  const std::vector<size_t> begin = FirstErrorOfPoints(scene, reconstruction);
  size_t num_kept = 0;
  for (size_t i = 0; i < reconstruction.points.size(); ++i) {
    const size_t num_residuals = 2 * (begin[i + 1] - begin[i]);
    if (num_residuals <= 3) continue;
    const double factor = std::sqrt(static_cast<double>(num_residuals) /
                                    static_cast<double>(num_residuals - 3));
    for (size_t k = begin[i]; k < begin[i + 1]; ++k) {
      errors[num_kept++] = factor * errors[k];
    }
  }
  errors.resize(num_kept);
  return errors.empty() ? 0.0 : RobustSigma<2>(std::move(errors));
}

double UnbiasedNoiseSigmaPx(const Scene& scene,
                            const Reconstruction& reconstruction,
                            int num_threads) {
  const std::vector<double> errors =
      ReprojectionErrors(scene, reconstruction, num_threads);
  const std::vector<size_t> begin = FirstErrorOfPoints(scene, reconstruction);
  std::vector<double> variances;
  for (size_t i = 0; i < reconstruction.points.size(); ++i) {
    const int num_freedoms = 2 * static_cast<int>(begin[i + 1] - begin[i]) - 3;
    if (num_freedoms <= 0) continue;
    double sum = 0.0;
    for (size_t k = begin[i]; k < begin[i + 1]; ++k)
      sum += errors[k] * errors[k];
    variances.push_back(sum / MedianOfChiSquare(num_freedoms));
  }
  return variances.empty() ? 0.0 : std::sqrt(Median(std::move(variances)));
}

bool IsWellPlaced(const std::vector<Eigen::Vector3d>& centers,
                  const Eigen::Vector3d& point,
                  const PointFilterOptions& options) {
  double min_distance = 0.0;
  double min_angle_rad = options.min_angle_rad;
  if (centers.size() == 2) {
    min_distance = options.min_two_view_distance;
    min_angle_rad = std::max(min_angle_rad, options.min_two_view_angle_rad);
  }
  const double distance = NearestDistance(centers, point);
  return distance >= min_distance && distance <= options.max_distance &&
         (min_angle_rad <= 0.0 ||
          MaxTriangulationAngle(centers, point, min_angle_rad) >=
              min_angle_rad);
}

bool IsSeenTwice(const Scene& scene, const std::vector<Observation>& track) {
  std::vector<int> frame_idxs = Transformed(track, [&](const Observation& o) {
    return scene.images[o.image_idx].frame_idx;
  });
  std::sort(frame_idxs.begin(), frame_idxs.end());
  return std::adjacent_find(frame_idxs.begin(), frame_idxs.end()) !=
         frame_idxs.end();
}

bool IsDistanceMeasured(const Scene& scene,
                        const std::vector<Observation>& track, double distance,
                        const PointFilterOptions& options) {
  if (distance <= options.max_distance_of_one_image ||
      options.sensor_measures_distances.empty()) {
    return true;
  }
  const bool can_be_measured = AnyOf(track, [&](const Observation& o) {
    return options
        .sensor_measures_distances[scene.images[o.image_idx].sensor_idx];
  });
  return !can_be_measured || IsSeenTwice(scene, track);
}

Mask FindSensorsThatMeasure(const Scene& scene,
                            const Reconstruction& reconstruction,
                            const std::vector<double>& distances,
                            double min_distance) {
  std::vector<size_t> num_distant(scene.sensors.size(), 0);
  std::vector<size_t> num_measured(scene.sensors.size(), 0);
  for (size_t i = 0; i < distances.size(); ++i) {
    if (distances[i] <= min_distance) continue;
    const std::vector<Observation>& track = reconstruction.points[i].track;
    const bool is_measured = IsSeenTwice(scene, track);
    for (const Observation& o : track) {
      const int sensor_idx = scene.images[o.image_idx].sensor_idx;
      ++num_distant[sensor_idx];
      num_measured[sensor_idx] += is_measured;
    }
  }
  Mask measures(scene.sensors.size(), false);
  for (size_t s = 0; s < num_distant.size(); ++s) {
    measures[s] = 2 * num_measured[s] > num_distant[s];
  }
  return measures;
}

bool IsPrecise(double sum_of_squares_px2, size_t num_observations,
               const PointFilterOptions& options) {
  return sum_of_squares_px2 <= static_cast<double>(num_observations) *
                                   options.max_rms_error_px *
                                   options.max_rms_error_px;
}

void FilterPoints(const Scene& scene, const PointFilterOptions& options,
                  int num_threads, Reconstruction* reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, *reconstruction);
  std::vector<Point3D>& points = reconstruction->points;
  ParallelFor(
      points.size(), num_threads,
      [&](size_t i) {
        Point3D& point = points[i];
        double sum_of_squares = 0.0;
        const auto is_outlier = [&](const Observation& o) {
          if (!views[o.image_idx].is_registered) return true;
          const double error =
              ReprojectionError(scene, views, o, point.point_in_world);
          if (!(error <= options.max_error_px)) return true;
          sum_of_squares += error * error;
          return false;
        };
        EraseIf(&point.track, is_outlier);
        const std::vector<Eigen::Vector3d> centers = CentersOf(views, point);
        if (static_cast<int>(point.track.size()) <
                options.min_num_observations ||
            !IsPrecise(sum_of_squares, point.track.size(), options) ||
            !IsWellPlaced(centers, point.point_in_world, options) ||
            !IsDistanceMeasured(scene, point.track,
                                NearestDistance(centers, point.point_in_world),
                                options)) {
          point.track.clear();
        }
      },
      256);
  EraseIf(&points, [](const Point3D& point) { return point.track.empty(); });
}

double NearestDistance(const std::vector<Eigen::Vector3d>& centers,
                       const Eigen::Vector3d& point) {
  double squared = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& center : centers) {
    squared = std::min(squared, (center - point).squaredNorm());
  }
  return std::sqrt(squared);
}

std::vector<double> PointDistances(const Scene& scene,
                                   const Reconstruction& reconstruction,
                                   int num_threads) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  std::vector<double> distances(reconstruction.points.size());
  ParallelFor(
      distances.size(), num_threads,
      [&](size_t i) {
        const Point3D& point = reconstruction.points[i];
        distances[i] =
            NearestDistance(CentersOf(views, point), point.point_in_world);
      },
      256);
  return distances;
}

double MedianDistance(const Scene& scene, const Reconstruction& reconstruction,
                      int num_threads) {
  std::vector<double> distances =
      PointDistances(scene, reconstruction, num_threads);
  return distances.empty() ? std::numeric_limits<double>::infinity()
                           : Median(std::move(distances));
}

void ComputePointErrors(const Scene& scene, int num_threads,
                        Reconstruction* reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, *reconstruction);
  ParallelFor(
      reconstruction->points.size(), num_threads,
      [&](size_t i) {
        Point3D& point = reconstruction->points[i];
        double sum = 0.0;
        int num_observations = 0;
        for (const Observation& o : point.track) {
          if (!views[o.image_idx].is_registered) continue;
          const double error =
              ReprojectionError(scene, views, o, point.point_in_world);
          if (!std::isfinite(error)) continue;
          sum += error;
          ++num_observations;
        }
        point.error_px.reset();
        if (num_observations > 0) point.error_px = sum / num_observations;
      },
      256);
}

namespace {

// Per point: the matches of its observations that contradict it. Their number
// does not depend on the order in which threads count them.
std::vector<std::atomic<int>> CountContradictions(
    const Scene& scene, const ViewGraph& matches, double max_error_px,
    int num_threads, const Reconstruction& reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  const PointLookup lookup(scene, reconstruction);
  std::vector<std::atomic<int>> num_contradictions(
      reconstruction.points.size());
  const auto test = [&](int point_idx, const ImageView& view,
                        const Eigen::Vector2f& keypoint_px) {
    const double error_px =
        view.ReprojectionError(reconstruction.points[point_idx].point_in_world,
                               keypoint_px.cast<double>());
    if (error_px <= max_error_px) return;
    num_contradictions[point_idx].fetch_add(1, std::memory_order_relaxed);
  };
  ParallelFor(
      matches.pairs.size(), num_threads,
      [&](size_t i) {
        const ImagePair& pair = matches.pairs[i];
        const ImageView& view1 = views[pair.image_idx1];
        const ImageView& view2 = views[pair.image_idx2];
        if (!view1.is_registered || !view2.is_registered) return;
        const auto& keypoints1 = scene.images[pair.image_idx1].keypoints_px;
        const auto& keypoints2 = scene.images[pair.image_idx2].keypoints_px;
        for (const Match& m : pair.matches) {
          const auto p1 = lookup.Find(pair.image_idx1, m.keypoint_idx1);
          const auto p2 = lookup.Find(pair.image_idx2, m.keypoint_idx2);
          if (p1 == p2) continue;
          if (p1) test(*p1, view2, keypoints2[m.keypoint_idx2]);
          if (p2) test(*p2, view1, keypoints1[m.keypoint_idx1]);
        }
      },
      /*block_size=*/16);
  return num_contradictions;
}

}  // namespace

void RemoveContradictedPoints(const Scene& scene, const ViewGraph& matches,
                              double max_error_px, double min_match_share,
                              int num_threads, Reconstruction* reconstruction) {
  if (min_match_share <= 0.0) return;
  const auto num_contradictions = CountContradictions(
      scene, matches, max_error_px, num_threads, *reconstruction);
  std::vector<Point3D>& points = reconstruction->points;
  size_t num_kept = 0;
  for (size_t p = 0; p < points.size(); ++p) {
    const auto n = static_cast<double>(points[p].track.size());
    const double num_agreeing = n * (n - 1.0);
    if (num_agreeing <
        min_match_share * (num_agreeing + num_contradictions[p])) {
      continue;
    }
    if (num_kept != p) points[num_kept] = std::move(points[p]);
    ++num_kept;
  }
  points.resize(num_kept);
}

}  // namespace mgsfm
