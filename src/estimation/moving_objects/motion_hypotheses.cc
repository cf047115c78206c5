// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_hypotheses.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/epipolar.h"
#include "math/robust_scale.h"
#include "mgsfm/geometry/camera_models.h"
#include "moving_objects/motion_candidates.h"

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

// The motions of all steps that correspondences with depth support.
SequenceHypotheses FindHypothesesByDepth(const MotionProblem& problem,
                                         const Context& context) {
  SequenceHypotheses hypotheses;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    std::vector<StepHypotheses> steps(std::max<size_t>(sequence.size(), 1) - 1);
    ParallelFor(steps.size(), context.num_threads, [&](size_t k) {
      const FramePair* frames =
          problem.matches_index.Find(sequence[k], sequence[k + 1]);
      if (frames == nullptr) return;
      for (const RigMotion& motion :
           FindRigMotions(problem.MatchesOf(sequence[k], *frames),
                          kDepthErrorFactor * problem.max_error_px,
                          Random(context.random_seed,
                                 static_cast<uint64_t>(sequence[k])))) {
        steps[k].push_back({motion.measured.later_from_earlier,
                            motion.share,
                            motion.own_share,
                            {},
                            motion.reach,
                            motion.measured.rotation_covariance,
                            motion.measured.center_covariance});
      }
    });
    hypotheses.push_back(std::move(steps));
  }
  return hypotheses;
}

// Sets the covariances of a motion by the relative pose of two images. Lever
// arms are short against the distance to the scene: the error of the rotation
// does not move the center by them.
void SetCovariances(const MotionProblem& problem, const ImagePair& pair,
                    const Rigid3& sensor_from_rig, bool is_reversed,
                    MotionHypothesis* hypothesis) {
  const std::optional<Vector3d>& direction =
      pair.relative_pose->translation_direction;
  if (!direction) {
    // Shorter motions would not show.
    hypothesis->center_covariance = problem.noise_displacement *
                                    problem.noise_displacement *
                                    Matrix3d::Identity();
    return;
  }
  const MeasuredMotion of_pair =
      MeasuredMotionOf({pair.relative_pose->cam2_from_cam1, *direction},
                       CovarianceOf(problem, pair), is_reversed);
  const Matrix3d rig_from_sensor =
      sensor_from_rig.rotation.conjugate().toRotationMatrix();
  hypothesis->rotation_covariance = rig_from_sensor *
                                    of_pair.rotation_covariance *
                                    rig_from_sensor.transpose();
  hypothesis->center_covariance =
      rig_from_sensor * of_pair.center_covariance * rig_from_sensor.transpose();
}

// The motion of the rig by the relative pose of two images of one sensor, from
// the earlier to the later frame. If its length does not differ from zero
// significantly, its direction has no meaning.
MotionHypothesis RigMotionOf(const MotionProblem& problem,
                             const Rigid3& sensor_from_rig,
                             const ImagePair& pair,
                             const std::optional<BaselineLength>& length,
                             PairDistance distance) {
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const bool is_reversed =
      problem.index.order()->IsBefore(image2.frame_idx, image1.frame_idx);
  const auto motion_of = [&](const Vector3d& translation) {
    const Rigid3 motion =
        sensor_from_rig.Inverse() *
        Rigid3{pair.relative_pose->cam2_from_cam1, translation} *
        sensor_from_rig;
    return is_reversed ? motion.Inverse() : motion;
  };
  const Vector3d direction =
      pair.relative_pose->translation_direction.value_or(Vector3d::Zero());
  MotionHypothesis hypothesis;
  const bool is_free = distance == PairDistance::kFree;
  hypothesis.later_from_earlier =
      motion_of((is_free ? 0.0 : length->value) * direction);
  const Vector3d rig_direction =
      motion_of(direction).Center() - motion_of(Vector3d::Zero()).Center();
  SetCovariances(problem, pair, sensor_from_rig, is_reversed, &hypothesis);
  if (is_free) hypothesis.free_direction = rig_direction;
  if (!pair.relative_pose->translation_direction || !length) return hypothesis;
  const Matrix3d of_length =
      length->sigma * length->sigma * Matrix3d::Identity();
  if (!is_free) {
    hypothesis.center_covariance =
        length->value * length->value * hypothesis.center_covariance +
        of_length;
  }
  return hypothesis;
}

