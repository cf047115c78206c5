// SPDX-License-Identifier: BSD-3-Clause
#include "seams/seams.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "base/ranges.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/frame_cuts.h"
#include "pair_filtering/unsupported_bridges.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

// Per image pair.
std::vector<int> CountConfirmed(const ConfidenceInput& input) {
  const PointLookup points(input.scene, input.reconstruction);
  std::vector<int> num_confirmed;
  for (const ImagePair& pair : input.view_graph.pairs) {
    num_confirmed.push_back(
        static_cast<int>(CountIf(pair.matches, [&](const Match& match) {
          const auto point = points.Find(pair.image_idx1, match.keypoint_idx1);
          return point &&
                 point == points.Find(pair.image_idx2, match.keypoint_idx2);
        })));
  }
  return num_confirmed;
}

// Joins components by pairs with confirmed matches first, then by other pairs,
// last by adjacent frames.
FrameCuts FindCuts(const ConfidenceInput& input,
                   const std::vector<int>& num_confirmed) {
  const FramePairIndex& index = input.index;
  const auto is_registered = [&](int frame_idx) {
    return input.reconstruction.rig_from_world[frame_idx].has_value();
  };
  std::vector<GraphEdge> edges;
  std::optional<int> last;
  for (int i = 0; i < index.num_frames(); ++i) {
    if (!is_registered(i)) continue;
    if (last) edges.push_back({*last, i, -1.0});
    last = i;
  }
  for (const FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames() || !is_registered(frames.frame_idx1) ||
        !is_registered(frames.frame_idx2)) {
      continue;
    }
    double weight = 0.0;
    for (const size_t i : frames.pair_idxs) weight += num_confirmed[i];
    edges.push_back({frames.frame_idx1, frames.frame_idx2, weight});
  }
  return {index.num_frames(), edges};
}

// Counts of points and matches that cross each cut.
struct CutEvidence {
  std::vector<double> num_tracks;
  std::vector<double> num_ties;
  std::vector<double> num_pairs;
  std::vector<double> num_confirmed;
  std::vector<double> num_against;
  std::vector<std::optional<SeamReason>> reasons;  // but contradictions
  std::vector<double> num_motions;                 // confirmed ones

  double ShareAgainst(size_t cut_idx) const {
    if (num_motions[cut_idx] > 0.0) return 0.0;
    const double sum = num_confirmed[cut_idx] + num_against[cut_idx];
    return sum > 0.0 ? num_against[cut_idx] / sum : 0.0;
  }
  double ConfidenceOf(size_t cut_idx) const {
    if (reasons[cut_idx] == SeamReason::kJump ||
        reasons[cut_idx] == SeamReason::kRefutedLoops ||
        reasons[cut_idx] == SeamReason::kOnePlace) {
      return 0.0;
    }
    // n0 of the confidence: pairs of images with fewer inliers are not
    // accepted.
    return (1.0 - ShareAgainst(cut_idx)) * num_tracks[cut_idx] /
           (num_tracks[cut_idx] + 15.0);
  }
};

std::vector<int> FramesOf(const Scene& scene, const Point3D& point) {
  std::vector<int> frames =
      Transformed(point.track, [&](const Observation& observation) {
        return scene.images[observation.image_idx].frame_idx;
      });
  SortUnique(&frames);
  return frames;
}

// Whether at least `min_num_frames` of a side, or all of it, observe a point,
// and as many of the other side.
bool Ties(const std::vector<int>& frames_of_point,
          const std::vector<int>& side1, const std::vector<int>& side2,
          int min_num_frames) {
  const auto is_on = [&](const std::vector<int>& side) {
    const auto num_on_side = CountIf(frames_of_point, [&](int frame) {
      return std::binary_search(side.begin(), side.end(), frame);
    });
    return num_on_side >=
           std::min<std::ptrdiff_t>(min_num_frames,
                                    static_cast<std::ptrdiff_t>(side.size()));
  };
  return is_on(side1) && is_on(side2);
}

void CountTracks(const ConfidenceInput& input, const FrameCuts& cuts,
                 CutEvidence* evidence) {
  FrameCuts::Sums tracks(cuts), ties(cuts);
  for (const Point3D& point : input.reconstruction.points) {
    const std::vector<int> frames = FramesOf(input.scene, point);
    tracks.AddGroup(frames, 1.0);
    ties.AddTies(frames, 1.0);
  }
  evidence->num_tracks = tracks.Finish();
  evidence->num_ties = ties.Finish();
}

