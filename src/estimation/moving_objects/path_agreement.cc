// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/path_agreement.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "geometry/so3.h"
#include "moving_objects/motion_candidates.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// Maximum baseline error, relative to the length, of pairs that support a
// motion by their own poses. Half and twice the value change errors by at most
// 2 %.
constexpr double kMaxSupportError = 0.1;
// 95 % of the errors of a pair along a direction are smaller, in standard
// deviations.
constexpr double kNumSigmasOfMatch = 1.96;
// If more steps are ambiguous, the motions are wrong rather than ambiguous, for
// example with a mirrored camera. At most 4.5 % of steps are ambiguous on 132
// moderate and hard drives.
constexpr double kMaxAmbiguous = 0.1;

// Shorter displacements are noise.
double MinDisplacement(const MotionProblem& problem, const RigPath& path) {
  return std::max(kRelativeTolerance * path.noise.median_step,
                  problem.noise_displacement);
}

// The number of matches in pairs whose own poses agree with a motion between
// two frames.
size_t SupportByPairs(const MotionProblem& problem, const RigPath& path,
                      int earlier, int later,
                      const Rigid3& later_from_earlier) {
  const FramePair* frames = problem.index.Find(earlier, later);
  if (frames == nullptr) return 0;
  const Rigid3 motion = frames->frame_idx1 == earlier
                            ? later_from_earlier
                            : later_from_earlier.Inverse();
  // Pairs support a motion only if they are close to it.
  MotionProblem strict = problem;
  strict.max_relative_baseline_error = kMaxSupportError;
  size_t num_matches = 0;
  for (const size_t i : frames->pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const auto cam2_from_cam1 =
        RelativePoseBy(problem, pair, frames->frame_idx1, motion);
    if (cam2_from_cam1 &&
        AgreesWithPath(strict, path, pair, {i, *cam2_from_cam1})) {
      num_matches += pair.matches.size();
    }
  }
  return num_matches;
}

}  // namespace

double ToleranceOf(const MotionProblem& problem, const ExpectedPair& expected) {
  const ImagePair& pair = problem.view_graph.pairs[expected.pair_idx];
  const double keypoint_rad = ToleranceOf(problem, pair);
  const double of_rotation =
      expected.covariance.topLeftCorner<3, 3>().trace() / 3.0;
  const double of_center =
      expected.covariance.bottomRightCorner<3, 3>().trace() / 3.0;
  const double per_length = problem.noise_displacement > 0.0
                                ? keypoint_rad / problem.noise_displacement
                                : 0.0;
  return keypoint_rad +
         kNumSigmasOfMatch *
             std::sqrt(of_rotation + per_length * per_length * of_center);
}

std::optional<ExpectedPair> ExpectPair(const MotionProblem& problem,
                                       size_t pair_idx, int frame_idx1,
                                       const MeasuredMotion& rig2_from_rig1) {
  const ImagePair& pair = problem.view_graph.pairs[pair_idx];
  const auto cam2_from_cam1 = RelativePoseBy(problem, pair, frame_idx1,
                                             rig2_from_rig1.later_from_earlier);
  if (!cam2_from_cam1) return std::nullopt;
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const MeasuredMotion motion = image1.frame_idx == frame_idx1
                                    ? rig2_from_rig1
                                    : rig2_from_rig1.Inverse();
  const Matrix3d from_rig2 = problem.depths.cam_from_rig[image2.sensor_idx]
                                 ->rotation.toRotationMatrix();
  const Matrix3d from_rig1 =
      from_rig2 * motion.later_from_earlier.rotation.toRotationMatrix();
  ExpectedPair expected{pair_idx, *cam2_from_cam1};
  expected.covariance.topLeftCorner<3, 3>() =
      from_rig2 * motion.rotation_covariance * from_rig2.transpose();
  expected.covariance.bottomRightCorner<3, 3>() =
      from_rig1 * motion.center_covariance * from_rig1.transpose();
  return expected;
}

