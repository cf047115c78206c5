// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/moving_objects.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/statistics.h"
#include "moving_objects/frame_depths.h"
#include "moving_objects/motion_continuity.h"
#include "moving_objects/motion_hypotheses.h"
#include "moving_objects/path_agreement.h"
#include "moving_objects/rig_motions.h"
#include "scene/observations.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/scale_averaging.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// An excess of one contradicting match may be a mismatch.
constexpr int kMinBalance = 2;
// A smaller fraction of contradicting matches does not bias a relative pose.
constexpr double kMaxContradicting = 0.1;

bool IsDoubtful(const RigPath& path, const FramePair& frames) {
  return path.is_doubtful[frames.frame_idx1] ||
         path.is_doubtful[frames.frame_idx2];
}

// The motion from frame 1 to frame 2 of neighbors, refined next to objects.
// nullopt unless the path measures it, or interpolates it if that is enough.
std::optional<MeasuredMotion> MotionBetween(const MotionProblem& problem,
                                            const RigPath& path,
                                            const FramePair& frames,
                                            bool is_interpolated) {
  int earlier = frames.frame_idx1, later = frames.frame_idx2;
  if (!frames.IsBetweenFrames() || !problem.index.AreNeighbors(frames) ||
      !path.IsComparable(earlier, later)) {
    return std::nullopt;
  }
  const bool is_reversed = problem.index.order()->IsBefore(later, earlier);
  if (is_reversed) std::swap(earlier, later);
  std::optional<MeasuredMotion> motion;
  if (!is_interpolated && IsDoubtful(path, frames)) {
    motion = RefineMotion(problem, path, earlier, later);
  }
  if (!motion &&
      (is_interpolated || path.group[earlier] == path.group[later])) {
    motion = path.MeasuredBetween(earlier, later);
  }
  return motion && is_reversed ? motion->Inverse() : motion;
}

// Predicts only pairs of sensors with known poses in the rig. Where no match
// measures a motion between the frames, their pairs have no expected pose.
std::vector<ExpectedPair> ExpectPairs(const MotionProblem& problem,
                                      const RigPath& path,
                                      const Context& context) {
  const std::vector<FramePair>& frame_pairs = problem.index.frame_pairs();
  std::vector<std::vector<ExpectedPair>> of_frames(frame_pairs.size());
  ParallelFor(frame_pairs.size(), context.num_threads, [&](size_t f) {
    const FramePair& frames = frame_pairs[f];
    const auto motion = MotionBetween(problem, path, frames, false);
    if (!motion) return;
    for (const size_t i : frames.pair_idxs) {
      const auto pair = ExpectPair(problem, i, frames.frame_idx1, *motion);
      if (pair) of_frames[f].push_back(*pair);
    }
  });
  std::vector<ExpectedPair> expected = Concatenated(of_frames);
  SortBy(&expected, [](const auto& a) { return a.pair_idx; });
  return expected;
}

// The pair of the same images with all matches.
const ImagePair& SourceOf(const MotionProblem& problem, const ImagePair& pair) {
  return *FindPair(problem.matches, pair.image_idx1, pair.image_idx2);
}

// Compares matches with the expected pose of their images.
auto ComparisonWith(const MotionProblem& problem,
                    const ExpectedPair& expected) {
  return [&problem, &expected,
          tolerance_rad = ToleranceOf(problem, expected)](const Match& match) {
    return CompareWithMotion(problem.bearings, problem.depths,
                             problem.view_graph.pairs[expected.pair_idx], match,
                             expected.cam2_from_cam1, tolerance_rad);
  };
}

// Keypoints on moving objects: most of their matches contradict the expected
// poses of pairs. Most keypoints of an object have no depth in their own frame,
// but a match with a keypoint that has one. An outlier of verification that
// contradicts may be a mismatch and does not count.
class MovingKeypoints {
 public:
  MovingKeypoints(const MotionProblem& problem,
                  const std::vector<ExpectedPair>& expected)
      : balance_(problem.scene.images.size()) {
    for (const ExpectedPair& e : expected) Count(problem, e);
  }

  // Whether a keypoint of a match moves, or rests.
  bool Moves(const ImagePair& pair, const Match& match) const {
    return Balance(pair.image_idx1, match.keypoint_idx1) >= kMinBalance ||
           Balance(pair.image_idx2, match.keypoint_idx2) >= kMinBalance;
  }
  bool Rests(const ImagePair& pair, const Match& match) const {
    return Balance(pair.image_idx1, match.keypoint_idx1) <= -kMinBalance ||
           Balance(pair.image_idx2, match.keypoint_idx2) <= -kMinBalance;
  }

