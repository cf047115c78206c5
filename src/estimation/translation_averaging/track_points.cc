// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/track_points.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"
#include "geometry/triangulation.h"
#include "math/robust_scale.h"
#include "mgsfm/base/mask.h"
#include "scene/track_coverage.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Lines of sight that must agree on the center of a frame; two determine it.
// Half or twice as many change no error (docs/results/constants.md).
constexpr int kMinNumResectionPoints = 6;

// The usable rays of one track.
struct OneTrack {
  std::vector<Vector3d> centers;
  std::vector<Vector3d> rays;
  std::vector<size_t> observation_idxs;
};

OneTrack CollectTrack(const PositionProblem& problem, const TrackRays& rays,
                      const Positions& positions, size_t track_idx) {
  OneTrack track;
  for (size_t k = rays.tracks.offsets[track_idx];
       k < rays.tracks.offsets[track_idx + 1]; ++k) {
    const int image_idx = rays.tracks.observations[k].image_idx;
    if (!rays.has_ray[k] || !positions.IsPlaced(problem, image_idx)) {
      continue;
    }
    track.centers.push_back(positions.CamCenter(problem, image_idx));
    track.rays.push_back(rays.rays_in_world[k]);
    track.observation_idxs.push_back(k);
  }
  return track;
}

struct AcceptedPoint {
  Vector3d point;
  Mask is_inlier;  // per ray of the track
};

// The point, if at least `min_num_inliers` observations agree with it, two of
// them at a sufficient angle.
std::optional<AcceptedPoint> Accept(const OneTrack& track,
                                    const TrackPointOptions& options,
                                    const Vector3d& point,
                                    size_t min_num_inliers) {
  AcceptedPoint accepted{point, Mask(track.rays.size(), false)};
  std::vector<Vector3d> centers;
  for (size_t k = 0; k < track.rays.size(); ++k) {
    if (!(AngularError(track.centers[k], track.rays[k], point) <
          options.max_error_rad) ||
        (point - track.centers[k]).norm() < options.min_depth) {
      continue;
    }
    accepted.is_inlier[k] = true;
    centers.push_back(track.centers[k]);
  }
  if (centers.size() < std::max<size_t>(min_num_inliers, 2) ||
      !(MaxTriangulationAngle(centers, point) >= options.min_angle_rad)) {
    return std::nullopt;
  }
  return accepted;
}

std::optional<AcceptedPoint> TriangulateTrack(
    const OneTrack& track, const TrackPointOptions& options,
    const std::optional<Vector3d>& previous) {
  const size_t num_rays = track.rays.size();
  if (previous) {
    if (auto accepted = Accept(track, options, *previous, num_rays)) {
      return accepted;
    }
  }
  if (num_rays < 2) return std::nullopt;
  if (const auto l1 = TriangulateL1(track.centers, track.rays)) {
    if (auto accepted = Accept(track, options, *l1, num_rays)) return accepted;
  }
  const auto robust =
      TriangulateRobust(track.centers, track.rays,
                        {options.max_error_rad, options.min_angle_rad});
  if (!robust) return std::nullopt;
  return Accept(track, options, robust->point, 2);
}

// The center of a frame lies on the line from `point` along -ray.
struct LineOfSight {
  Vector3d point;
  Vector3d ray;
};

std::vector<std::vector<LineOfSight>> CollectLinesOfSight(
    const PositionProblem& problem, const TrackRays& rays,
    const TrackPoints& points, const Positions& positions) {
  std::vector<std::vector<LineOfSight>> lines(problem.num_frames);
  for (size_t t = 0; t < points.point_in_world.size(); ++t) {
    if (!points.point_in_world[t]) continue;
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      const int image_idx = rays.tracks.observations[k].image_idx;
      const int frame_idx = problem.frame_idx[image_idx];
      if (!rays.has_ray[k] || positions.frame_is_placed[frame_idx]) {
        continue;
      }
      // Shifts the line from the camera center to the frame center.
      const Vector3d offset =
          *problem.world_from_cam[image_idx] *
          positions.sensor_translation[problem.sensor_idx[image_idx]];
      lines[frame_idx].push_back(
          {*points.point_in_world[t] + offset, rays.rays_in_world[k]});
    }
  }
  return lines;
}

}  // namespace