// The cuts with fewer than `min_num_ties` ties. If a side has one frame, or
// only a weaker cut makes it larger, no point has two frames there; the points
// that two frames of the other side observe are then the ties.
void FindFewTies(const ConfidenceInput& input, const FrameCuts& cuts,
                 int min_num_ties, CutEvidence* evidence) {
  std::vector<double>& num_ties = evidence->num_ties;
  std::vector<size_t> few;
  std::vector<int> num_edges(cuts.num_frames(), 0);
  for (size_t k = 0; k < num_ties.size(); ++k) {
    if (num_ties[k] < min_num_ties) few.push_back(k);
    ++num_edges[cuts.cuts()[k].frame_below];
    ++num_edges[cuts.cuts()[k].frame_above];
  }
  if (few.empty()) return;
  StableSortBy(&few, [&](size_t a) {
    return std::pair(num_ties[a], evidence->num_confirmed[a]);
  });
  std::vector<std::vector<const Point3D*>> points_of_frame(cuts.num_frames());
  for (const Point3D& point : input.reconstruction.points) {
    for (const int frame : FramesOf(input.scene, point)) {
      points_of_frame[frame].push_back(&point);
    }
  }
  for (const size_t k : few) {
    const auto& [below, above] = cuts.cuts()[k];
    if (num_edges[below] == 1 || num_edges[above] == 1) {
      const bool is_below = num_edges[below] == 1;
      const int num_required = num_edges[is_below ? above : below] > 1 ? 2 : 1;
      const int end = is_below ? below : above;
      const std::vector<int> others = cuts.FramesOfSide(k, !is_below);
      num_ties[k] = static_cast<double>(
          CountIf(points_of_frame[end], [&](const Point3D* point) {
            return Ties(FramesOf(input.scene, *point), {end}, others,
                        num_required);
          }));
      if (num_ties[k] >= min_num_ties) continue;
    }
    evidence->reasons[k] = SeamReason::kFewTies;
    --num_edges[below];
    --num_edges[above];
  }
}

// Sums amount_of(pair_idx) over the pairs of a list that cross each cut.
template <class Amount>
std::vector<double> SumPairs(const FramePairIndex& index, const FrameCuts& cuts,
                             const std::vector<size_t>& pair_idxs,
                             const Amount& amount_of) {
  FrameCuts::Sums sums(cuts);
  for (const size_t i : pair_idxs) {
    const FramePair& frames = index.Of(i);
    sums.Add(frames.frame_idx1, frames.frame_idx2, amount_of(i));
  }
  return sums.Finish();
}

// The smallest distance by which the second image of a pair must move to agree
// with the pair, whose baseline has a direction only.
std::optional<double> DistanceToPair(const ConfidenceInput& input,
                                     const ImagePair& pair) {
  const auto cam1 =
      input.reconstruction.CamFromWorld(input.scene, pair.image_idx1);
  const auto cam2 =
      input.reconstruction.CamFromWorld(input.scene, pair.image_idx2);
  if (!cam1 || !cam2 || !pair.relative_pose) return std::nullopt;
  const Eigen::Vector3d actual = (*cam2 * cam1->Inverse()).translation;
  const Eigen::Vector3d direction =
      pair.relative_pose->translation_direction.value_or(
          Eigen::Vector3d::Zero());
  return (actual - std::max(0.0, actual.dot(direction)) * direction).norm();
}

double DistanceToGroup(const ConfidenceInput& input,
                       const RejectedGroup& group) {
  std::vector<double> distances;
  for (const size_t i : group.pair_idxs) {
    const auto distance = DistanceToPair(input, input.view_graph.pairs[i]);
    if (distance) distances.push_back(*distance);
  }
  return distances.empty() ? 0.0 : Median(std::move(distances));
}

// Per cut: the longest error that the step between the adjacent frames can
// hide: twice the length of fast steps of the sequence, for a rig that moves
// backward instead of forward. Infinite if the frames are not of one sequence.
std::vector<double> ErrorsHiddenByCuts(const ConfidenceInput& input,
                                       const FrameCuts& cuts) {
  const auto& poses = input.reconstruction.rig_from_world;
  std::vector<double> lengths;
  for (const FramePair& frames : input.index.frame_pairs()) {
    const auto& pose1 = poses[frames.frame_idx1];
    const auto& pose2 = poses[frames.frame_idx2];
    if (frames.time_gap != 1 || !pose1 || !pose2) continue;
    lengths.push_back((pose2->Center() - pose1->Center()).norm());
  }
  std::vector<double> hidden(cuts.cuts().size(),
                             std::numeric_limits<double>::infinity());
  if (lengths.empty()) return hidden;
  // The quantile of step lengths that counts as fast. Loops between places that
  // look alike have 15 to 50 times the error that this allows
  // (docs/maths/seams.md).
  const double fast_step = Quantile(std::move(lengths), 0.9);
  for (size_t k = 0; k < hidden.size(); ++k) {
    const auto& [below, above] = cuts.cuts()[k];
    const FramePair* frames = input.index.Find(below, above);
    if (frames != nullptr && frames->time_gap) {
      hidden[k] = 2.0 * fast_step * *frames->time_gap;
    }
  }
  return hidden;
}

