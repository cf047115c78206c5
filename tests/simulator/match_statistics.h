// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct Distribution {
  double mean = 0.0;
  double percentile10 = 0.0;
  double median = 0.0;
  double percentile90 = 0.0;
};

Distribution Summarize(std::vector<double> values);

// Statistics of verified matches of simulated or real images.
struct MatchStatistics {
  size_t num_images = 0;
  size_t num_pairs = 0;
  Distribution keypoints_per_image;
  Distribution pairs_per_image;
  Distribution inliers_per_pair;
  double inlier_share = 0.0;       // matches of a pair per keypoint
  Distribution track_length;       // keypoints that matches join
  double track_share_from3 = 0.0;  // of tracks, those of 3 images or more
  double tracked_share = 0.0;      // keypoints in tracks
  Distribution parallax_deg;       // of matches, without the rotation
  // Errors with respect to true poses: the fraction of matches with an epipolar
  // error above 4 px, and the errors of the others.
  double outlier_share = 0.0;
  Distribution error_px;
};

MatchStatistics ComputeMatchStatistics(
    const Scene& scene, const ViewGraph& view_graph,
    const std::vector<Rigid3>& true_cam_from_world);

// Rows of a Markdown table with one column per statistic.
std::string ToMarkdown(const std::vector<std::string>& titles,
                       const std::vector<MatchStatistics>& statistics);

}  // namespace mgsfm
