// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/motion_recipe.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "math/statistics.h"
#include "pair_filtering/motion_continuity.h"
#include "translation/baseline_directions.h"
#include "translation/position_problem.h"
#include "translation/scale_averaging.h"

namespace mgsfm {
namespace {

// Lengths within this factor of each other are one length: depths from a rig
// have errors of some tens of percent.
const double kLogWindow = std::log(1.5);
// A length needs as many votes as a link of scale averaging, and this share.
constexpr size_t kMinNumVotes = 5;
constexpr double kMinShareOfVotes = 0.15;
// A keypoint whose length differs by this factor is on an object.
const double kLogMoving = std::log(2.0);

// Pairs of neighbours in a sequence, and those within a frame.
Mask NeighbouringPairs(const FramePairIndex& index, const ViewGraph& view_graph,
                       int max_gap) {
  Mask is_near(view_graph.pairs.size(), false);
  for (size_t i = 0; i < is_near.size(); ++i) {
    const auto& gap = index.Of(i).time_gap;
    is_near[i] =
        gap && *gap <= max_gap && view_graph.pairs[i].relative_pose.has_value();
  }
  return is_near;
}

// The pairs within frames, by their two sensors.
std::vector<std::vector<int>> PairsOfEqualSensors(const Scene& scene,
                                                  const FramePairIndex& index,
                                                  const ViewGraph& view_graph) {
  std::map<std::pair<int, int>, std::vector<int>> pairs_of_sensors;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (index.Of(i).IsBetweenFrames()) continue;
    const ImagePair& pair = view_graph.pairs[i];
    pairs_of_sensors[std::minmax(scene.images[pair.image_idx1].sensor_idx,
                                 scene.images[pair.image_idx2].sensor_idx)]
        .push_back(static_cast<int>(i));
  }
  std::vector<std::vector<int>> sets;
  for (auto& [sensors, pair_idxs] : pairs_of_sensors) {
    sets.push_back(std::move(pair_idxs));
  }
  return sets;
}

// Per image: depths of keypoints in the common unit, sorted by keypoint.
using ImageDepths = std::vector<std::vector<DepthSample>>;

ImageDepths DepthsWithinFrames(const FramePairIndex& index,
                               const std::vector<BaselineDirection>& baselines,
                               const PairScales& scales, size_t num_images) {
  ImageDepths depths(num_images);
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (index.Of(i).IsBetweenFrames() || !scales.pairs[i] ||
        scales.pairs[i]->group != 0) {
      continue;
    }
    const int images[2] = {baselines[i].image_idx1, baselines[i].image_idx2};
    const auto log_length =
        static_cast<float>(std::log(scales.pairs[i]->scale));
    for (int side = 0; side < 2; ++side) {
      for (const DepthSample& d : baselines[i].depths[side]) {
        depths[images[side]].push_back(
            {d.keypoint_idx, d.log_depth + log_length});
      }
    }
  }
  for (std::vector<DepthSample>& of_image : depths) {
    std::stable_sort(of_image.begin(), of_image.end(),
                     [](const DepthSample& a, const DepthSample& b) {
                       return a.keypoint_idx < b.keypoint_idx;
                     });
  }
  return depths;
}

// The length of a baseline by the depth of one keypoint.
struct LengthVote {
  int image_idx;
  int keypoint_idx;
  double log_length;
};

std::vector<LengthVote> VotesOf(const BaselineDirection& baseline,
                                const ImageDepths& depths) {
  std::vector<LengthVote> votes;
  const int images[2] = {baseline.image_idx1, baseline.image_idx2};
  for (int side = 0; side < 2; ++side) {
    const std::vector<DepthSample>& known = depths[images[side]];
    auto it = known.begin();
    for (const DepthSample& d : baseline.depths[side]) {
      while (it != known.end() && it->keypoint_idx < d.keypoint_idx) ++it;
      if (it == known.end()) break;
      if (it->keypoint_idx != d.keypoint_idx) continue;
      votes.push_back(
          {images[side], d.keypoint_idx, it->log_depth - d.log_depth});
    }
  }
  return votes;
}

