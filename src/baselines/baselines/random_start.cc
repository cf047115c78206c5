// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/random_start.h"

#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Half of the sides in random_start.h.
constexpr double kHalfWidth = 100.0;
constexpr double kSensorHalfWidth = 1.0;

Vector3d RandomPosition(double half_width, Random* random) {
  Vector3d position;
  for (int i = 0; i < 3; ++i) {
    position[i] = random->Uniform(-half_width, half_width);
  }
  return position;
}

TrackPoints RandomPoints(const TrackRays& rays, Random* random) {
  TrackPoints points;
  points.point_in_world.resize(rays.tracks.size());
  points.observation_is_used.assign(rays.tracks.observations.size(), false);
  for (size_t t = 0; t < rays.tracks.size(); ++t) {
    const size_t begin = rays.tracks.offsets[t];
    const size_t end = rays.tracks.offsets[t + 1];
    int num_rays = 0;
    for (size_t k = begin; k < end; ++k) {
      num_rays += rays.has_ray[k] ? 1 : 0;
    }
    const Vector3d position = RandomPosition(kHalfWidth, random);
    if (num_rays < 2) continue;
    points.point_in_world[t] = position;
    for (size_t k = begin; k < end; ++k) {
      points.observation_is_used[k] = rays.has_ray[k];
    }
  }
  return points;
}

}  // namespace

RandomStart StartAtRandom(const PositionProblem& problem, const TrackRays& rays,
                          uint64_t seed) {
  RandomStart start;
  Random random(seed);
  Positions& positions = start.initial.positions;
  positions.frame_is_placed.assign(problem.num_frames, false);
  for (int f = 0; f < problem.num_frames; ++f) {
    positions.frame_center.push_back(RandomPosition(kHalfWidth, &random));
  }
  positions.sensor_translation = problem.fixed_translation;
  start.initial.is_metric = problem.HasKnownOffset();
  for (size_t s = 0; s < problem.sensor_kind.size(); ++s) {
    if (problem.sensor_kind[s] != SensorKind::kFree) continue;
    positions.sensor_translation[s] = RandomPosition(kSensorHalfWidth, &random);
    start.initial.free_sensors.push_back(static_cast<int>(s));
  }
  start.initial.unobservable.resize(0, 3 * start.initial.free_sensors.size());
  start.initial.solve.termination = Termination::kConverged;
  start.initial.solve.message = "Not needed: positions start at random.";
  start.points = RandomPoints(rays, &random);
  for (size_t k = 0; k < rays.tracks.observations.size(); ++k) {
    if (!start.points.observation_is_used[k]) continue;
    const int image_idx = rays.tracks.observations[k].image_idx;
    positions.frame_is_placed[problem.frame_idx[image_idx]] = true;
  }
  return start;
}

}  // namespace mgsfm
