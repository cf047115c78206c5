// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "translation_averaging/position_problem.h"

namespace mgsfm {

// The tracks with the rays of their observations in world axes.
struct TrackRays {
  const ObservationGroups& tracks;
  // Per item of tracks.observations. A ray is defined only if its keypoint has
  // a ray and its image has a rotation.
  std::vector<Eigen::Vector3d> rays_in_world;
  Mask has_ray;
};

TrackRays ComputeTrackRays(const PositionProblem& problem,
                           const Bearings& bearings,
                           const ObservationGroups& tracks, int num_threads);

struct TrackPoints {
  std::vector<std::optional<Eigen::Vector3d>> point_in_world;  // per track
  // Per observation of the tracks: whether it agrees with its point.
  Mask observation_is_used;
};

struct PositionsAndPoints {
  Positions positions;
  TrackPoints points;
};

struct TrackPointOptions {
  double max_error_rad = 0.0;  // of an observation
  double min_angle_rad = 0.0;  // between two rays of a point
  // Lower bound of the distance to the cameras that see the point. Rays from
  // nearly one center seem to meet close to it, wherever the point is.
  double min_depth = 0.0;
};

// Triangulates all tracks: the previous point if all observations agree with
// it, else the L1 solution if all agree with it, else the robust solution.
// `previous` has no points or one item per track. Parallel over tracks.
TrackPoints TriangulateTracks(const PositionProblem& problem,
                              const TrackRays& rays, const Positions& positions,
                              const TrackPointOptions& options, int num_threads,
                              TrackPoints previous = {});

// Places frames without a position by the points that they see: the frame
// center is the intersection of the lines of sight.
struct FramePlacement {
  Positions positions;
  int num_placed = 0;
};
FramePlacement PlaceFramesByPoints(const PositionProblem& problem,
                                   const TrackRays& rays,
                                   const TrackPoints& points,
                                   double max_error_rad, int num_threads,
                                   Positions positions);

// Robust standard deviation per axis of the angular errors of used
// observations; 0 without any.
double AngularSigma(const PositionProblem& problem, const TrackRays& rays,
                    const TrackPoints& points, const Positions& positions);

// Tracks for estimating positions: the longest first, until every image has at
// least `min_per_image` observations or no tracks are left. 0 selects all
// tracks with a point.
std::vector<size_t> SelectTracks(const TrackRays& rays,
                                 const TrackPoints& points, int num_images,
                                 int min_per_image);

}  // namespace mgsfm
