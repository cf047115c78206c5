// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {

// Incremental structure from motion of rigs, after Cui, Gao, Shen: MCSfM:
// Multi-Camera-Based Incremental Structure-From-Motion, IEEE TIP 2023. A model
// starts with two frames and grows by one frame at a time. A frame is a rigid
// unit; a single camera is a rig of one.
//
// Unknowns: the poses of frames, the poses of sensors in their rigs unless they
// are known, and one point per track; intrinsics as the options of bundle
// adjustment say. Tracks are the longest ones that cover all images
// (tracks/track_establishment.h): the adjustment of the finished model uses the
// others, too.
//
// Gauge: the first frame of a start, and either the known baselines of its rig
// or the distance of its two images, which is 1.
//
// Start. Candidates are pairs of frames, or of two images of one frame if the
// rig is unknown. The sensors of a candidate are references or known. Its
// weight is the sum over its matches of min(angle / 10 deg, 1), with the angle
// between both rays after rotation. Pairs of frames of a known rig get their
// pose by LO-RANSAC over all pairs of their cameras
// (geometry/generalized_pose); the others take that of their heaviest image
// pair. A start needs twice as many points as a frame
// needs inliers. Rotations without translation have none.
//
// Order. The next frame has the largest spread of visible points: the number of
// occupied cells of grids of 2, 4, 8 and 16 cells per side, each cell with the
// weight of its side (Schönberger, Frahm: Structure-from-Motion Revisited, CVPR
// 2016), over the images of placed sensors. Ties go to the first frame. Only
// frames with at least 0.8 of the largest number of visible points compete.
// Frames next to the model in a sequence come first: a wrong loop then meets
// the frames that contradict it. They need fewer inliers than others.
//
// A step registers the frame by LO-RANSAC over all of its cameras
// (geometry/absolute_pose.h), triangulates its tracks, and adjusts the frame
// and the 5 frames that share most points with it, with all others, the sensors
// and the intrinsics fixed. Everything is adjusted, triangulated and filtered
// again whenever the model has grown by a quarter.
//
// Unknown rigs. An image of a sensor without pose in a registered frame is
// registered by itself, and gives a sample S_k of sensor_from_rig with
// covariance C_k. The weighted mean of n samples has the covariance
//
//   C = max(1, chi2 / (6 (n - 1))) (sum_k C_k^-1)^-1,
//
// chi2 the sum of their squared deviations. The sensor joins the unit when at
// least 3 samples determine it such that the standard deviations of rotation
// and of translation over the median depth add to less than
// half of the outlier bound of observations. If no other frame can be added,
// the sensor with the most samples joins with what there is.
//
// Loop closure. If the outliers of a registered frame agree on a second pose,
// and other frames observe their points, the model has drifted. The rigid
// motion between both poses moves the frames of one side, a pose graph spreads
// it (georegistration/pose_graph_deformation.h), and everything is adjusted.
// The model before it is kept unless the frame then agrees with at least half
// of the points of the second pose, and no observations are lost.
//
// Stops when no frame registers after an adjustment of everything. The
// remaining frames then start further models, with the sensors of the earlier
// ones.
//
// Cost: a step is linear in the observations of six frames, plus a pass over
// all frames that takes far less time; all adjustments together take about five
// times as long as the last one.

struct IncrementalInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;  // of verified pairs with relative poses
  // Per pair: not rejected by a rule. Pairs of places that look alike must be
  // rejected: growth cannot tell, because it sees no loop before it closes.
  const Mask& pair_is_used;
  // Per pair: joins neighbors in a sequence, without a break between them.
  const Mask& pair_is_of_neighbors;
};

struct IncrementalOptions {
  const ResectionOptions& resection;
  const BundleAdjustmentOptions& bundle_adjustment;
  const TrackOptions& tracks;
  const MatchSelectionOptions& match_selection;
  int min_num_frames = 2;  // smaller models are discarded
};

struct IncrementalSummary {
  TrackSummary tracks;
  std::vector<PlacedSensor> placed_sensors;
  int num_adjustments = 0;  // of everything
  int num_loop_closures = 0;

  auto Fields() const {
    return Named("tracks", tracks, "placed_sensors", placed_sensors,
                 "num_adjustments", num_adjustments, "num_loop_closures",
                 num_loop_closures);
  }
};

struct IncrementalResult {
  std::vector<Reconstruction> estimate;  // in the order of their starts
  IncrementalSummary summary;
  // The frames that steps added, in their order.
  std::vector<ResectedFrame> added;
  // The last attempts to register the frames of no model.
  std::vector<ResectedFrame> rejected;
};

// `observer` sees a model after each adjustment of everything; it may be null.
[[nodiscard]] IncrementalResult MapIncrementally(
    const IncrementalInput& input, const IncrementalOptions& options,
    const Context& context,
    const std::function<void(const Reconstruction&)>& observer);

struct ExistingModel {
  const Reconstruction& model;
  const FixedPoses& held;  // stay as they are; no loop is closed then
};

// Grows an existing model by the frames that it lacks. Its points stand for the
// matches that made them. Starts no other model.
[[nodiscard]] IncrementalResult GrowModel(
    const IncrementalInput& input, const ExistingModel& existing,
    const IncrementalOptions& options, const Context& context,
    const std::function<void(const Reconstruction&)>& observer);

}  // namespace mgsfm
