// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/fixed_regions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "moving_objects/rig_motions.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr int kNumColumns = FixedRegions::kNumColumns;
constexpr int kNumRows = FixedRegions::kNumRows;
// A rotation, a parallax and a displacement are visible if they exceed this
// many match tolerances.
constexpr double kMinVisible = 4.0;
// The lower confidence bound of the fraction of votes, at 2.33 standard
// deviations (99 %). A vehicle next to the rig for two thirds of a recording
// has less.
constexpr double kMinShare = 0.75;
constexpr double kNumSigmasOfShare = 2.33;

int CellOf(const Camera& camera, const Eigen::Vector2f& keypoint_px) {
  const auto index = [](double value, double size, int num) {
    return std::clamp(static_cast<int>(value / size * num), 0, num - 1);
  };
  return index(keypoint_px.y(), camera.height_px, kNumRows) * kNumColumns +
         index(keypoint_px.x(), camera.width_px, kNumColumns);
}

const Camera& CameraOf(const Scene& scene, int image_idx) {
  return scene.cameras[scene.images[image_idx].camera_idx];
}

double ToleranceRad(const Scene& scene, const ImagePair& pair,
                    double max_error_px) {
  return ErrorRad(scene, pair.image_idx1, max_error_px);
}

// Per pair of frames: whether any pair of images of one sensor rotates.
Mask FindTurning(const Scene& scene, const FramePairIndex& index,
                 const ViewGraph& view_graph, double max_error_px) {
  const auto turns = [&](size_t pair_idx) {
    const ImagePair& pair = view_graph.pairs[pair_idx];
    return pair.relative_pose && IsOfOneSensor(scene, pair) &&
           AngleBetween(pair.relative_pose->cam2_from_cam1,
                        Eigen::Quaterniond::Identity()) >
               kMinVisible * ToleranceRad(scene, pair, max_error_px);
  };
  Mask turning;
  for (const FramePair& frames : index.frame_pairs()) {
    turning.push_back(frames.IsBetweenFrames() &&
                      AnyOf(frames.pair_idxs, turns));
  }
  return turning;
}

// A frame and the adjacent frames of its sequence.
std::vector<int> Neighbors(const FramePairIndex& index, int frame_idx) {
  if (!index.is_sequence()) return {frame_idx};
  std::vector<int> frames = index.order()->Neighbors(frame_idx);
  frames.push_back(frame_idx);
  return frames;
}

// Whether the rig turns between two frames, according to their pairs or to
// pairs of one of them with a frame next to the other.
bool Turns(const FramePairIndex& index, const Mask& turns,
           const FramePair& frames) {
  const auto do_turn = [&](int frame_idx1, int frame_idx2) {
    const auto* found = index.Find(frame_idx1, frame_idx2);
    return found != nullptr && turns[found - index.frame_pairs().data()];
  };
  const std::vector<int> near1 = Neighbors(index, frames.frame_idx1);
  const std::vector<int> near2 = Neighbors(index, frames.frame_idx2);
  return AnyOf(near1, [&](int a) { return do_turn(a, frames.frame_idx2); }) ||
         AnyOf(near2, [&](int b) { return do_turn(frames.frame_idx1, b); });
}

// The inverse distance of a point from camera 1, in baselines of the pair, is
// the ratio of its parallax and the lever of camera 2, and vice versa.
struct MatchParallax {
  double sine, lever1, lever2;

  MatchParallax(const RelativePose& pose, const Vector3d& ray1,
                const Vector3d& ray2) {
    const Vector3d turned = pose.cam2_from_cam1 * ray1;
    sine = ray2.cross(turned).norm();
    lever1 = turned.cross(*pose.translation_direction).norm();
    lever2 = ray2.cross(*pose.translation_direction).norm();
  }
};

// Per keypoint of an image: its inverse distance if a match within its frame
// has a visible parallax. The unit is the baseline of that pair.
using Nearness = std::vector<std::optional<double>>;

// Per image, the pair within its frame with the most matches.
std::vector<const ImagePair*> FindPartners(const Scene& scene,
                                           const FramePairIndex& index,
                                           const ViewGraph& view_graph) {
  std::vector<const ImagePair*> partners(scene.images.size(), nullptr);
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (index.Of(i).IsBetweenFrames() || !pair.relative_pose ||
        !pair.relative_pose->translation_direction) {
      continue;
    }
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      const ImagePair*& partner = partners[image_idx];
      if (partner == nullptr || pair.matches.size() > partner->matches.size()) {
        partner = &pair;
      }
    }
  }
  return partners;
}

