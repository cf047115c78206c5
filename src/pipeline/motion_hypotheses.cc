// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/motion_hypotheses.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "base/parallel.h"
#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using FramePair = FramePairIndex::FramePair;

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
        steps[k].push_back({motion.later_from_earlier,
                            motion.share,
                            motion.own_share,
                            {},
                            motion.reach});
      }
    });
    hypotheses.push_back(std::move(steps));
  }
  return hypotheses;
}

// The motion of the rig by the relative pose of two images of one sensor, from
// the earlier to the later frame. Without a length, the distance is free.
MotionHypothesis RigMotionOf(const MotionProblem& problem,
                             const Rigid3& sensor_from_rig,
                             const ImagePair& pair,
                             const std::optional<double>& length) {
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
  hypothesis.later_from_earlier = motion_of(length.value_or(0.0) * direction);
  if (!length) {
    hypothesis.free_direction =
        motion_of(direction).Center() - hypothesis.later_from_earlier.Center();
  }
  return hypothesis;
}

// The motions of one step by its pairs of equal sensors. Without `lengths`,
// their distances are free.
StepHypotheses MotionsOfPairs(const MotionProblem& problem,
                              const std::vector<std::optional<Rigid3>>& sensors,
                              const std::vector<std::optional<double>>& lengths,
                              const FramePair& frames) {
  StepHypotheses step;
  double num_matches = 0.0;
  for (const size_t i : frames.pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const int sensor_idx = problem.scene.images[pair.image_idx1].sensor_idx;
    if (!pair.relative_pose || !sensors[sensor_idx] ||
        (!lengths.empty() && !lengths[i]) ||
        sensor_idx != problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    step.push_back(RigMotionOf(problem, *sensors[sensor_idx], pair,
                               lengths.empty() ? std::nullopt : lengths[i]));
    step.back().share = static_cast<double>(pair.matches.size());
    num_matches += step.back().share;
  }
  for (MotionHypothesis& hypothesis : step) {
    hypothesis.share /= num_matches;
    hypothesis.own_share = hypothesis.share;
  }
  return step;
}

}  // namespace

SequenceHypotheses FindHypothesesByPairs(
    const MotionProblem& problem,
    const std::vector<std::optional<Rigid3>>& sensor_from_rig,
    const std::vector<std::optional<double>>& lengths) {
  SequenceHypotheses hypotheses;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    hypotheses.emplace_back(std::max<size_t>(sequence.size(), 1) - 1);
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      const FramePair* frames =
          problem.index.Find(sequence[k], sequence[k + 1]);
      if (frames == nullptr) continue;
      hypotheses.back()[k] =
          MotionsOfPairs(problem, sensor_from_rig, lengths, *frames);
    }
  }
  return hypotheses;
}

SequenceHypotheses FindHypothesesWithDepths(const MotionProblem& problem,
                                            const Context& context) {
  SequenceHypotheses hypotheses = FindHypothesesByDepth(problem, context);
  const SequenceHypotheses of_pairs =
      FindHypothesesByPairs(problem, problem.depths.cam_from_rig, {});
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    for (size_t k = 0; k < hypotheses[s].size(); ++k) {
      hypotheses[s][k].insert(hypotheses[s][k].end(), of_pairs[s][k].begin(),
                              of_pairs[s][k].end());
    }
  }
  return hypotheses;
}

}  // namespace mgsfm
