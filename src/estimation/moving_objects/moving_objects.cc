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
using FramePair = FramePairIndex::FramePair;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// An excess of one contradicting match may be a mismatch.
constexpr int kMinBalance = 2;
// Minimum number of matches of a pair whose pose the path predicts; other pairs
// need more. docs/results/constants.md compares 5 to 15 on weak drives.
constexpr int kMinNumPredicted = 8;
// A smaller fraction of contradicting matches does not bias a relative pose.
constexpr double kMaxContradicting = 0.1;

// Whether a frame of the pair is next to a doubtful step.
bool IsDoubtful(const MotionProblem& problem, const RigPath& path,
                size_t pair_idx) {
  const FramePair& frames = problem.index.Of(pair_idx);
  return path.is_doubtful[frames.frame_idx1] ||
         path.is_doubtful[frames.frame_idx2];
}

// Per pair of frames, the motion from frame 1 to frame 2; nullopt unless the
// path measures it.
using PlacedPairs = std::vector<std::optional<MeasuredMotion>>;

// Motions are refined next to objects. Where no match measures a motion between
// the frames, their pairs have no expected pose.
PlacedPairs PlaceFrames(const MotionProblem& problem, const RigPath& path,
                        const Context& context) {
  const std::vector<FramePair>& frame_pairs = problem.index.frame_pairs();
  PlacedPairs placed(frame_pairs.size());
  ParallelFor(placed.size(), context.num_threads, [&](size_t i) {
    const FramePair& frames = frame_pairs[i];
    if (!frames.IsBetweenFrames() || !problem.index.AreNeighbors(frames) ||
        !path.IsComparable(frames.frame_idx1, frames.frame_idx2)) {
      return;
    }
    int earlier = frames.frame_idx1, later = frames.frame_idx2;
    const bool is_reversed = problem.index.order()->IsBefore(later, earlier);
    if (is_reversed) std::swap(earlier, later);
    std::optional<MeasuredMotion> refined;
    if (path.is_doubtful[earlier] || path.is_doubtful[later]) {
      refined = RefineMotion(problem, path, earlier, later);
    }
    if (!refined && path.group[earlier] != path.group[later]) return;
    const MeasuredMotion motion =
        refined ? *refined : path.MeasuredBetween(earlier, later);
    placed[i] = is_reversed ? motion.Inverse() : motion;
  });
  return placed;
}

// Predicts only pairs of sensors with known poses in the rig.
std::vector<ExpectedPair> ExpectPairs(const MotionProblem& problem,
                                      const RigPath& path,
                                      const Context& context) {
  const PlacedPairs placed = PlaceFrames(problem, path, context);
  std::vector<ExpectedPair> expected;
  for (size_t f = 0; f < placed.size(); ++f) {
    if (!placed[f]) continue;
    const FramePair& frames = problem.index.frame_pairs()[f];
    for (const size_t i : frames.pair_idxs) {
      const auto pair = ExpectPair(problem, i, frames.frame_idx1, *placed[f]);
      if (pair) expected.push_back(*pair);
    }
  }
  SortBy(&expected, [](const auto& a) { return a.pair_idx; });
  return expected;
}

// The pair of the same images with all matches.
const ImagePair& SourceOf(const MotionProblem& problem, const ImagePair& pair) {
  return *FindPair(problem.matches, pair.image_idx1, pair.image_idx2);
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

  bool Contains(int image_idx, uint32_t keypoint_idx) const {
    const std::vector<int>& balance = balance_[image_idx];
    return !balance.empty() && balance[keypoint_idx] >= kMinBalance;
  }
  bool IsStatic(int image_idx, uint32_t keypoint_idx) const {
    const std::vector<int>& balance = balance_[image_idx];
    return !balance.empty() && balance[keypoint_idx] <= -kMinBalance;
  }

 private:
  void Count(const MotionProblem& problem, const ExpectedPair& expected) {
    const ImagePair& pair = problem.view_graph.pairs[expected.pair_idx];
    const double tolerance_rad = ToleranceOf(problem, expected);
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      balance_[image_idx].resize(
          problem.scene.images[image_idx].keypoints_px.size(), 0);
    }
    const auto count = [&](const Match& match, MatchVerdict counted,
                           int change) {
      if (CompareWithMotion(problem.bearings, problem.depths, pair, match,
                            expected.cam2_from_cam1,
                            tolerance_rad) != counted) {
        return;
      }
      balance_[pair.image_idx1][match.keypoint_idx1] += change;
      balance_[pair.image_idx2][match.keypoint_idx2] += change;
    };
    const ImagePair& source = SourceOf(problem, pair);
    for (const Match& match : source.matches) {
      count(match, MatchVerdict::kAgrees, -1);
      count(match, MatchVerdict::kContradicts, 1);
    }
    for (const Match& match : source.outliers) {
      count(match, MatchVerdict::kAgrees, -1);
    }
  }

  std::vector<std::vector<int>> balance_;
};