// The matches of the largest group against each cut: a group counts against
// the weakest cut that can hide its error. `strengths` per cut.
std::vector<double> MostAgainst(const ConfidenceInput& input,
                                const FrameCuts& cuts,
                                const std::vector<int>& num_confirmed,
                                const std::vector<double>& strengths) {
  std::vector<double> most(cuts.cuts().size(), 0.0);
  const std::vector<double> hidden = ErrorsHiddenByCuts(input, cuts);
  for (const RejectedGroup& group : input.rejected_groups) {
    const double distance = DistanceToGroup(input, group);
    const std::vector<double> of_group =
        SumPairs(input.index, cuts, group.pair_idxs, [&](size_t i) {
          const auto num_matches =
              static_cast<double>(input.view_graph.pairs[i].matches.size());
          return input.pair_is_used[i] ? 0.0 : num_matches - num_confirmed[i];
        });
    std::optional<size_t> weakest;
    for (size_t k = 0; k < most.size(); ++k) {
      if (of_group[k] > 0.0 && distance <= hidden[k] &&
          (!weakest || strengths[k] < strengths[*weakest])) {
        weakest = k;
      }
    }
    if (weakest) most[*weakest] = std::max(most[*weakest], of_group[*weakest]);
  }
  return most;
}

CutEvidence CollectEvidence(const ConfidenceInput& input, const FrameCuts& cuts,
                            const std::vector<int>& num_confirmed) {
  std::vector<size_t> used;
  for (size_t i = 0; i < input.pair_is_used.size(); ++i) {
    if (input.pair_is_used[i]) used.push_back(i);
  }
  CutEvidence evidence;
  CountTracks(input, cuts, &evidence);
  evidence.num_pairs =
      SumPairs(input.index, cuts, used, [](size_t) { return 1.0; });
  evidence.num_confirmed = SumPairs(input.index, cuts, used, [&](size_t i) {
    return static_cast<double>(num_confirmed[i]);
  });
  evidence.num_against =
      MostAgainst(input, cuts, num_confirmed, evidence.num_confirmed);
  FrameCuts::Sums confirmed(cuts);
  for (const auto& [frame1, frame2] : input.motions.confirmed) {
    confirmed.Add(frame1, frame2, 1.0);
  }
  evidence.num_motions = confirmed.Finish();
  return evidence;
}

// The weakest cut of each jump. If loops lead from one frame to the other, it
// is one that a loop crosses: they can show another place, the neighbors along
// the way cannot.
void FindJumps(const ConfidenceInput& input, const FrameCuts& cuts,
               CutEvidence* evidence) {
  const auto is_loop = [&](size_t cut_idx) {
    const auto& [below, above] = cuts.cuts()[cut_idx];
    const FramePair* frames = input.index.Find(below, above);
    return frames != nullptr && input.index.IsLoop(*frames);
  };
  std::vector<std::pair<bool, double>> strengths;
  for (size_t k = 0; k < cuts.cuts().size(); ++k) {
    strengths.emplace_back(!is_loop(k), evidence->num_confirmed[k]);
  }
  for (const auto& [frame1, frame2] : input.motions.jumps) {
    const auto cut = cuts.SmallestBetween(frame1, frame2, strengths);
    if (!cut) continue;
    evidence->reasons[*cut] =
        is_loop(*cut) ? SeamReason::kRefutedLoops : SeamReason::kJump;
  }
}

