// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "translation/position_problem.h"

namespace mgsfm {

// Tracks with the rays of their observations in world axes, in the order of
// tracks.observations.
struct TrackRays {
  const ObservationGroups& tracks;
  std::vector<Eigen::Vector3d> rays_in_world;  // zero where has_ray is false
  // False for keypoints without ray and for images without rotation.
  Mask has_ray;
};

TrackRays ComputeTrackRays(const PositionProblem& problem,
                           const Bearings& bearings,
                           const ObservationGroups& tracks, int num_threads);

struct TrackPoints {
  std::vector<std::optional<Eigen::Vector3d>> point_in_world;  // per track
  // Per observation of the tracks: it agrees with its point.
  Mask observation_is_used;
};

struct TrackPointOptions {
  double max_error_rad = 0.0;  // of an observation
  double min_angle_rad = 0.0;  // between two rays of a point
  // Distance to the cameras that see it. Lines of sight from about one place
  // seem to meet close to it, whatever their true point is.
  double min_depth = 0.0;
};

// Keeps those of the given points whose observations all agree with them, and
// triangulates the others: the L1 solution if all observations agree with it,
// else the robust one. `points` may be empty. In parallel over tracks.
void TriangulateTracks(const PositionProblem& problem, const TrackRays& rays,
                       const Positions& positions,
                       const TrackPointOptions& options, int num_threads,
                       TrackPoints* points);

// Places frames that are not yet placed from points they see, by intersecting
// the lines of sight in the centre of the frame. Returns how many it placed.
int PlaceFramesByPoints(const PositionProblem& problem, const TrackRays& rays,
                        const TrackPoints& points, double max_error_rad,
                        int num_threads, Positions* positions);

// Standard deviation (per axis) of the angular errors of used observations,
// robustly; 0 without any.
double AngularSigma(const PositionProblem& problem, const TrackRays& rays,
                    const TrackPoints& points, const Positions& positions);

// Tracks to estimate positions with: those supported by pairs first
// (track_support.h), of these the longest, until every image has at least
// `min_per_image` observations or no more tracks. All for 0.
std::vector<size_t> SelectTracks(const TrackRays& rays,
                                 const TrackPoints& points,
                                 const Mask& is_supported, int num_images,
                                 int min_per_image);

}  // namespace mgsfm