 private:
  int Balance(int image_idx, uint32_t keypoint_idx) const {
    const std::vector<int>& balance = balance_[image_idx];
    return balance.empty() ? 0 : balance[keypoint_idx];
  }

  void Count(const MotionProblem& problem, const ExpectedPair& expected) {
    const ImagePair& source =
        SourceOf(problem, problem.view_graph.pairs[expected.pair_idx]);
    for (const int image_idx : {source.image_idx1, source.image_idx2}) {
      balance_[image_idx].resize(
          problem.scene.images[image_idx].keypoints_px.size(), 0);
    }
    const auto compare = ComparisonWith(problem, expected);
    for (const auto* matches : {&source.matches, &source.outliers}) {
      for (const Match& match : *matches) {
        const MatchVerdict verdict = compare(match);
        int change = 0;
        if (verdict == MatchVerdict::kAgrees) change = -1;
        if (verdict == MatchVerdict::kContradicts &&
            matches == &source.matches) {
          change = 1;
        }
        balance_[source.image_idx1][match.keypoint_idx1] += change;
        balance_[source.image_idx2][match.keypoint_idx2] += change;
      }
    }
  }

  std::vector<std::vector<int>> balance_;  // contradicting less agreeing ones
};

// The matches of a pair, verified or not, that agree with the path.
std::vector<Match> AgreeingMatches(const MotionProblem& problem,
                                   const MovingKeypoints& moving,
                                   const ExpectedPair& expected,
                                   const ImagePair& pair) {
  const auto compare = ComparisonWith(problem, expected);
  std::vector<Match> agreeing = AllMatches(pair);
  EraseIf(&agreeing, [&](const Match& match) {
    return moving.Moves(pair, match) ||
           compare(match) == MatchVerdict::kContradicts;
  });
  return agreeing;
}

// The pair to verify: matches from before verification that agree with the
// path.
ImagePair SelectMatches(const MotionProblem& problem,
                        const MovingKeypoints& moving,
                        const ExpectedPair& expected) {
  const ImagePair& pair = problem.view_graph.pairs[expected.pair_idx];
  ImagePair selected;
  selected.image_idx1 = pair.image_idx1;
  selected.image_idx2 = pair.image_idx2;
  selected.config = TwoViewConfig::kCalibrated;
  selected.relative_pose = {expected.cam2_from_cam1.rotation, std::nullopt};
  const double length = expected.cam2_from_cam1.translation.norm();
  if (length > 0.0) {
    selected.relative_pose->translation_direction =
        expected.cam2_from_cam1.translation / length;
  }
  selected.matches =
      AgreeingMatches(problem, moving, expected, SourceOf(problem, pair));
  return selected;
}

// Estimates pairs from the matches that agree with their expected poses.
// Returns the pairs for which this succeeds, with their poses.
std::vector<ExpectedPair> VerifyPairs(
    const MotionProblem& problem, const RigPath& path,
    const std::vector<ExpectedPair>& expected,
    const ViewGraphOptions& verification, const Context& context,
    std::vector<std::optional<ImagePair>>* pair_of_scene) {
  const MovingKeypoints moving(problem, expected);
  ViewGraph selected;
  selected.pairs.resize(expected.size());
  ParallelFor(expected.size(), context.num_threads, [&](size_t i) {
    selected.pairs[i] = SelectMatches(problem, moving, expected[i]);
  });
  ViewGraph verified = EstimateViewGraph(problem.scene, problem.bearings,
                                         selected, verification, context)
                           .estimate;
  std::vector<ExpectedPair> found;
  size_t k = 0;
  for (ImagePair& pair : verified.pairs) {
    while (selected.pairs[k].image_idx1 != pair.image_idx1 ||
           selected.pairs[k].image_idx2 != pair.image_idx2) {
      ++k;
    }
    const RelativePose& pose = *pair.relative_pose;
    if (!AgreesWithPath(problem, path, pair, expected[k])) continue;
    ExpectedPair e = expected[k];
    e.cam2_from_cam1.rotation = pose.cam2_from_cam1;
    if (pose.translation_direction) {
      e.cam2_from_cam1.translation =
          e.cam2_from_cam1.translation.norm() * *pose.translation_direction;
    }
    e.covariance.setZero();
    found.push_back(e);
    (*pair_of_scene)[e.pair_idx] = std::move(pair);
  }
  return found;
}

