// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/kept_matches.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>

#include "base/format.h"
#include "base/ranges.h"
#include "input_check/rig_samples.h"
#include "math/robust_scale.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {
namespace {

// Cameras of correct drives keep at least 96 % of their matches; frames full of
// vehicles at a constant distance keep about half (docs/results/constants.md).
constexpr double kMinShare = 0.6;

std::string Percent(double share) {
  return Formatted("%.0f %%", 100.0 * share);
}

// Whether the fraction of kept matches is below the bound, given its standard
// error.
bool IsLost(const KeptCount& count) {
  const double sigma = std::sqrt(kMinShare * (1.0 - kMinShare) /
                                 static_cast<double>(count.num_matches));
  return count.Share() + kRareErrorInSigmas * sigma < kMinShare;
}

Finding DescribeSensor(const std::string& name, const KeptCount& count) {
  return {Cause::kLostMatches,
          {name},
          {},
          {{"kept_share", count.Share()},
           {"num_matches", static_cast<double>(count.num_matches)}},
          "the model explains only " + Percent(count.Share()) +
              " of the verified matches of camera '" + name + "'",
          "check its intrinsics, the assignment of its images to frames, and "
          "whether it is rigidly mounted"};
}

// Segments of lost frames in the order of names.
std::vector<std::vector<int>> FindStretches(const Scene& scene,
                                            const KeptMatches& kept) {
  const std::vector<int> rank = RankFrames(scene);
  std::vector<int> order = Indices(scene.frames.size());
  SortBy(&order,
         [&](int a) { return std::pair(scene.frames[a].rig_idx, rank[a]); });
  std::vector<std::vector<int>> stretches;
  bool is_open = false;
  for (const int frame_idx : order) {
    const bool is_lost = IsLost(kept.frames[frame_idx]);
    if (is_lost && !is_open) stretches.emplace_back();
    if (is_lost) stretches.back().push_back(frame_idx);
    is_open = is_lost;
  }
  return stretches;
}

Finding DescribeStretch(const Scene& scene, const KeptMatches& kept,
                        const std::vector<int>& frame_idxs) {
  KeptCount sum;
  for (const int i : frame_idxs) {
    sum.num_matches += kept.frames[i].num_matches;
    sum.num_kept += kept.frames[i].num_kept;
  }
  const std::string& first = scene.frames[frame_idxs.front()].name;
  const std::string& last = scene.frames[frame_idxs.back()].name;
  return {Cause::kLostMatches,
          {},
          {first, last},
          {{"kept_share", sum.Share()},
           {"num_matches", static_cast<double>(sum.num_matches)}},
          "the model explains only " + Percent(sum.Share()) +
              " of the verified matches of frames '" + first + "' to '" + last +
              "'",
          "compare these images: they may show moving objects, or the rig may "
          "have changed"};
}

}  // namespace

KeptMatches CountKeptMatches(const Scene& scene, const ViewGraph& view_graph,
                             const Reconstruction& model, double max_error_px,
                             const Context& context) {
  MatchSelectionOptions options;
  options.min_pair_share = 0.0;
  const MatchSelection selection = SelectConsistentMatches(
      {scene, view_graph, Mask(view_graph.pairs.size(), true), model},
      max_error_px, options, context);
  KeptMatches kept;
  kept.sensors.resize(scene.sensors.size());
  kept.frames.resize(scene.frames.size());
  size_t first_match = 0;
  for (const ImagePair& pair : view_graph.pairs) {
    KeptCount of_pair{pair.matches.size(), 0};
    for (size_t k = 0; k < pair.matches.size(); ++k) {
      of_pair.num_kept += selection.match_is_used[first_match + k];
    }
    first_match += pair.matches.size();
    if (!model.IsRegistered(scene, pair.image_idx1) ||
        !model.IsRegistered(scene, pair.image_idx2)) {
      continue;
    }
    const auto add = [&](KeptCount* count) {
      count->num_matches += of_pair.num_matches;
      count->num_kept += of_pair.num_kept;
    };
    add(&kept.total);
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      add(&kept.sensors[scene.images[image_idx].sensor_idx]);
      add(&kept.frames[scene.images[image_idx].frame_idx]);
    }
  }
  return kept;
}

std::vector<Finding> FindLostMatches(const Scene& scene,
                                     const KeptMatches& kept) {
  std::vector<Finding> findings;
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    if (!IsLost(kept.sensors[k])) continue;
    findings.push_back(DescribeSensor(scene.sensors[k].name, kept.sensors[k]));
  }
  if (!findings.empty()) return findings;
  for (const std::vector<int>& stretch : FindStretches(scene, kept)) {
    if (stretch.size() < kMinNumRigFrames) continue;
    findings.push_back(DescribeStretch(scene, kept, stretch));
  }
  return findings;
}

double ShareAtRest(const Scene& scene, const Reconstruction& model,
                   double max_error_px) {
  size_t num_observations = 0, num_at_rest = 0;
  for (const Point3D& point : model.points) {
    std::map<int, Eigen::Vector2f> first_of_sensor;
    for (const Observation& observation : point.track) {
      const Image& image = scene.images[observation.image_idx];
      const Eigen::Vector2f& keypoint =
          image.keypoints_px[observation.keypoint_idx];
      const auto [first, is_first] =
          first_of_sensor.emplace(image.sensor_idx, keypoint);
      if (is_first) continue;
      num_at_rest += static_cast<double>((keypoint - first->second).norm()) <=
                     2.0 * max_error_px;
    }
    num_observations += std::max<size_t>(point.track.size(), 1) - 1;
  }
  return num_observations == 0 ? 0.0
                               : static_cast<double>(num_at_rest) /
                                     static_cast<double>(num_observations);
}

}  // namespace mgsfm
