// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_hypotheses.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "math/robust_scale.h"
#include "moving_objects/motion_candidates.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using FramePair = FramePairIndex::FramePair;

// Fewer matches are no evidence of a motion of their own: three determine it,
// and each of the others agrees by chance with a probability of about 1e-3.
constexpr size_t kMinNumExclusive = 8;

// The matches that agree with either of two motions.
struct AgreementCounts {
  size_t num_both = 0, num_only1 = 0, num_only2 = 0;

  void Add(bool agrees1, bool agrees2) {
    num_both += agrees1 && agrees2 ? 1 : 0;
    num_only1 += agrees1 && !agrees2 ? 1 : 0;
    num_only2 += agrees2 && !agrees1 ? 1 : 0;
  }
  static double Share(size_t num_only, size_t num_all) {
    return num_only < kMinNumExclusive
               ? 0.0
               : static_cast<double>(num_only) / static_cast<double>(num_all);
  }
  // The smaller share of either, and the share of the first motion.
  double Exclusion() const {
    return Share(std::min(num_only1, num_only2),
                 num_both + num_only1 + num_only2);
  }
  double Unexplained() const { return Share(num_only1, num_both + num_only1); }
  std::ptrdiff_t Balance() const {
    return static_cast<std::ptrdiff_t>(num_only2) -
           static_cast<std::ptrdiff_t>(num_only1);
  }
};

// The hypotheses of all steps by a function of two frames.
template <typename Function>
SequenceHypotheses ForEachStep(const MotionProblem& problem, int num_threads,
                               const Function& find) {
  SequenceHypotheses hypotheses;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    hypotheses.emplace_back(std::max<size_t>(sequence.size(), 1) - 1);
    ParallelFor(hypotheses.back().size(), num_threads, [&](size_t k) {
      hypotheses.back()[k] = find(sequence[k], sequence[k + 1]);
    });
  }
  return hypotheses;
}

// The motion of the rig by the relative pose of two images of one sensor, from
// the earlier to the later frame. Without a length, its distance is free. Lever
// arms are short against the distance to the scene: the error of the rotation
// does not move the center by them.
MotionHypothesis RigMotionOf(const MotionProblem& problem,
                             const ImagePair& pair,
                             const std::optional<BaselineLength>& length) {
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const Rigid3& sensor_from_rig =
      *problem.depths.cam_from_rig[image1.sensor_idx];
  const bool is_reversed =
      problem.index.order()->IsBefore(image2.frame_idx, image1.frame_idx);
  const auto& pair_direction = pair.relative_pose->translation_direction;
  const Vector3d direction = pair_direction.value_or(Vector3d::Zero());
  const auto motion_of = [&](const Vector3d& translation) {
    const Rigid3 motion =
        sensor_from_rig.Inverse() *
        Rigid3{pair.relative_pose->cam2_from_cam1, translation} *
        sensor_from_rig;
    return is_reversed ? motion.Inverse() : motion;
  };
  MotionHypothesis hypothesis;
  hypothesis.later_from_earlier =
      motion_of((length ? length->value : 0.0) * direction);
  if (!length) {
    hypothesis.free_direction =
        motion_of(direction).Center() - motion_of(Vector3d::Zero()).Center();
  }
  Matrix3d& center_covariance = hypothesis.center_covariance;
  if (!pair_direction) {
    // Shorter motions would not show.
    center_covariance = problem.noise_displacement *
                        problem.noise_displacement * Matrix3d::Identity();
    return hypothesis;
  }
  const MeasuredMotion of_pair =
      MeasuredMotionOf({pair.relative_pose->cam2_from_cam1, direction},
                       CovarianceOf(problem, pair), is_reversed);
  const Matrix3d rig_from_sensor =
      sensor_from_rig.rotation.conjugate().toRotationMatrix();
  hypothesis.rotation_covariance = rig_from_sensor *
                                   of_pair.rotation_covariance *
                                   rig_from_sensor.transpose();
  center_covariance =
      rig_from_sensor * of_pair.center_covariance * rig_from_sensor.transpose();
  if (length) {
    center_covariance = (length->value * length->value * center_covariance +
                         length->sigma * length->sigma * Matrix3d::Identity())
                            .eval();
  }
  return hypothesis;
}