std::vector<Nearness> MeasureInverseDistances(const Scene& scene,
                                              const Bearings& bearings,
                                              const FramePairIndex& index,
                                              const ViewGraph& view_graph,
                                              double max_error_px) {
  const auto partners = FindPartners(scene, index, view_graph);
  std::vector<Nearness> nearness(partners.size());
  for (size_t i = 0; i < partners.size(); ++i) {
    nearness[i].resize(scene.images[i].keypoints_px.size());
    if (partners[i] == nullptr) continue;
    const ImagePair& pair = *partners[i];
    const double tolerance_rad = ToleranceRad(scene, pair, max_error_px);
    const bool is_first = pair.image_idx1 == static_cast<int>(i);
    ForEachRays(
        bearings, pair,
        [&](const Match& match, const Vector3d& ray1, const Vector3d& ray2) {
          const MatchParallax parallax(*pair.relative_pose, ray1, ray2);
          if (parallax.sine < kMinVisible * tolerance_rad) return;
          nearness[i][is_first ? match.keypoint_idx1 : match.keypoint_idx2] =
              parallax.sine / (is_first ? parallax.lever2 : parallax.lever1);
        });
  }
  return nearness;
}

// Whether the keypoints of a match move along with the rig.
enum class Kind { kMoves, kFixed, kUnknown };
struct MatchVote {
  Match match;
  Kind kind;
};

// Compares the rays of a pair of images of one sensor. Where the rig turns, all
// matches tell; elsewhere, `nearness1` of keypoints of image 1 shows how far it
// advances, and which points would move visibly at rest.
std::vector<MatchVote> CompareRays(const Bearings& bearings,
                                   const ImagePair& pair, double tolerance_rad,
                                   const Nearness* nearness1) {
  const auto& pose = pair.relative_pose;
  if (nearness1 && !(pose && pose->translation_direction)) return {};
  std::vector<MatchVote> votes;
  std::vector<double> lengths;     // of the baseline
  std::vector<double> unit_sines;  // per vote: of its parallax, at length 1
  ForEachRays(
      bearings, pair,
      [&](const Match& match, const Vector3d& ray1, const Vector3d& ray2) {
        const bool is_fixed = IsRotationInlier(Eigen::Quaterniond::Identity(),
                                               ray1, ray2, tolerance_rad);
        votes.push_back({match, is_fixed ? Kind::kFixed : Kind::kMoves});
        if (!nearness1) return;
        const auto& near = (*nearness1)[match.keypoint_idx1];
        const MatchParallax parallax(*pose, ray1, ray2);
        unit_sines.push_back(near ? *near * parallax.lever2 : 0.0);
        if (!is_fixed && near) {
          lengths.push_back(parallax.sine / parallax.lever2 / *near);
        }
      });
  if (!nearness1) return votes;
  if (lengths.empty()) return {};
  const double length = Median(std::move(lengths));
  for (size_t i = 0; i < votes.size(); ++i) {
    if (votes[i].kind == Kind::kFixed &&
        length * unit_sines[i] < kMinVisible * tolerance_rad) {
      votes[i].kind = Kind::kUnknown;
    }
  }
  return votes;
}

// Adds the vote of a pair to those of each cell of its sensor. Undecided points
// are no evidence for a region, and may be fixed.
struct Votes {
  std::vector<int> num_fixed = std::vector<int>(kNumColumns * kNumRows, 0);
  std::vector<int> num_all = num_fixed;

  void Add(const Scene& scene, const ImagePair& pair,
           const std::vector<MatchVote>& votes) {
    std::vector<std::array<int, 3>> counts(num_all.size(), {0, 0, 0});
    const auto add = [&](int image_idx, uint32_t keypoint_idx, Kind kind) {
      ++counts[CellOf(CameraOf(scene, image_idx),
                      scene.images[image_idx].keypoints_px[keypoint_idx])]
              [static_cast<size_t>(kind)];
    };
    for (const auto& [match, kind] : votes) {
      add(pair.image_idx1, match.keypoint_idx1, kind);
      add(pair.image_idx2, match.keypoint_idx2, kind);
    }
    for (size_t c = 0; c < counts.size(); ++c) {
      const auto [num_moving, fixed, num_unknown] = counts[c];
      num_fixed[c] += fixed > num_moving;
      num_all[c] += fixed > num_moving || num_moving > fixed + num_unknown;
    }
  }
};

