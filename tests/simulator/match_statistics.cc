// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/match_statistics.h"

#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>
#include <utility>

#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "math/union_find.h"

namespace mgsfm {
namespace {

constexpr double kMaxError_px = 4.0;

void AddTracks(const Scene& scene, const ViewGraph& view_graph,
               MatchStatistics* statistics) {
  std::vector<size_t> offsets = {0};
  for (const Image& image : scene.images) {
    offsets.push_back(offsets.back() + image.keypoints_px.size());
  }
  UnionFind tracks(offsets.back());
  for (const ImagePair& pair : view_graph.pairs) {
    for (const Match& match : pair.matches) {
      tracks.Union(offsets[pair.image_idx1] + match.keypoint_idx1,
                   offsets[pair.image_idx2] + match.keypoint_idx2);
    }
  }
  std::vector<double> lengths;
  double num_tracked = 0.0, num_from3 = 0.0;
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (tracks.Find(i) != i || tracks.SetSize(i) < 2) continue;
    lengths.push_back(static_cast<double>(tracks.SetSize(i)));
    num_tracked += lengths.back();
    num_from3 += lengths.back() >= 3.0 ? 1.0 : 0.0;
  }
  statistics->track_share_from3 =
      num_from3 / static_cast<double>(lengths.size());
  statistics->tracked_share = num_tracked / static_cast<double>(tracks.size());
  statistics->track_length = Summarize(std::move(lengths));
}

void AddErrors(const Scene& scene, const ViewGraph& view_graph,
               const std::vector<Rigid3>& true_cam_from_world,
               MatchStatistics* statistics) {
  const Bearings bearings = ComputeBearings(scene, 2);
  std::vector<double> errors_px, parallaxes_deg;
  double num_outliers = 0.0, num_matches = 0.0;
  for (const ImagePair& pair : view_graph.pairs) {
    Rigid3 cam2_from_cam1 = true_cam_from_world[pair.image_idx2] *
                            true_cam_from_world[pair.image_idx1].Inverse();
    cam2_from_cam1.translation.normalize();
    const Camera& camera =
        scene.cameras[scene.images[pair.image_idx2].camera_idx];
    const double focal = PixelsPerRadian(camera.model, camera.params.data());
    for (const Match& match : pair.matches) {
      const Eigen::Vector3d& ray1 =
          bearings.Ray(pair.image_idx1, match.keypoint_idx1);
      const Eigen::Vector3d& ray2 =
          bearings.Ray(pair.image_idx2, match.keypoint_idx2);
      const double error_px =
          focal * std::abs(SampsonAngle(cam2_from_cam1, ray1, ray2));
      num_matches += 1.0;
      if (error_px > kMaxError_px) {
        num_outliers += 1.0;
      } else {
        errors_px.push_back(error_px);
      }
      parallaxes_deg.push_back(
          RadToDeg(AngleBetween(cam2_from_cam1.rotation * ray1, ray2)));
    }
  }
  statistics->outlier_share = num_outliers / num_matches;
  statistics->error_px = Summarize(std::move(errors_px));
  statistics->parallax_deg = Summarize(std::move(parallaxes_deg));
}

std::string Format(const char* format, double value) {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

std::string Format(const Distribution& d, const char* format) {
  return Format(format, d.mean) + " (" + Format(format, d.percentile10) + ", " +
         Format(format, d.median) + ", " + Format(format, d.percentile90) + ")";
}

std::string Percent(double share) { return Format("%.1f %%", 100.0 * share); }

}  // namespace

Distribution Summarize(std::vector<double> values) {
  if (values.empty()) return {};
  Distribution d;
  d.mean = std::accumulate(values.begin(), values.end(), 0.0) /
           static_cast<double>(values.size());
  d.percentile10 = Quantile(values, 0.1);
  d.median = Quantile(values, 0.5);
  d.percentile90 = Quantile(std::move(values), 0.9);
  return d;
}

MatchStatistics ComputeMatchStatistics(
    const Scene& scene, const ViewGraph& view_graph,
    const std::vector<Rigid3>& true_cam_from_world) {
  MatchStatistics statistics;
  statistics.num_images = scene.images.size();
  statistics.num_pairs = view_graph.pairs.size();
  std::vector<double> keypoints, inliers, shares;
  std::vector<double> pairs(scene.images.size(), 0.0);
  for (const Image& image : scene.images) {
    keypoints.push_back(static_cast<double>(image.keypoints_px.size()));
  }
  for (const ImagePair& pair : view_graph.pairs) {
    inliers.push_back(static_cast<double>(pair.matches.size()));
    shares.push_back(inliers.back() / keypoints[pair.image_idx1]);
    pairs[pair.image_idx1] += 1.0;
    pairs[pair.image_idx2] += 1.0;
  }
  statistics.keypoints_per_image = Summarize(std::move(keypoints));
  statistics.inliers_per_pair = Summarize(std::move(inliers));
  statistics.inlier_share = Summarize(std::move(shares)).mean;
  statistics.pairs_per_image = Summarize(std::move(pairs));
  AddTracks(scene, view_graph, &statistics);
  AddErrors(scene, view_graph, true_cam_from_world, &statistics);
  return statistics;
}

std::string ToMarkdown(const std::vector<std::string>& titles,
                       const std::vector<MatchStatistics>& statistics) {
  std::string table = "| |";
  for (const std::string& title : titles) table += " " + title + " |";
  table += "\n|---|";
  for (size_t i = 0; i < titles.size(); ++i) table += "---|";
  table += "\n";
  const auto add_row =
      [&](const char* name,
          const std::function<std::string(const MatchStatistics&)>& value) {
        table += std::string("| ") + name + " |";
        for (const MatchStatistics& s : statistics) {
          table += " " + value(s) + " |";
        }
        table += "\n";
      };
  using S = MatchStatistics;
  add_row("images", [](const S& s) { return std::to_string(s.num_images); });
  add_row("pairs", [](const S& s) { return std::to_string(s.num_pairs); });
  add_row("keypoints of an image",
          [](const S& s) { return Format(s.keypoints_per_image, "%.0f"); });
  add_row("pairs of an image",
          [](const S& s) { return Format(s.pairs_per_image, "%.1f"); });
  add_row("inliers of a pair",
          [](const S& s) { return Format(s.inliers_per_pair, "%.0f"); });
  add_row("the same per keypoint",
          [](const S& s) { return Percent(s.inlier_share); });
  add_row("track length",
          [](const S& s) { return Format(s.track_length, "%.1f"); });
  add_row("tracks of 3 keypoints or more",
          [](const S& s) { return Percent(s.track_share_from3); });
  add_row("keypoints in tracks",
          [](const S& s) { return Percent(s.tracked_share); });
  add_row("parallax of a match, deg",
          [](const S& s) { return Format(s.parallax_deg, "%.2f"); });
  add_row("matches off the true epipolar line",
          [](const S& s) { return Percent(s.outlier_share); });
  add_row("distance of the others, px",
          [](const S& s) { return Format(s.error_px, "%.2f"); });
  return table;
}

}  // namespace mgsfm