// The motions of one step by its pairs of equal sensors. Without `lengths`,
// their distances are free; with them, pairs of unknown length are left out.
StepHypotheses MotionsOfPairs(const MotionProblem& problem,
                              const BaselineLengths* lengths,
                              const FramePair& frames) {
  StepHypotheses step;
  double num_matches = 0.0;
  for (const size_t i : frames.pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const int sensor_idx = problem.scene.images[pair.image_idx1].sensor_idx;
    if (!pair.relative_pose || !problem.depths.cam_from_rig[sensor_idx] ||
        (lengths && !(*lengths)[i]) ||
        sensor_idx != problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    step.push_back(
        RigMotionOf(problem, pair, lengths ? (*lengths)[i] : std::nullopt));
    step.back().share = static_cast<double>(pair.matches.size());
    num_matches += step.back().share;
  }
  for (MotionHypothesis& hypothesis : step) {
    hypothesis.share /= num_matches;
    hypothesis.own_share = hypothesis.share;
  }
  return step;
}

// Per pair: the length of its baseline by the depths of its keypoints, for
// images of one sensor in consecutive frames.
BaselineLengths MeasureLengths(const MotionProblem& problem,
                               const Context& context) {
  const std::vector<ImagePair>& pairs = problem.view_graph.pairs;
  BaselineLengths lengths(pairs.size());
  ParallelFor(pairs.size(), context.num_threads, [&](size_t i) {
    const ImagePair& pair = pairs[i];
    if (problem.index.Of(i).time_gap != 1 || !pair.relative_pose ||
        !pair.relative_pose->translation_direction ||
        problem.scene.images[pair.image_idx1].sensor_idx !=
            problem.scene.images[pair.image_idx2].sensor_idx) {
      return;
    }
    lengths[i] = MeasureBaselineLength(problem.scene, problem.bearings, pair,
                                       kKeypointNoise * problem.max_error_px,
                                       problem.depths);
  });
  return lengths;
}

// Correspondences with depth are few and lie in the overlap of two cameras,
// where a motion looks like a turn, and noise of depths favors the turn. If
// the matches exclude no motion of a step, the one by the most matches of image
// pairs replaces those of correspondences with depth that differ and that do
// not explain more matches.
void ReplaceByPairs(const MotionProblem& problem, int earlier_frame_idx,
                    int later_frame_idx, const StepHypotheses& of_pairs,
                    StepHypotheses* by_depth) {
  if (of_pairs.empty()) return;
  const MotionHypothesis& strongest = *std::max_element(
      of_pairs.begin(), of_pairs.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
  const auto compare = [&](const MotionHypothesis& h) {
    return ExclusionOf(problem, earlier_frame_idx, later_frame_idx,
                       h.later_from_earlier, strongest.later_from_earlier);
  };
  const std::vector<MotionExclusion> exclusions =
      Transformed(*by_depth, compare);
  const auto is_excluded = [](const MotionExclusion& exclusion) {
    return exclusion.share >= kContestingShare;
  };
  if (AnyOf(exclusions, is_excluded) ||
      AnyOf(of_pairs, [&](const auto& h) { return is_excluded(compare(h)); })) {
    return;
  }
  for (size_t i = 0; i < by_depth->size(); ++i) {
    MotionHypothesis& motion = (*by_depth)[i];
    if (exclusions[i].balance >= 0 && !AreEqualMotions(motion, strongest, {})) {
      static_cast<MeasuredMotion&>(motion) = strongest;
    }
  }
}

}  // namespace

std::optional<Rigid3> RelativePoseBy(const MotionProblem& problem,
                                     const ImagePair& pair,
                                     int earlier_frame_idx,
                                     const Rigid3& later_from_earlier) {
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const auto& cam1_from_rig = problem.depths.cam_from_rig[image1.sensor_idx];
  const auto& cam2_from_rig = problem.depths.cam_from_rig[image2.sensor_idx];
  if (!cam1_from_rig || !cam2_from_rig) return std::nullopt;
  return *cam2_from_rig *
         (image1.frame_idx == earlier_frame_idx
              ? later_from_earlier
              : later_from_earlier.Inverse()) *
         cam1_from_rig->Inverse();
}

double ToleranceOf(const MotionProblem& problem, const ImagePair& pair) {
  return ErrorRad(problem.scene, pair.image_idx1, 0.5 * problem.max_error_px) +
         ErrorRad(problem.scene, pair.image_idx2, 0.5 * problem.max_error_px);
}

MotionExclusion ExclusionOf(const MotionProblem& problem, int earlier_frame_idx,
                            int later_frame_idx, const Rigid3& motion1,
                            const Rigid3& motion2) {
  const FramePair* frames =
      problem.matches_index.Find(earlier_frame_idx, later_frame_idx);
  if (frames == nullptr) return {};
  AgreementCounts with_depth, without_depth;
  for (const size_t i : frames->pair_idxs) {
    const ImagePair& pair = problem.matches.pairs[i];
    if (problem.scene.images[pair.image_idx1].sensor_idx !=
        problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    const auto pose1 =
        RelativePoseBy(problem, pair, earlier_frame_idx, motion1);
    const auto pose2 =
        RelativePoseBy(problem, pair, earlier_frame_idx, motion2);
    if (!pose1 || !pose2) continue;
    const double tolerance_rad = ToleranceOf(problem, pair);
    const auto agrees = [&](const Match& match, const Rigid3& pose) {
      return CompareWithMotion(problem.bearings, problem.depths, pair, match,
                               pose,
                               tolerance_rad) != MatchVerdict::kContradicts;
    };
    for (const Match& match : pair.matches) {
      const bool has_depth =
          problem.depths.IsKnown(pair.image_idx1,
                                 static_cast<int>(match.keypoint_idx1)) ||
          problem.depths.IsKnown(pair.image_idx2,
                                 static_cast<int>(match.keypoint_idx2));
      (has_depth ? with_depth : without_depth)
          .Add(agrees(match, *pose1), agrees(match, *pose2));
    }
  }
  return {std::max(with_depth.Exclusion(), without_depth.Exclusion()),
          std::max(with_depth.Unexplained(), without_depth.Unexplained()),
          with_depth.Balance() + without_depth.Balance()};
}

Eigen::Matrix<double, 6, 6> CovarianceOf(const MotionProblem& problem,
                                         const ImagePair& pair) {
  const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                    *pair.relative_pose->translation_direction};
  const RayMatches rays = RaysOf(problem.bearings, pair);
  PoseRefinementOptions options;
  options.loss_scale_rad =
      rays.size() == 0 ? 1.0
                       : std::max(RobustSigma<1>(SampsonAngles(rays, pose)),
                                  std::numeric_limits<double>::epsilon());
  return RelativePoseCovariance(rays, options, pose);
}

SequenceHypotheses FindHypothesesByPairs(const MotionProblem& problem,
                                         const BaselineLengths& lengths,
                                         const Context& context) {
  return ForEachStep(problem, context.num_threads, [&](int earlier, int later) {
    const FramePair* frames = problem.index.Find(earlier, later);
    return frames == nullptr ? StepHypotheses()
                             : MotionsOfPairs(problem, &lengths, *frames);
  });
}

SequenceHypotheses FindHypothesesByDepths(const MotionProblem& problem,
                                          const Context& context) {
  const BaselineLengths lengths = MeasureLengths(problem, context);
  return ForEachStep(problem, context.num_threads, [&](int earlier, int later) {
    StepHypotheses step;
    if (const FramePair* frames = problem.matches_index.Find(earlier, later)) {
      step = FindRigMotions(
          problem.MatchesOf(earlier, *frames),
          kDepthErrorFactor * problem.max_error_px,
          Random(context.random_seed, static_cast<uint64_t>(earlier)));
    }
    const FramePair* frames = problem.index.Find(earlier, later);
    if (frames == nullptr) return step;
    ReplaceByPairs(problem, earlier, later,
                   MotionsOfPairs(problem, &lengths, *frames), &step);
    const StepHypotheses free = MotionsOfPairs(problem, nullptr, *frames);
    step.insert(step.end(), free.begin(), free.end());
    return step;
  });
}

}  // namespace mgsfm