// The lengths that most votes support, one after the other.
struct LengthMode {
  double log_length;
  size_t num_votes;
};

std::vector<LengthMode> FindModes(const std::vector<LengthVote>& votes) {
  std::vector<double> values;
  for (const LengthVote& vote : votes) values.push_back(vote.log_length);
  std::sort(values.begin(), values.end());
  std::vector<LengthMode> modes;
  const size_t min_num_votes = std::max(
      kMinNumVotes, static_cast<size_t>(std::ceil(
                        kMinShareOfVotes * static_cast<double>(votes.size()))));
  while (true) {
    size_t best_begin = 0, best_size = 0;
    for (size_t begin = 0, end = 0; begin < values.size(); ++begin) {
      while (end < values.size() && values[end] - values[begin] <= kLogWindow) {
        ++end;
      }
      if (end - begin > best_size) {
        best_begin = begin;
        best_size = end - begin;
      }
    }
    if (best_size < min_num_votes) return modes;
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(best_begin);
    const auto end = begin + static_cast<std::ptrdiff_t>(best_size);
    modes.push_back({Median(std::vector<double>(begin, end)), best_size});
    values.erase(begin, end);
  }
}

std::vector<SupportedBaseline> BaselinesOf(
    const BaselineDirection& baseline, const std::optional<PairScale>& scale,
    const std::vector<LengthVote>& votes, double num_matches) {
  if (baseline.kind == BaselineKind::kNoParallax) {
    return {{Eigen::Vector3d::Zero(), num_matches}};
  }
  if (baseline.kind != BaselineKind::kDirection) return {};
  std::vector<SupportedBaseline> supported;
  for (const LengthMode& mode : FindModes(votes)) {
    supported.push_back({std::exp(mode.log_length) * baseline.direction,
                         num_matches * static_cast<double>(mode.num_votes) /
                             static_cast<double>(votes.size())});
  }
  if (supported.empty() && scale && scale->group == 0) {
    supported.push_back({scale->scale * baseline.direction, num_matches});
  }
  return supported;
}

// Frames next to an object: those of the rejected pairs.
Mask FramesWithObjects(const FramePairIndex& index, const Mask& is_rejected) {
  Mask has_object(index.num_frames(), false);
  for (size_t i = 0; i < is_rejected.size(); ++i) {
    if (!is_rejected[i]) continue;
    has_object[index.Of(i).frame_idx1] = true;
    has_object[index.Of(i).frame_idx2] = true;
  }
  return has_object;
}

// Counts for each keypoint the votes for and against the motion.
class KeypointVerdicts {
 public:
  explicit KeypointVerdicts(const Scene& scene)
      : scene_(scene), balance_(scene.images.size()) {}
  void Count(const std::vector<LengthVote>& votes, double length) {
    for (const LengthVote& vote : votes) {
      const bool is_moving =
          std::abs(vote.log_length - std::log(length)) > kLogMoving;
      std::vector<int>& balance = balance_[vote.image_idx];
      // Most images have no votes.
      balance.resize(scene_.images[vote.image_idx].keypoints_px.size(), 0);
      balance[vote.keypoint_idx] += is_moving ? 1 : -1;
    }
  }
  std::vector<Mask> Moving() const {
    std::vector<Mask> moving(balance_.size());
    for (size_t i = 0; i < moving.size(); ++i) {
      if (std::none_of(balance_[i].begin(), balance_[i].end(),
                       [](int balance) { return balance > 0; })) {
        continue;
      }
      moving[i].resize(balance_[i].size());
      for (size_t k = 0; k < balance_[i].size(); ++k) {
        moving[i][k] = balance_[i][k] > 0;
      }
    }
    return moving;
  }

 private:
  const Scene& scene_;
  std::vector<std::vector<int>> balance_;
};

bool IsMoving(const MovingObjects& objects, int image_idx, uint32_t keypoint) {
  const Mask& moving = objects.keypoint_is_moving[image_idx];
  return !moving.empty() && moving[keypoint];
}

struct Motions {
  std::vector<std::vector<LengthVote>> votes;  // per pair
  SupportedBaselines baselines;
  MotionConsistency consistency;
};