// The matches of a pair, verified or not, that agree with the path.
std::vector<Match> AgreeingMatches(const MotionProblem& problem,
                                   const MovingKeypoints& moving,
                                   const ExpectedPair& expected,
                                   const ImagePair& pair) {
  const double tolerance_rad = ToleranceOf(problem, expected);
  std::vector<Match> agreeing;
  for (const auto* matches : {&pair.matches, &pair.outliers}) {
    for (const Match& match : *matches) {
      if (!moving.Contains(pair.image_idx1, match.keypoint_idx1) &&
          !moving.Contains(pair.image_idx2, match.keypoint_idx2) &&
          CompareWithMotion(problem.bearings, problem.depths, pair, match,
                            expected.cam2_from_cam1,
                            tolerance_rad) != MatchVerdict::kContradicts) {
        agreeing.push_back(match);
      }
    }
  }
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
    if (IsDoubtful(problem, path, e.pair_idx)) near.push_back(e);
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

// Whether most matches of a pair whose depth is known agree with a motion.
bool MostDepthsAgree(const MotionProblem& problem,
                     const ExpectedPair& expected) {
  const ImagePair& pair = problem.view_graph.pairs[expected.pair_idx];
  const double tolerance_rad = ToleranceOf(problem, expected);
  size_t num_agreeing = 0, num_contradicting = 0;
  for (const Match& match : pair.matches) {
    switch (CompareWithMotion(problem.bearings, problem.depths, pair, match,
                              expected.cam2_from_cam1, tolerance_rad)) {
      case MatchVerdict::kAgrees:
        ++num_agreeing;
        break;
      case MatchVerdict::kContradicts:
        ++num_contradicting;
        break;
      case MatchVerdict::kIsOnEpipolarLine:
        break;
    }
  }
  return num_agreeing > num_contradicting;
}

bool AgreesInPoseAndDepths(const MotionProblem& problem, const RigPath& path,
                           const ExpectedPair& expected) {
  return AgreesWithPath(problem, path,
                        problem.view_graph.pairs[expected.pair_idx],
                        expected) &&
         MostDepthsAgree(problem, expected);
}

// Pairs that agree with the path by their poses, and by most of their matches
// with depth, are not discontinuous.
void KeepAgreeing(const MotionProblem& problem, const RigPath& path,
                  const std::vector<ExpectedPair>& expected,
                  Mask* pair_is_discontinuous) {
  for (const ExpectedPair& e : expected) {
    if ((*pair_is_discontinuous)[e.pair_idx] &&
        AgreesInPoseAndDepths(problem, path, e)) {
      (*pair_is_discontinuous)[e.pair_idx] = false;
    }
  }
}

// Whether a pair of neighbors agrees with the path, which may be interpolated
// between its frames.
bool FollowsPath(const MotionProblem& problem, const RigPath& path,
                 size_t pair_idx) {
  const FramePair& frames = problem.index.Of(pair_idx);
  const int a = frames.frame_idx1, b = frames.frame_idx2;
  if (!problem.index.AreNeighbors(frames) || !path.IsComparable(a, b)) {
    return false;
  }
  const auto expected = ExpectPair(problem, pair_idx, a,
                                   problem.index.order()->IsBefore(b, a)
                                       ? path.MeasuredBetween(b, a).Inverse()
                                       : path.MeasuredBetween(a, b));
  return expected && AgreesInPoseAndDepths(problem, path, *expected);
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
    if (is_expected[i] || !problem.index.Of(i).IsBetweenFrames() ||
        !IsDoubtful(problem, path, i)) {
      continue;
    }
    const ImagePair& pair = problem.view_graph.pairs[i];
    int num_moving = 0, num_static = 0;
    for (const Match& match : pair.matches) {
      const bool moves =
          moving.Contains(pair.image_idx1, match.keypoint_idx1) ||
          moving.Contains(pair.image_idx2, match.keypoint_idx2);
      const bool rests =
          moving.IsStatic(pair.image_idx1, match.keypoint_idx1) ||
          moving.IsStatic(pair.image_idx2, match.keypoint_idx2);
      num_moving += moves && !rests ? 1 : 0;
      num_static += rests && !moves ? 1 : 0;
    }
    if (num_moving > num_static && !FollowsPath(problem, path, i)) {
      (*pair_is_discontinuous)[i] = true;
    }
  }
}

// Whether the path determines the length of the baseline: its standard
// deviation is within the tolerance of motions that agree.
bool HasLength(const ExpectedPair& expected) {
  const Vector3d& baseline = expected.cam2_from_cam1.translation;
  return std::sqrt(std::max(
             0.0, VarianceAlong(expected.covariance.bottomRightCorner<3, 3>(),
                                baseline))) <=
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
    if (IsDoubtful(problem, path, e.pair_idx) && HasLength(e)) {
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
  of_prediction.min_num_inliers =
      std::min(*verification.min_num_inliers, kMinNumPredicted);
  // The second round starts from the poses of the first.
  for (int round = 0; round < 2; ++round) {
    judged = VerifyPairs(problem, path, judged, of_prediction, context,
                         &motion.pair_of_scene);
  }
  for (const ExpectedPair& e : judged) is_discontinuous[e.pair_idx] = false;
  KeepAgreeing(problem, path, expected, &is_discontinuous);
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
        length && IsDoubtful(problem, path, e.pair_idx) &&
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
  for (size_t i = 0; i < depths.distances.size(); ++i) {
    const double error_rad = ErrorRad(scene, static_cast<int>(i), max_error_px);
    for (const auto& distance : depths.distances[i]) {
      if (distance) displacements.push_back(error_rad * *distance);
    }
  }
  return displacements.empty() ? 0.0 : Median(std::move(displacements));
}

// Requires problem.noise_displacement.
RigPath FindPathByDepths(const MotionProblem& problem, const Context& context) {
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
  return FindRigPath(*problem.index.order(), problem.index.num_frames(),
                     evidence, context.num_threads);
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
  *path = FindPathByDepths(problem, context);
  if (path->noise.depths_contradict_pairs) return std::nullopt;
  return JudgeByMatches(problem, RefinePath(problem, *path),
                        options.verification, context);
}

// Rotations of the sensors, without lever arms and depths.
FrameDepths RotationsOfSensors(const MotionInput& input) {
  FrameDepths depths;
  depths.distances.resize(input.scene.images.size());
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
