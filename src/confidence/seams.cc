// SPDX-License-Identifier: BSD-3-Clause
#include "confidence/seams.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "confidence/frame_cuts.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using FramePair = FramePairIndex::FramePair;

// n0 of the confidence: pairs of images with fewer inliers are not accepted.
constexpr double kFewTracks = 15.0;
// A group of rejected pairs contradicts cuts up to this factor stronger than
// the weakest one of its loop. docs/results/hard_drives.md compares 1.5 to 3.
constexpr double kMaxStrengthOfDoubtful = 2.0;

// The point that observes each keypoint.
class PointOfKeypoint {
 public:
  PointOfKeypoint(const Scene& scene, const Reconstruction& reconstruction) {
    for (const Image& image : scene.images) {
      points_.emplace_back(image.keypoints_px.size());
    }
    for (size_t i = 0; i < reconstruction.points.size(); ++i) {
      for (const Observation& o : reconstruction.points[i].track) {
        points_[o.image_idx][o.keypoint_idx] = i;
      }
    }
  }

  int CountConfirmed(const ImagePair& pair) const {
    return static_cast<int>(std::count_if(
        pair.matches.begin(), pair.matches.end(), [&](const Match& match) {
          const auto& point1 = points_[pair.image_idx1][match.keypoint_idx1];
          return point1 &&
                 point1 == points_[pair.image_idx2][match.keypoint_idx2];
        }));
  }

 private:
  std::vector<std::vector<std::optional<size_t>>> points_;  // per image
};

// Per image pair.
std::vector<int> CountConfirmed(const ConfidenceInput& input) {
  const PointOfKeypoint points(input.scene, input.reconstruction);
  std::vector<int> num_confirmed;
  for (const ImagePair& pair : input.view_graph.pairs) {
    num_confirmed.push_back(points.CountConfirmed(pair));
  }
  return num_confirmed;
}

// Pairs without a confirmed match join parts only if no others do, and
// neighbours in the order of frames only if no pairs do.
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

// Counts of what crosses each cut.
struct CutEvidence {
  std::vector<double> num_tracks;
  std::vector<double> num_pairs;
  std::vector<double> num_confirmed;
  std::vector<double> num_against;

  double ShareAgainst(size_t cut_idx) const {
    const double sum = num_confirmed[cut_idx] + num_against[cut_idx];
    return sum > 0.0 ? num_against[cut_idx] / sum : 0.0;
  }
  double ConfidenceOf(size_t cut_idx) const {
    return (1.0 - ShareAgainst(cut_idx)) * num_tracks[cut_idx] /
           (num_tracks[cut_idx] + kFewTracks);
  }
};

std::vector<double> SumTracks(const ConfidenceInput& input,
                              const FrameCuts& cuts) {
  FrameCuts::Sums sums(cuts);
  for (const Point3D& point : input.reconstruction.points) {
    std::vector<int> frames;
    for (const Observation& observation : point.track) {
      frames.push_back(input.scene.images[observation.image_idx].frame_idx);
    }
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    sums.AddGroup(std::move(frames), 1.0);
  }
  return sums.Finish();
}

// Sums amount_of(pair_idx) over the pairs of a list that cross each cut.
template <class PairIdxs, class Amount>
std::vector<double> SumPairs(const FramePairIndex& index, const FrameCuts& cuts,
                             const PairIdxs& pair_idxs,
                             const Amount& amount_of) {
  FrameCuts::Sums sums(cuts);
  for (const size_t i : pair_idxs) {
    const FramePair& frames = index.Of(i);
    sums.Add(frames.frame_idx1, frames.frame_idx2, amount_of(i));
  }
  return sums.Finish();
}

