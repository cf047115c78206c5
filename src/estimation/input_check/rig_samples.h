// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Rotations that differ by more do not belong to one rig: far above the errors
// of a calibration and of single pairs. With twice the value, an error of 15
// degrees is accepted; half of it changes no verdict
// (docs/results/constants.md).
inline constexpr double kSameRotationRad = DegToRad(10.0);
// Half of the smaller typical error: exchanged axes cause 90 degrees, an
// inverted translation 180. Directions of short baselines scatter most. Within
// it, a direction is upright, or opposite to another one.
inline constexpr double kSameDirectionRad = DegToRad(45.0);
inline constexpr size_t kMinNumRigFrames = kMinNumOfMedian;

// Measurements of the pose of one sensor relative to another of its rig, from
// image pairs alone: for a constant rig, they are equal in all frames, whatever
// model was estimated.
//
// A pair within a frame measures the pose directly. A pair from sensor a in
// frame f to sensor b in frame g measures the rotation in frame g with the
// motion of sensor a, and that in frame f with the motion of sensor b:
//   b_from_a = R(b,g <- a,f) R(a,f <- a,g) = R(b,f <- b,g) R(b,g <- a,f).
struct RigSample {
  int frame_idx = 0;
  Eigen::Quaterniond b_from_a;
  // The direction of the translation of b_from_a, for pairs within a frame, and
  // the pair that measures it.
  std::optional<Eigen::Vector3d> direction;
  const ImagePair* pair = nullptr;
};

struct SensorPairSamples {
  int sensor_a = 0;  // < sensor_b
  int sensor_b = 0;
  // At most one per frame: the sample that agrees best with the others of its
  // frame. Ordered by frame name.
  std::vector<RigSample> samples;
};

// Sorted by (sensor_a, sensor_b). Cost: O(n log n) for n pairs.
std::vector<SensorPairSamples> CollectRigSamples(const Scene& scene,
                                                 const ViewGraph& view_graph);

// The most frequent pose: the robust mean of the rotations, and of the
// directions of the samples with about this rotation. nullopt without samples.
struct TypicalRigPose {
  Eigen::Quaterniond b_from_a;
  std::optional<Eigen::Vector3d> direction;
  double median_deviation_rad = 0.0;  // of the rotations
};
std::optional<TypicalRigPose> FindTypicalPose(
    const std::vector<RigSample>& samples);

// Per frame, its rank by name among the frames of its rig.
std::vector<int> RankFrames(const Scene& scene);

}  // namespace mgsfm