// The pairs next to objects that contradict the path, by their poses or by more
// than a few of their matches.
std::vector<ExpectedPair> SelectDoubtful(
    const MotionProblem& problem, const RigPath& path,
    const std::vector<ExpectedPair>& expected) {
  std::vector<ExpectedPair> near;
  for (const ExpectedPair& e : expected) {
    if (IsDoubtful(path, problem.index.Of(e.pair_idx))) near.push_back(e);
  }
  const MovingKeypoints moving(problem, near);
  std::vector<ExpectedPair> doubtful;
  for (const ExpectedPair& e : near) {
    const ImagePair& pair = problem.view_graph.pairs[e.pair_idx];
    const auto num_contradicting =
        static_cast<double>(pair.matches.size()) -
        static_cast<double>(AgreeingMatches(problem, moving, e, pair).size());
    if (!AgreesWithPath(problem, path, pair, e) ||
        num_contradicting >
            kMaxContradicting * static_cast<double>(pair.matches.size())) {
      doubtful.push_back(e);
    }
  }
  return doubtful;
}

// Whether a pair agrees with the path by its pose, and by most of its matches
// whose depth is known.
bool AgreesInPoseAndDepths(const MotionProblem& problem, const RigPath& path,
                           const ExpectedPair& expected) {
  const ImagePair& pair = problem.view_graph.pairs[expected.pair_idx];
  if (!AgreesWithPath(problem, path, pair, expected)) return false;
  const std::vector<MatchVerdict> verdicts =
      Transformed(pair.matches, ComparisonWith(problem, expected));
  const auto count = [&](MatchVerdict verdict) {
    return std::count(verdicts.begin(), verdicts.end(), verdict);
  };
  return count(MatchVerdict::kAgrees) > count(MatchVerdict::kContradicts);
}

// Pairs of frames between which no match measures the motion show an object if
// more of their matches are of keypoints that move elsewhere than of keypoints
// that rest. Pairs that agree with the interpolated path are kept: keypoints
// without depth are never found to rest.
void RejectObjects(const MotionProblem& problem, const RigPath& path,
                   const std::vector<ExpectedPair>& expected,
                   Mask* pair_is_discontinuous) {
  const MovingKeypoints moving(problem, expected);
  Mask is_expected(pair_is_discontinuous->size(), false);
  for (const ExpectedPair& e : expected) is_expected[e.pair_idx] = true;
  for (size_t i = 0; i < is_expected.size(); ++i) {
    const FramePair& frames = problem.index.Of(i);
    if (is_expected[i] || !frames.IsBetweenFrames() ||
        !IsDoubtful(path, frames)) {
      continue;
    }
    const ImagePair& pair = problem.view_graph.pairs[i];
    int num_moving = 0, num_static = 0;
    for (const Match& match : pair.matches) {
      const bool moves = moving.Moves(pair, match);
      const bool rests = moving.Rests(pair, match);
      num_moving += moves && !rests ? 1 : 0;
      num_static += rests && !moves ? 1 : 0;
    }
    if (num_moving <= num_static) continue;
    const auto motion = MotionBetween(problem, path, frames, true);
    const auto by_path =
        motion ? ExpectPair(problem, i, frames.frame_idx1, *motion)
               : std::nullopt;
    if (!by_path || !AgreesInPoseAndDepths(problem, path, *by_path)) {
      (*pair_is_discontinuous)[i] = true;
    }
  }
}

// Whether the path determines the length of the baseline: its standard
// deviation is within the tolerance of motions that agree.
bool HasLength(const ExpectedPair& expected) {
  const Vector3d& baseline = expected.cam2_from_cam1.translation;
  return SigmaAlong(expected.covariance.bottomRightCorner<3, 3>(), baseline) <=
         kRelativeTolerance * baseline.norm();
}

// The relative poses of pairs next to objects whose baseline has a known
// length, and of pairs within frames.
std::vector<std::optional<Rigid3>> PosesNearObjects(
    const MotionProblem& problem, const RigPath& path,
    const std::vector<ExpectedPair>& expected) {
  std::vector<std::optional<Rigid3>> poses(problem.view_graph.pairs.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    if (problem.index.Of(i).IsBetweenFrames()) continue;
    poses[i] = RelativePoseBy(problem, problem.view_graph.pairs[i],
                              problem.index.Of(i).frame_idx1, {});
  }
  for (const ExpectedPair& e : expected) {
    if (IsDoubtful(path, problem.index.Of(e.pair_idx)) && HasLength(e)) {
      poses[e.pair_idx] = e.cam2_from_cam1;
    }
  }
  return poses;
}