// The matches of the largest group against each cut. A loop of pairs that
// contradicts the model does not tell which of the cuts that it closes is
// wrong; the weakest ones are doubtful. `strengths` per cut.
std::vector<double> MostAgainst(const ConfidenceInput& input,
                                const FrameCuts& cuts,
                                const std::vector<int>& num_confirmed,
                                const std::vector<double>& strengths) {
  std::vector<double> most(cuts.cuts().size(), 0.0);
  for (const RejectedGroup& group : input.rejected_groups) {
    const std::vector<double> of_group =
        SumPairs(input.index, cuts, group.pair_idxs, [&](size_t i) {
          return static_cast<double>(input.view_graph.pairs[i].matches.size()) -
                 num_confirmed[i];
        });
    double weakest = std::numeric_limits<double>::infinity();
    for (size_t k = 0; k < most.size(); ++k) {
      if (of_group[k] > 0.0) weakest = std::min(weakest, strengths[k]);
    }
    for (size_t k = 0; k < most.size(); ++k) {
      if (strengths[k] > kMaxStrengthOfDoubtful * weakest) continue;
      most[k] = std::max(most[k], of_group[k]);
    }
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
  evidence.num_tracks = SumTracks(input, cuts);
  evidence.num_pairs =
      SumPairs(input.index, cuts, used, [](size_t) { return 1.0; });
  evidence.num_confirmed = SumPairs(input.index, cuts, used, [&](size_t i) {
    return static_cast<double>(num_confirmed[i]);
  });
  evidence.num_against =
      MostAgainst(input, cuts, num_confirmed, evidence.num_confirmed);
  return evidence;
}

// The weakest cut of each jump.
Mask FindJumps(const ConfidenceInput& input, const FrameCuts& cuts,
               const CutEvidence& evidence) {
  Mask is_jump(cuts.cuts().size(), false);
  for (const auto& [frame1, frame2] : input.jumps) {
    const auto cut =
        cuts.SmallestBetween(frame1, frame2, evidence.num_confirmed);
    if (cut) is_jump[*cut] = true;
  }
  return is_jump;
}

std::optional<SeamReason> ReasonOf(const CutEvidence& evidence, size_t cut_idx,
                                   const ConfidenceOptions& options) {
  if (evidence.num_tracks[cut_idx] < std::max(1, *options.min_num_tracks)) {
    return SeamReason::kFewTracks;
  }
  if (evidence.ShareAgainst(cut_idx) > options.max_share_against) {
    return SeamReason::kContradicted;
  }
  return std::nullopt;
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
  seam.num_confirmed = static_cast<int>(evidence.num_confirmed[cut_idx]);
  seam.num_against = static_cast<int>(evidence.num_against[cut_idx]);
  return seam;
}

}  // namespace

Confidence EstimateConfidence(const ConfidenceInput& input,
                              const ConfidenceOptions& options) {
  MGSFM_CHECK_EQ(input.index.num_pairs(), input.view_graph.pairs.size());
  MGSFM_CHECK_EQ(input.pair_is_used.size(), input.view_graph.pairs.size());
  const std::vector<int> num_confirmed = CountConfirmed(input);
  const FrameCuts cuts = FindCuts(input, num_confirmed);
  const CutEvidence evidence = CollectEvidence(input, cuts, num_confirmed);
  const Mask is_jump = FindJumps(input, cuts, evidence);
  std::vector<double> confidences;
  std::vector<std::pair<double, Seam>> seams;
  for (size_t k = 0; k < cuts.cuts().size(); ++k) {
    confidences.push_back(is_jump[k] ? 0.0 : evidence.ConfidenceOf(k));
    if (const auto reason =
            is_jump[k] ? SeamReason::kJump : ReasonOf(evidence, k, options)) {
      seams.emplace_back(confidences.back(),
                         MakeSeam(cuts, evidence, k, *reason));
    }
  }
  std::stable_sort(
      seams.begin(), seams.end(),
      [](const auto& a, const auto& b) { return a.first < b.first; });
  Confidence result;
  for (auto& [confidence, seam] : seams)
    result.seams.push_back(std::move(seam));
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