// Compares the pairs of frames at most max_gap apart with the motion.
Motions CompareWithMotion(const Scene& scene, const Bearings& bearings,
                          const FramePairIndex& index,
                          const ViewGraph& view_graph,
                          const RotationEstimate& rotations, int max_gap,
                          double min_parallax_deg,
                          const PairFilteringOptions& filtering,
                          const Context& context) {
  const std::vector<BaselineDirection> measured =
      EstimateBaselineDirections(scene, bearings, view_graph,
                                 NeighbouringPairs(index, view_graph, max_gap),
                                 MakePositionProblem(scene, rotations),
                                 min_parallax_deg, context, PairRotation::kOwn);
  const PairScales scales =
      AverageScales(measured, static_cast<int>(scene.images.size()), context,
                    {PairsOfEqualSensors(scene, index, view_graph), {}});
  const ImageDepths depths =
      DepthsWithinFrames(index, measured, scales, scene.images.size());
  Motions motions;
  motions.votes.resize(measured.size());
  motions.baselines.resize(measured.size());
  for (size_t i = 0; i < measured.size(); ++i) {
    motions.votes[i] = VotesOf(measured[i], depths);
    motions.baselines[i] =
        BaselinesOf(measured[i], scales.pairs[i], motions.votes[i],
                    static_cast<double>(view_graph.pairs[i].matches.size()));
  }
  motions.consistency = CheckMotion(scene, index, view_graph, rotations,
                                    motions.baselines, filtering);
  return motions;
}

// The pairs on objects, and the keypoints and lengths next to them.
MovingObjects JudgeNextToObjects(const Scene& scene,
                                 const FramePairIndex& index, Motions motions) {
  const MotionConsistency& consistency = motions.consistency;
  const Mask has_object =
      FramesWithObjects(index, consistency.pair_is_discontinuous);
  KeypointVerdicts verdicts(scene);
  MovingObjects objects;
  objects.length_of_pair.resize(motions.votes.size());
  for (size_t i = 0; i < motions.votes.size(); ++i) {
    const FramePairIndex::FramePair& frames = index.Of(i);
    if (!frames.IsBetweenFrames() || !consistency.agreeing[i] ||
        !(has_object[frames.frame_idx1] || has_object[frames.frame_idx2])) {
      continue;
    }
    const double length =
        motions.baselines[i][*consistency.agreeing[i]].baseline_in_world.norm();
    if (length == 0.0) continue;
    verdicts.Count(motions.votes[i], length);
    if (motions.votes[i].size() >= kMinNumVotes) {
      objects.length_of_pair[i] = length;
    }
  }
  objects.keypoint_is_moving = verdicts.Moving();
  objects.pair_is_on_object =
      std::move(motions.consistency.pair_is_discontinuous);
  return objects;
}

}  // namespace

MovingObjects FindMovingObjects(const Scene& scene, const Bearings& bearings,
                                const FramePairIndex& index,
                                const ViewGraph& view_graph,
                                const RotationEstimate& rotations,
                                double min_parallax_deg,
                                const PairFilteringOptions& filtering,
                                const Context& context) {
  const auto compare = [&](int max_gap) {
    return CompareWithMotion(scene, bearings, index, view_graph, rotations,
                             max_gap, min_parallax_deg, filtering, context);
  };
  // An object that moves along is on pairs of consecutive frames, too.
  if (!compare(1).consistency.pair_is_discontinuous.Any()) return {};
  return JudgeNextToObjects(scene, index, compare(kMaxSequentialGap));
}

void RemoveMovingKeypoints(const MovingObjects& objects,
                           ViewGraph* view_graph) {
  for (ImagePair& pair : view_graph->pairs) {
    if (pair.matches.empty()) continue;
    pair.matches.erase(
        std::remove_if(
            pair.matches.begin(), pair.matches.end(),
            [&](const Match& match) {
              return IsMoving(objects, pair.image_idx1, match.keypoint_idx1) ||
                     IsMoving(objects, pair.image_idx2, match.keypoint_idx2);
            }),
        pair.matches.end());
    // Its pose was that of the object.
    if (pair.matches.empty()) pair.relative_pose.reset();
  }
}

}  // namespace mgsfm