bool AgreesWithPath(const MotionProblem& problem, const RigPath& path,
                    const ImagePair& pair, const ExpectedPair& expected,
                    const std::optional<BaselineLength>& length) {
  const RelativePose& pose = *pair.relative_pose;
  const Vector3d turn_error = LogSO3(
      pose.cam2_from_cam1 * expected.cam2_from_cam1.rotation.conjugate());
  // Two measurements differ by the noise of the recording, too.
  const double max_turn_error = kMaxAngle_rad + 2.0 * path.noise.rotation_rad;
  const double min_error = MinDisplacement(problem, path);
  const Vector3d& translation = expected.cam2_from_cam1.translation;
  const Vector3d direction =
      pose.translation_direction.value_or(Vector3d::Zero());
  const double measured = length ? length->value : translation.norm();
  const Vector3d error = measured * direction - translation;
  const bool has_direction =
      length || (pose.translation_direction && translation.norm() >= min_error);
  const double max_error =
      std::max(min_error, problem.max_relative_baseline_error *
                              std::max(measured, translation.norm()));
  const auto is_within = [&](const PoseMatrix& covariance) {
    return turn_error.norm() <=
               max_turn_error + kNumSigmasOfMatch *
                                    SigmaAlong(covariance.topLeftCorner<3, 3>(),
                                               turn_error) &&
           (!has_direction ||
            error.norm() <=
                max_error + kNumSigmasOfMatch *
                                SigmaAlong(covariance.bottomRightCorner<3, 3>(),
                                           error));
  };
  if (is_within(PoseMatrix::Zero())) return true;
  PoseMatrix covariance = expected.covariance;
  if (pose.translation_direction) {
    PoseMatrix of_pair = CovarianceOf(problem, pair);
    of_pair.bottomRightCorner<3, 3>() *= measured * measured;
    covariance += of_pair;
  }
  if (length) {
    covariance.bottomRightCorner<3, 3>() +=
        length->sigma * length->sigma * Matrix3d::Identity();
  }
  return is_within(covariance);
}

std::optional<MeasuredMotion> RefineMotion(const MotionProblem& problem,
                                           const RigPath& path, int earlier,
                                           int later) {
  const Rigid3 expected = path.Between(earlier, later);
  auto refined = RefineByDepths(problem, earlier, later, expected);
  if (!refined ||
      !AreEqualMotions({refined->later_from_earlier}, {expected}, path.noise) ||
      SupportByPairs(problem, path, earlier, later,
                     refined->later_from_earlier) <
          SupportByPairs(problem, path, earlier, later, expected)) {
    return std::nullopt;
  }
  return refined;
}

RigPath RefinePath(const MotionProblem& problem, const RigPath& path) {
  RigPath refined = path;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      const int a = sequence[k], b = sequence[k + 1];
      if (!path.IsComparable(a, b)) continue;
      std::optional<MeasuredMotion> step;
      if (path.is_interpolated[b] ||
          (!path.is_in_long_motion[b] &&
           (path.is_doubtful[a] || path.is_doubtful[b]))) {
        step = RefineMotion(problem, path, a, b);
      }
      if (step && refined.group[a] != refined.group[b]) {
        std::replace(refined.group.begin(), refined.group.end(),
                     int{refined.group[b]}, int{refined.group[a]});
      }
      RigPath::Place place = *refined.of_frame[a];
      place.Move(step ? *step : path.MeasuredBetween(a, b));
      refined.of_frame[b] = place;
    }
  }
  return refined;
}

AmbiguousSteps FindAmbiguousSteps(const FramePairIndex& index,
                                  const RigPath& path) {
  AmbiguousSteps none{Mask(index.num_pairs(), false),
                      Mask(index.num_frames(), false)};
  AmbiguousSteps steps = none;
  int num_steps = 0, num_ambiguous = 0;
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      ++num_steps;
      if (!path.IsAmbiguousBetween(sequence[k], sequence[k + 1])) continue;
      ++num_ambiguous;
      steps.frame_is_beside[sequence[k]] = true;
      steps.frame_is_beside[sequence[k + 1]] = true;
    }
  }
  if (num_ambiguous > kMaxAmbiguous * num_steps) return none;
  for (size_t i = 0; i < index.num_pairs(); ++i) {
    const FramePair& frames = index.Of(i);
    steps.pair_is_across[i] =
        index.AreNeighbors(frames) &&
        path.IsAmbiguousBetween(frames.frame_idx1, frames.frame_idx2);
  }
  return steps;
}

}  // namespace mgsfm
