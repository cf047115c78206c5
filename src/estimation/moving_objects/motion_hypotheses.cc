// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_hypotheses.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/random.h"
#include "geometry/epipolar.h"
#include "moving_objects/motion_candidates.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The matches that agree with either of two motions.
struct AgreementCounts {
  size_t num_both = 0, num_only1 = 0, num_only2 = 0;

  void Add(bool agrees1, bool agrees2) {
    num_both += agrees1 && agrees2 ? 1 : 0;
    num_only1 += agrees1 && !agrees2 ? 1 : 0;
    num_only2 += agrees2 && !agrees1 ? 1 : 0;
  }
  static double Share(size_t num_only, size_t num_all) {
    return num_only < kMinNumAgreeing
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

using LengthOfPair =
    std::function<std::optional<BaselineLength>(size_t pair_idx)>;

// The motions between two frames by their pairs of equal sensors. Without
// `length_of`, their distances are free; with it, pairs of unknown length are
// left out.
StepHypotheses MotionsOfPairs(const MotionProblem& problem,
                              const FramePair& frames,
                              const LengthOfPair& length_of = {}) {
  StepHypotheses step;
  double num_matches = 0.0;
  for (const size_t i : frames.pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const int sensor_idx = problem.scene.images[pair.image_idx1].sensor_idx;
    if (!pair.relative_pose || !problem.depths.cam_from_rig[sensor_idx] ||
        sensor_idx != problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    const auto length = length_of ? length_of(i) : std::nullopt;
    if (length_of && !length) continue;
    step.push_back(RigMotionOf(problem, pair, length));
    step.back().share = static_cast<double>(pair.matches.size());
    num_matches += step.back().share;
  }
  for (MotionHypothesis& hypothesis : step) {
    hypothesis.share /= num_matches;
    hypothesis.own_share = hypothesis.share;
  }
  return step;
}

// Correspondences with depth are few and lie in the overlap of two cameras,
// where a motion looks like a turn, and noise of depths favors the turn. If no
// two motions exclude each other by their matches, the one by the most matches
// of image pairs replaces those of correspondences with depth that differ and
// that do not explain more matches.
void ReplaceByPairs(const MotionProblem& problem, int earlier_frame_idx,
                    int later_frame_idx, const StepHypotheses& of_pairs,
                    StepHypotheses* by_depth) {
  if (of_pairs.empty()) return;
  const MotionHypothesis& strongest = *std::max_element(
      of_pairs.begin(), of_pairs.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
  const auto compare = [&](const MotionHypothesis& a,
                           const MotionHypothesis& b) {
    return ExclusionOf(problem, earlier_frame_idx, later_frame_idx,
                       a.later_from_earlier, b.later_from_earlier);
  };
  StepHypotheses all = *by_depth;
  all.insert(all.end(), of_pairs.begin(), of_pairs.end());
  for (size_t i = 0; i < all.size(); ++i) {
    for (size_t k = 0; k < i; ++k) {
      if (compare(all[i], all[k]).share >= kContestingShare) return;
    }
  }
  for (MotionHypothesis& motion : *by_depth) {
    if (compare(motion, strongest).balance >= 0 &&
        !AreEqualMotions(motion, strongest, {})) {
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
    if (!IsOfOneSensor(problem.scene, pair)) continue;
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
    for (const auto* matches : {&pair.matches, &pair.outliers}) {
      for (const Match& match : *matches) {
        const bool has_depth =
            problem.depths.Find(pair.image_idx1, match.keypoint_idx1) ||
            problem.depths.Find(pair.image_idx2, match.keypoint_idx2);
        (has_depth ? with_depth : without_depth)
            .Add(agrees(match, *pose1), agrees(match, *pose2));
      }
    }
  }
  return {std::max(with_depth.Exclusion(), without_depth.Exclusion()),
          std::max(with_depth.Unexplained(), without_depth.Unexplained()),
          with_depth.Balance() + without_depth.Balance()};
}

PoseMatrix CovarianceOf(const MotionProblem& problem, const ImagePair& pair) {
  const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                    *pair.relative_pose->translation_direction};
  const RayMatches rays = RaysOf(problem.bearings, pair);
  PoseRefinementOptions options;
  options.loss_scale_rad = rays.size() == 0 ? 1.0 : ResidualSigma(rays, pose);
  return RelativePoseCovariance(rays, options, pose);
}

StepHypotheses FindHypothesesByPairs(const MotionProblem& problem,
                                     const BaselineLengths& lengths,
                                     int earlier_frame_idx,
                                     int later_frame_idx) {
  const FramePair* frames =
      problem.index.Find(earlier_frame_idx, later_frame_idx);
  return frames == nullptr ? StepHypotheses()
                           : MotionsOfPairs(problem, *frames, [&](size_t i) {
                               return lengths[i];
                             });
}

std::optional<MeasuredMotion> RefineByDepths(const MotionProblem& problem,
                                             int earlier_frame_idx,
                                             int later_frame_idx,
                                             const Rigid3& later_from_earlier) {
  const FramePair* frames =
      problem.matches_index.Find(earlier_frame_idx, later_frame_idx);
  if (frames == nullptr) return std::nullopt;
  return RefineRigMotion(problem.MatchesOf(earlier_frame_idx, *frames),
                         kDepthErrorFactor * problem.max_error_px,
                         later_from_earlier);
}

StepHypotheses FindHypothesesByDepths(const MotionProblem& problem,
                                      uint64_t random_seed,
                                      int earlier_frame_idx,
                                      int later_frame_idx) {
  StepHypotheses step;
  if (const FramePair* frames =
          problem.matches_index.Find(earlier_frame_idx, later_frame_idx)) {
    step = FindRigMotions(
        problem.MatchesOf(earlier_frame_idx, *frames),
        kDepthErrorFactor * problem.max_error_px,
        Random(random_seed, static_cast<uint64_t>(earlier_frame_idx)));
  }
  const FramePair* frames =
      problem.index.Find(earlier_frame_idx, later_frame_idx);
  if (frames == nullptr) return step;
  const auto length_by_depths = [&](size_t i) -> std::optional<BaselineLength> {
    const ImagePair& pair = problem.view_graph.pairs[i];
    if (!pair.relative_pose->translation_direction) return std::nullopt;
    return MeasureBaselineLength(problem.scene, problem.bearings, pair,
                                 kKeypointNoise * problem.max_error_px,
                                 problem.depths);
  };
  const StepHypotheses of_pairs =
      MotionsOfPairs(problem, *frames, length_by_depths);
  ReplaceByPairs(problem, earlier_frame_idx, later_frame_idx, of_pairs, &step);
  const StepHypotheses free = MotionsOfPairs(problem, *frames);
  step.insert(step.end(), free.begin(), free.end());
  return step;
}

}  // namespace mgsfm