TrackRays ComputeTrackRays(const PositionProblem& problem,
                           const Bearings& bearings,
                           const ObservationGroups& tracks, int num_threads) {
  TrackRays rays{tracks, {}, {}};
  rays.rays_in_world.resize(tracks.observations.size(), Vector3d::Zero());
  rays.has_ray.assign(tracks.observations.size(), false);
  ParallelFor(
      rays.rays_in_world.size(), num_threads,
      [&](size_t k) {
        const Observation& o = tracks.observations[k];
        const auto keypoint_idx = static_cast<int>(o.keypoint_idx);
        if (!problem.IsUsed(o.image_idx) ||
            !bearings.HasRay(o.image_idx, keypoint_idx)) {
          return;
        }
        rays.has_ray[k] = true;
        rays.rays_in_world[k] = *problem.world_from_cam[o.image_idx] *
                                bearings.Ray(o.image_idx, keypoint_idx);
      },
      4096);
  return rays;
}

TrackPoints TriangulateTracks(const PositionProblem& problem,
                              const TrackRays& rays, const Positions& positions,
                              const TrackPointOptions& options, int num_threads,
                              TrackPoints previous) {
  TrackPoints points = std::move(previous);
  points.point_in_world.resize(rays.tracks.size());
  points.observation_is_used.assign(rays.tracks.observations.size(), false);
  ParallelFor(
      rays.tracks.size(), num_threads,
      [&](size_t t) {
        const OneTrack track = CollectTrack(problem, rays, positions, t);
        auto& point = points.point_in_world[t];
        const auto accepted = TriangulateTrack(track, options, point);
        point.reset();
        if (!accepted) return;
        point = accepted->point;
        for (size_t k = 0; k < track.rays.size(); ++k) {
          points.observation_is_used[track.observation_idxs[k]] =
              accepted->is_inlier[k];
        }
      },
      256);
  return points;
}

FramePlacement PlaceFramesByPoints(const PositionProblem& problem,
                                   const TrackRays& rays,
                                   const TrackPoints& points,
                                   double max_error_rad, int num_threads,
                                   Positions positions) {
  const auto lines = CollectLinesOfSight(problem, rays, points, positions);
  Mask is_new(problem.num_frames, false);
  ParallelFor(problem.num_frames, num_threads, [&](size_t f) {
    if (lines[f].size() < kMinNumResectionPoints) return;
    std::vector<Vector3d> starts, directions;
    for (const LineOfSight& line : lines[f]) {
      starts.push_back(line.point);
      directions.emplace_back(-line.ray);
    }
    const auto center =
        TriangulateRobust(starts, directions, {max_error_rad, max_error_rad});
    if (!center || center->num_inliers < kMinNumResectionPoints) return;
    positions.frame_center[f] = center->point;
    is_new[f] = true;
  });
  for (int f = 0; f < problem.num_frames; ++f) {
    if (is_new[f]) positions.frame_is_placed[f] = true;
  }
  return {std::move(positions), static_cast<int>(is_new.Count())};
}

double AngularSigma(const PositionProblem& problem, const TrackRays& rays,
                    const TrackPoints& points, const Positions& positions) {
  std::vector<double> errors;
  for (size_t t = 0; t < rays.tracks.size(); ++t) {
    if (!points.point_in_world[t]) continue;
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      if (!points.observation_is_used[k]) continue;
      const int image_idx = rays.tracks.observations[k].image_idx;
      errors.push_back(AngularError(positions.CamCenter(problem, image_idx),
                                    rays.rays_in_world[k],
                                    *points.point_in_world[t]));
    }
  }
  return errors.empty() ? 0.0 : RobustSigma<2>(std::move(errors));
}

std::vector<size_t> SelectTracks(const TrackRays& rays,
                                 const TrackPoints& points, int num_images,
                                 int min_per_image) {
  std::vector<size_t> with_point;
  ObservationGroups used;
  for (size_t t = 0; t < rays.tracks.size(); ++t) {
    if (!points.point_in_world[t]) continue;
    with_point.push_back(t);
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      if (!points.observation_is_used[k]) continue;
      used.observations.push_back(rays.tracks.observations[k]);
    }
    used.FinishGroup();
  }
  if (min_per_image <= 0) return with_point;
  TrackCoverage coverage(used, static_cast<size_t>(num_images));
  coverage.Select(0, min_per_image);
  std::vector<size_t> selected;
  for (size_t i = 0; i < with_point.size(); ++i) {
    if (coverage.is_selected()[i]) selected.push_back(with_point[i]);
  }
  return selected;
}

}  // namespace mgsfm
