// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <iterator>
#include <optional>
#include <vector>

#include "base/ranges.h"
#include "math/statistics.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/trajectory_io.h"
#include "priors/position_files.h"

namespace mgsfm {

// Samples have a member timestamp_s and are sorted by it.

// The largest gap that is interpolated, in median intervals
// (docs/reference/formats.md).
inline constexpr double kMaxGapRatio = 10.0;

template <class Sample>
double MaxGapSeconds(const std::vector<Sample>& samples) {
  const auto times_s = Transformed(samples, &Sample::timestamp_s);
  return kMaxGapRatio * MedianDifference(times_s).value_or(0.0);
}

// A time between two samples, as the share of the second.
template <class Sample>
struct PlaceBetween {
  const Sample* before;
  const Sample* after;
  double share;
};

// nullopt outside the samples and in their gaps.
template <class Sample>
std::optional<PlaceBetween<Sample>> FindBetween(
    const std::vector<Sample>& samples, double max_gap_s, double time_s) {
  const auto after = std::lower_bound(
      samples.begin(), samples.end(), time_s,
      [](const Sample& sample, double t) { return sample.timestamp_s < t; });
  if (after == samples.end()) return std::nullopt;
  if (after->timestamp_s == time_s) return {{&*after, &*after, 0.0}};
  if (after == samples.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const double gap_s = after->timestamp_s - before->timestamp_s;
  if (gap_s > max_gap_s) return std::nullopt;
  return {{&*before, &*after, (time_s - before->timestamp_s) / gap_s}};
}

inline Rigid3 Interpolate(const PlaceBetween<TimedPose>& place) {
  const Rigid3& before = place.before->cam_from_world;
  const Rigid3& after = place.after->cam_from_world;
  return Rigid3::FromRotationAndCenter(
      before.rotation.slerp(place.share, after.rotation),
      (1.0 - place.share) * before.Center() + place.share * after.Center());
}

inline TimedVector Interpolate(const PlaceBetween<TimedVector>& place) {
  const TimedVector& before = *place.before;
  const TimedVector& after = *place.after;
  TimedVector vector;
  vector.value = (1.0 - place.share) * before.value + place.share * after.value;
  if (before.covariance && after.covariance) {
    vector.covariance = (1.0 - place.share) * *before.covariance +
                        place.share * *after.covariance;
  }
  return vector;
}

}  // namespace mgsfm