// Estimates the pairs next to objects again from matches that agree with the
// path.
MotionOfScene JudgeByMatches(const MotionProblem& problem, const RigPath& path,
                             const ViewGraphOptions& verification,
                             const Context& context) {
  if (!path.is_doubtful.Any()) return {};
  const std::vector<ExpectedPair> expected =
      ExpectPairs(problem, path, context);
  const size_t num_pairs = problem.view_graph.pairs.size();
  MotionOfScene motion;
  motion.verdicts.resize(num_pairs);
  motion.pair_of_scene.resize(num_pairs);
  motion.pair_on_path = PosesNearObjects(problem, path, expected);
  std::vector<ExpectedPair> judged = SelectDoubtful(problem, path, expected);
  Mask is_discontinuous(num_pairs, false);
  for (const ExpectedPair& e : judged) is_discontinuous[e.pair_idx] = true;
  ViewGraphOptions of_prediction = verification;
  // Other pairs need more matches than one whose pose the path predicts.
  of_prediction.min_num_inliers = std::min(*verification.min_num_inliers,
                                           static_cast<int>(kMinNumAgreeing));
  // The second round starts from the poses of the first.
  for (int round = 0; round < 2; ++round) {
    judged = VerifyPairs(problem, path, judged, of_prediction, context,
                         &motion.pair_of_scene);
  }
  for (const ExpectedPair& e : judged) is_discontinuous[e.pair_idx] = false;
  for (const ExpectedPair& e : expected) {
    if (is_discontinuous[e.pair_idx] &&
        AgreesInPoseAndDepths(problem, path, e)) {
      is_discontinuous[e.pair_idx] = false;
    }
  }
  RejectObjects(problem, path, expected, &is_discontinuous);
  Reject(is_discontinuous, RejectionReason::kDiscontinuousMotion,
         &motion.verdicts);
  return motion;
}

// Rejects the pairs of equal sensors next to objects whose own poses contradict
// the path.
MotionOfScene JudgeByPoses(const MotionProblem& problem, const RigPath& path,
                           const BaselineLengths& lengths,
                           const Context& context) {
  if (!path.is_doubtful.Any()) return {};
  Mask is_discontinuous(lengths.size(), false);
  for (const ExpectedPair& e : ExpectPairs(problem, path, context)) {
    const ImagePair& pair = problem.view_graph.pairs[e.pair_idx];
    const auto& length = lengths[e.pair_idx];
    is_discontinuous[e.pair_idx] =
        length && IsDoubtful(path, problem.index.Of(e.pair_idx)) &&
        IsOfOneSensor(problem.scene, pair) &&
        !AgreesWithPath(problem, path, pair, e, length);
  }
  if (!is_discontinuous.Any()) return {};
  MotionOfScene motion;
  motion.verdicts.resize(lengths.size());
  Reject(is_discontinuous, RejectionReason::kDiscontinuousMotion,
         &motion.verdicts);
  return motion;
}

// Rejects pairs of neighbors across an ambiguous step.
void RejectAmbiguous(const FramePairIndex& index, const RigPath& path,
                     MotionOfScene* motion) {
  AmbiguousSteps steps = FindAmbiguousSteps(index, path);
  motion->frame_is_ambiguous = std::move(steps.frame_is_beside);
  if (!steps.pair_is_across.Any()) return;
  motion->verdicts.resize(index.num_pairs());
  Reject(steps.pair_is_across, RejectionReason::kAmbiguousMotion,
         &motion->verdicts);
}

// The displacement that moves a keypoint by max_error_px (median).
double NoiseDisplacement(const Scene& scene, const FrameDepths& depths,
                         double max_error_px) {
  std::vector<double> displacements;
  for (size_t i = 0; i < depths.keypoints.size(); ++i) {
    const double error_rad = ErrorRad(scene, static_cast<int>(i), max_error_px);
    for (const auto& depth : depths.keypoints[i]) {
      if (depth) displacements.push_back(error_rad * depth->distance);
    }
  }
  return displacements.empty() ? 0.0 : Median(std::move(displacements));
}