// Wilson's lower confidence bound of a fraction.
double LowerBound(int num_for, int num_votes) {
  const double n = num_votes, z2 = kNumSigmasOfShare * kNumSigmasOfShare;
  const double share = num_for / n;
  return (share + z2 / (2.0 * n) -
          kNumSigmasOfShare *
              std::sqrt((share * (1.0 - share) + z2 / (4.0 * n)) / n)) /
         (1.0 + z2 / n);
}

// Pairs with a rotation and pairs with translation only judge a cell by
// different points, so either kind suffices.
Mask FixedCells(const Votes& turning, const Votes& advancing) {
  Mask is_fixed(turning.num_all.size(), false);
  for (size_t c = 0; c < is_fixed.size(); ++c) {
    for (const Votes* votes : {&turning, &advancing}) {
      is_fixed[c] = is_fixed[c] || (votes->num_all[c] > 0 &&
                                    LowerBound(votes->num_fixed[c],
                                               votes->num_all[c]) > kMinShare);
    }
  }
  return is_fixed.Any() ? is_fixed : Mask();
}

}  // namespace

bool FixedRegions::Contains(const Scene& scene, int image_idx,
                            size_t keypoint_idx) const {
  const Image& image = scene.images[image_idx];
  const Mask& is_fixed = of_sensor[image.sensor_idx];
  return !is_fixed.empty() &&
         is_fixed[CellOf(CameraOf(scene, image_idx),
                         image.keypoints_px[keypoint_idx])];
}

double FixedRegions::FractionOf(int sensor_idx) const {
  const Mask& is_fixed = of_sensor[sensor_idx];
  return is_fixed.empty() ? 0.0
                          : static_cast<double>(is_fixed.Count()) /
                                static_cast<double>(is_fixed.size());
}

bool FixedRegions::Add(const FixedRegions& others) {
  of_sensor.resize(others.of_sensor.size());
  bool are_new = false;
  for (size_t s = 0; s < of_sensor.size(); ++s) {
    Mask& cells = of_sensor[s];
    const Mask& added = others.of_sensor[s];
    cells.resize(std::max(cells.size(), added.size()));
    for (size_t c = 0; c < added.size(); ++c) {
      are_new |= added[c] && !cells[c];
      cells[c] |= added[c];
    }
  }
  return are_new;
}

FixedRegions FindFixedRegions(const Scene& scene, const Bearings& bearings,
                              const FramePairIndex& index,
                              const ViewGraph& view_graph,
                              double max_error_px) {
  const Mask turns = FindTurning(scene, index, view_graph, max_error_px);
  const std::vector<Nearness> nearness =
      MeasureInverseDistances(scene, bearings, index, view_graph, max_error_px);
  std::vector<Votes> turning(scene.sensors.size()), advancing = turning;
  for (const FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames()) continue;
    const bool do_turn = Turns(index, turns, frames);
    for (const size_t i : frames.pair_idxs) {
      const ImagePair& pair = view_graph.pairs[i];
      if (!IsOfOneSensor(scene, pair)) continue;
      const int sensor_idx = scene.images[pair.image_idx1].sensor_idx;
      (do_turn ? turning : advancing)[sensor_idx].Add(
          scene, pair,
          CompareRays(bearings, pair, ToleranceRad(scene, pair, max_error_px),
                      do_turn ? nullptr : &nearness[pair.image_idx1]));
    }
  }
  FixedRegions regions;
  for (size_t s = 0; s < scene.sensors.size(); ++s) {
    regions.of_sensor.push_back(FixedCells(turning[s], advancing[s]));
  }
  return regions;
}

ViewGraph DropFixedRegions(const Scene& scene, const FixedRegions& regions,
                           const ViewGraph& view_graph) {
  ViewGraph visible = view_graph;
  for (ImagePair& pair : visible.pairs) {
    for (auto* matches : {&pair.matches, &pair.outliers}) {
      EraseIf(matches, [&](const Match& match) {
        return regions.Contains(scene, pair.image_idx1, match.keypoint_idx1) ||
               regions.Contains(scene, pair.image_idx2, match.keypoint_idx2);
      });
    }
  }
  return visible;
}

void LogFixedRegions(const Scene& scene, const FixedRegions& regions,
                     const Context& context) {
  for (size_t s = 0; s < scene.sensors.size(); ++s) {
    const double fraction = regions.FractionOf(static_cast<int>(s));
    if (fraction == 0.0) continue;
    context.Info("camera '" + scene.sensors[s].name +
                 Formatted("': %.0f %% of its images shows objects that move "
                           "along with the rig",
                           100.0 * fraction));
  }
  context.Info(
      "matches of objects that move along with the rig are not used; "
      "fixed_region_mask_path writes masks of these regions");
}

}  // namespace mgsfm