// The cuts that loops of one place alone cross. Pairs most of whose matches are
// not confirmed do not count: loops of places that look alike can contradict
// each other and the neighbors.
void FindLoopsOfOnePlace(const ConfidenceInput& input, const FrameCuts& cuts,
                         const std::vector<int>& num_confirmed,
                         CutEvidence* evidence) {
  const FramePairIndex& index = input.index;
  if (!index.is_sequence()) return;
  std::vector<size_t> loops, neighbors;
  for (size_t i = 0; i < input.pair_is_used.size(); ++i) {
    const size_t num_matches = input.view_graph.pairs[i].matches.size();
    if (!input.pair_is_used[i] ||
        2 * static_cast<size_t>(num_confirmed[i]) <= num_matches) {
      continue;
    }
    (index.IsLoop(index.Of(i)) ? loops : neighbors).push_back(i);
  }
  const auto one = [](size_t) { return 1.0; };
  const std::vector<double> num_loops = SumPairs(index, cuts, loops, one);
  const std::vector<double> num_neighbors =
      SumPairs(index, cuts, neighbors, one);
  for (size_t k = 0; k < num_loops.size(); ++k) {
    if (num_neighbors[k] > 0.0 || num_loops[k] == 0.0) continue;
    const std::vector<int> below = cuts.FramesOfSide(k, true);
    const std::vector<int> above = cuts.FramesOfSide(k, false);
    const auto is_below = [&](int frame) {
      return std::binary_search(below.begin(), below.end(), frame);
    };
    std::vector<std::pair<int, int>> links;
    for (const size_t i : loops) {
      const auto& [frame1, frame2, pair_idxs, time_gap] = index.Of(i);
      if (is_below(frame1) == is_below(frame2)) continue;
      links.emplace_back(is_below(frame1) ? frame1 : frame2,
                         is_below(frame1) ? frame2 : frame1);
    }
    if (ShowOnePlace(index, input.pair_is_used, links, below, above)) {
      evidence->reasons[k] = SeamReason::kOnePlace;
    }
  }
}

std::optional<SeamReason> ReasonOf(const CutEvidence& evidence, size_t cut_idx,
                                   const ConfidenceOptions& options) {
  if (!evidence.reasons[cut_idx] &&
      evidence.ShareAgainst(cut_idx) > options.max_share_against) {
    return SeamReason::kContradicted;
  }
  return evidence.reasons[cut_idx];
}

Seam MakeSeam(const FrameCuts& cuts, const CutEvidence& evidence,
              size_t cut_idx, SeamReason reason) {
  const FrameCuts::Cut& cut = cuts.cuts()[cut_idx];
  const bool core_is_above = cuts.CoreIsAbove(cut_idx);
  Seam seam;
  seam.reason = reason;
  seam.frame_idx_beyond = core_is_above ? cut.frame_below : cut.frame_above;
  seam.frame_idx_core = core_is_above ? cut.frame_above : cut.frame_below;
  seam.frame_idxs_beyond = cuts.FramesOfSide(cut_idx, core_is_above);
  seam.num_pairs = static_cast<int>(evidence.num_pairs[cut_idx]);
  seam.num_tracks = static_cast<int>(evidence.num_tracks[cut_idx]);
  seam.num_ties = static_cast<int>(evidence.num_ties[cut_idx]);
  seam.num_confirmed = static_cast<int>(evidence.num_confirmed[cut_idx]);
  seam.num_against = static_cast<int>(evidence.num_against[cut_idx]);
  return seam;
}

}  // namespace

int CountTies(const Scene& scene, const Reconstruction& reconstruction,
              const std::vector<int>& side1, const std::vector<int>& side2) {
  return static_cast<int>(
      CountIf(reconstruction.points, [&](const Point3D& point) {
        return Ties(FramesOf(scene, point), side1, side2, 2);
      }));
}

Confidence EstimateConfidence(const ConfidenceInput& input,
                              const ConfidenceOptions& options) {
  MGSFM_CHECK_EQ(input.index.num_pairs(), input.view_graph.pairs.size());
  MGSFM_CHECK_EQ(input.pair_is_used.size(), input.view_graph.pairs.size());
  const std::vector<int> num_confirmed = CountConfirmed(input);
  const FrameCuts cuts = FindCuts(input, num_confirmed);
  CutEvidence evidence = CollectEvidence(input, cuts, num_confirmed);
  evidence.reasons.resize(cuts.cuts().size());
  // Later reasons replace earlier ones.
  FindFewTies(input, cuts, std::max(1, options.min_num_ties), &evidence);
  FindJumps(input, cuts, &evidence);
  FindLoopsOfOnePlace(input, cuts, num_confirmed, &evidence);
  std::vector<double> confidences;
  std::vector<size_t> weak;
  for (size_t k = 0; k < cuts.cuts().size(); ++k) {
    confidences.push_back(evidence.ConfidenceOf(k));
    if (ReasonOf(evidence, k, options)) weak.push_back(k);
  }
  StableSortBy(&weak, [&](size_t k) { return confidences[k]; });
  Confidence result;
  for (const size_t k : weak) {
    result.seams.push_back(
        MakeSeam(cuts, evidence, k, *ReasonOf(evidence, k, options)));
  }
  const std::vector<double> of_frame = cuts.SmallestToCore(confidences);
  for (size_t i = 0; i < input.scene.frames.size(); ++i) {
    const bool is_registered =
        input.reconstruction.rig_from_world[i].has_value();
    result.of_frame.push_back(is_registered ? std::optional(of_frame[i])
                                            : std::nullopt);
  }
  return result;
}

}  // namespace mgsfm