// The motions of one step by its pairs of equal sensors.
StepHypotheses MotionsOfPairs(
    const MotionProblem& problem,
    const std::vector<std::optional<Rigid3>>& sensors,
    const std::vector<std::optional<BaselineLength>>& lengths,
    PairDistance distance, const FramePair& frames) {
  StepHypotheses step;
  double num_matches = 0.0;
  for (const size_t i : frames.pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const int sensor_idx = problem.scene.images[pair.image_idx1].sensor_idx;
    if (!pair.relative_pose || !sensors[sensor_idx] ||
        (distance == PairDistance::kMeasured && !lengths[i]) ||
        sensor_idx != problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    step.push_back(
        RigMotionOf(problem, *sensors[sensor_idx], pair, lengths[i], distance));
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
std::vector<std::optional<BaselineLength>> MeasureLengths(
    const MotionProblem& problem, const Context& context) {
  const std::vector<ImagePair>& pairs = problem.view_graph.pairs;
  std::vector<std::optional<BaselineLength>> lengths(pairs.size());
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
  std::vector<MotionExclusion> exclusions;
  for (const MotionHypothesis& h : *by_depth) exclusions.push_back(compare(h));
  const auto is_excluded = [](const MotionExclusion& exclusion) {
    return exclusion.share >= kContestingShare;
  };
  if (std::any_of(exclusions.begin(), exclusions.end(), is_excluded) ||
      std::any_of(of_pairs.begin(), of_pairs.end(),
                  [&](const auto& h) { return is_excluded(compare(h)); })) {
    return;
  }
  for (size_t i = 0; i < by_depth->size(); ++i) {
    MotionHypothesis& motion = (*by_depth)[i];
    if (AreEqualMotions(
            {motion.later_from_earlier, motion.rotation_covariance,
             motion.center_covariance},
            {strongest.later_from_earlier, strongest.rotation_covariance,
             strongest.center_covariance},
            {}) ||
        exclusions[i].balance < 0) {
      continue;
    }
    motion.later_from_earlier = strongest.later_from_earlier;
    motion.rotation_covariance = strongest.rotation_covariance;
    motion.center_covariance = strongest.center_covariance;
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
  double tolerance_rad = 0.0;
  for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
    const Camera& camera =
        problem.scene.cameras[problem.scene.images[image_idx].camera_idx];
    tolerance_rad += 0.5 * problem.max_error_px /
                     PixelsPerRadian(camera.model, camera.params.data());
  }
  return tolerance_rad;
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
  RayMatches rays;
  for (const Match& match : pair.matches) {
    const auto keypoint1 = static_cast<int>(match.keypoint_idx1);
    const auto keypoint2 = static_cast<int>(match.keypoint_idx2);
    if (!problem.bearings.HasRay(pair.image_idx1, keypoint1) ||
        !problem.bearings.HasRay(pair.image_idx2, keypoint2)) {
      continue;
    }
    rays.Add(problem.bearings.Ray(pair.image_idx1, keypoint1),
             problem.bearings.Ray(pair.image_idx2, keypoint2));
  }
  PoseRefinementOptions options;
  options.loss_scale_rad =
      rays.size() == 0 ? 1.0
                       : std::max(RobustSigma<1>(SampsonAngles(rays, pose)),
                                  std::numeric_limits<double>::epsilon());
  return RelativePoseCovariance(rays, options, pose);
}

SequenceHypotheses FindHypothesesByPairs(
    const MotionProblem& problem,
    const std::vector<std::optional<Rigid3>>& sensor_from_rig,
    const std::vector<std::optional<BaselineLength>>& lengths,
    PairDistance distance) {
  SequenceHypotheses hypotheses;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    hypotheses.emplace_back(std::max<size_t>(sequence.size(), 1) - 1);
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      const FramePair* frames =
          problem.index.Find(sequence[k], sequence[k + 1]);
      if (frames == nullptr) continue;
      hypotheses.back()[k] =
          MotionsOfPairs(problem, sensor_from_rig, lengths, distance, *frames);
    }
  }
  return hypotheses;
}

SequenceHypotheses FindHypothesesWithDepths(const MotionProblem& problem,
                                            const Context& context) {
  SequenceHypotheses hypotheses = FindHypothesesByDepth(problem, context);
  const auto& sensors = problem.depths.cam_from_rig;
  const auto lengths = MeasureLengths(problem, context);
  const SequenceHypotheses with_lengths =
      FindHypothesesByPairs(problem, sensors, lengths, PairDistance::kMeasured);
  const SequenceHypotheses of_pairs =
      FindHypothesesByPairs(problem, sensors, lengths, PairDistance::kFree);
  const auto& sequences = problem.index.order()->sequences();
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    ParallelFor(hypotheses[s].size(), context.num_threads, [&](size_t k) {
      StepHypotheses& step = hypotheses[s][k];
      ReplaceByPairs(problem, sequences[s][k], sequences[s][k + 1],
                     with_lengths[s][k], &step);
      step.insert(step.end(), of_pairs[s][k].begin(), of_pairs[s][k].end());
    });
  }
  return hypotheses;
}

}  // namespace mgsfm