// nullopt without depths, and if they are no evidence of motions.
std::optional<MotionOfScene> FindByDepths(const MotionInput& input,
                                          const FramePairIndex& matches_index,
                                          const MotionOptions& options,
                                          const Context& context,
                                          RigPath* path) {
  const double max_error_px = options.verification.max_error_px;
  const FrameDepths depths = MeasureFrameDepths(
      input, {options.min_parallax_deg, kKeypointNoise * max_error_px},
      context);
  if (!AnyOf(depths.cam_from_rig, [](const auto& cam_from_rig) {
        return cam_from_rig.has_value();
      })) {
    return std::nullopt;
  }
  MotionProblem problem{input, matches_index, depths, max_error_px,
                        options.filtering.max_relative_baseline_error};
  problem.noise_displacement =
      NoiseDisplacement(input.scene, depths, max_error_px);
  const MotionEvidence evidence{
      [&](int earlier, int later) {
        return FindHypothesesByDepths(problem, context.random_seed, earlier,
                                      later);
      },
      [&](int earlier, int later, const Rigid3& a, const Rigid3& b) {
        return ExclusionOf(problem, earlier, later, a, b);
      },
      [&](int earlier, int later, const Rigid3& motion) {
        return RefineByDepths(problem, earlier, later, motion);
      }};
  *path = FindRigPath(*input.index.order(), input.index.num_frames(), evidence,
                      context.num_threads);
  if (path->noise.depths_contradict_pairs) return std::nullopt;
  return JudgeByMatches(problem, RefinePath(problem, *path),
                        options.verification, context);
}

// Rotations of the sensors, without lever arms and depths.
FrameDepths RotationsOfSensors(const MotionInput& input) {
  FrameDepths depths;
  depths.keypoints.resize(input.scene.images.size());
  for (const auto& rotation : input.rotations.sensor_from_rig) {
    auto& cam_from_rig = depths.cam_from_rig.emplace_back();
    if (rotation) cam_from_rig = {*rotation, Vector3d::Zero()};
  }
  return depths;
}

// The lengths of baselines are by scale averaging. A pair without parallax can
// be as long as the displacement that moves a keypoint of a point at the
// typical depth by the tolerance of matches, in the median of the images.
MotionOfScene FindByPairs(MotionProblem problem, double min_parallax_deg,
                          const Context& context, RigPath* path) {
  const Scene& scene = problem.scene;
  const std::vector<ImagePair>& pairs = problem.view_graph.pairs;
  Mask is_near(pairs.size(), false);
  for (size_t i = 0; i < pairs.size(); ++i) {
    is_near[i] = problem.index.AreNeighbors(problem.index.Of(i)) &&
                 pairs[i].relative_pose;
  }
  const std::vector<BaselineDirection> measured = EstimateBaselineDirections(
      {scene, problem.bearings, problem.view_graph, is_near,
       MakePositionProblem(scene, problem.rotations)},
      min_parallax_deg, context, PairRotation::kOwn);
  const PairScales scales =
      AverageScales(measured, static_cast<int>(scene.images.size()), context);
  std::vector<double> errors_rad;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    errors_rad.push_back(
        ErrorRad(scene, static_cast<int>(i), problem.max_error_px));
  }
  problem.noise_displacement =
      scales.typical_depth * Median(std::move(errors_rad));
  BaselineLengths lengths(pairs.size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    const auto& scale = scales.pairs[i];
    if (scale && scale->group == 0) {
      lengths[i] = {scale->scale, scale->scale * scale->sigma_log};
    } else if (measured[i].kind == BaselineKind::kNoParallax) {
      lengths[i] = {0.0, problem.noise_displacement};
    }
  }
  *path = FindRigPath(*problem.index.order(), problem.index.num_frames(),
                      {[&](int earlier, int later) {
                        return FindHypothesesByPairs(problem, lengths, earlier,
                                                     later);
                      }},
                      context.num_threads);
  return JudgeByPoses(problem, *path, lengths, context);
}

}  // namespace

MotionOfScene FindMovingObjects(const MotionInput& input,
                                const MotionOptions& options,
                                const Context& context) {
  const FramePairIndex matches_index(input.scene, input.matches,
                                     SequenceMode::kYes);
  RigPath path;
  auto motion = FindByDepths(input, matches_index, options, context, &path);
  if (!motion) {
    const FrameDepths depths = RotationsOfSensors(input);
    motion = FindByPairs(
        {input, matches_index, depths, options.verification.max_error_px,
         options.filtering.max_relative_baseline_error},
        options.min_parallax_deg, context, &path);
  }
  if (IsRuleOn(RejectionReason::kAmbiguousMotion, options.filtering)) {
    RejectAmbiguous(input.index, path, &*motion);
  }
  return *std::move(motion);
}

}  // namespace mgsfm
