// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/long_motions.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ChosenMotions = std::vector<std::optional<ChosenMotion>>;

// MEASURE
constexpr size_t kMaxNumSteps = 3;

// The motion of the chosen steps in [begin, end).
Rigid3 MotionOfSteps(const ChosenMotions& chosen, const Steps& steps,
                     size_t begin, size_t end) {
  Rigid3 motion;
  for (size_t k = begin; k < end; ++k) {
    motion =
        MotionOf(chosen[k]->velocity, steps.durations[k]).later_from_earlier *
        motion;
  }
  return motion;
}

// A hypothesis for the steps of a longer one, without the motions before and
// after them. A free distance is at least that of the closest point to the
// origin, from where its error has the same variance for a step of length
// `typical_step`.
MotionHypothesis WithoutEnds(const MotionHypothesis& hypothesis,
                             const Rigid3& before, const Rigid3& after,
                             double typical_step) {
  MotionHypothesis inner = hypothesis;
  const Matrix3d from_earlier = before.rotation.toRotationMatrix();
  const Matrix3d from_later = after.rotation.conjugate().toRotationMatrix();
  inner.later_from_earlier =
      after.Inverse() * hypothesis.later_from_earlier * before.Inverse();
  inner.rotation_covariance =
      from_later * hypothesis.rotation_covariance * from_later.transpose();
  inner.center_covariance =
      from_earlier * hypothesis.center_covariance * from_earlier.transpose();
  if (!hypothesis.free_direction) return inner;
  const Vector3d direction = from_earlier * *hypothesis.free_direction;
  const Vector3d center = inner.later_from_earlier.Center();
  const double shift = std::max(0.0, -direction.dot(center));
  inner.free_direction = direction;
  inner.later_from_earlier = Rigid3::FromRotationAndCenter(
      inner.later_from_earlier.rotation, center + shift * direction);
  const double factor = 1.0 + shift / typical_step;
  inner.center_covariance *= factor * factor;
  return inner;
}

// The hypotheses between two frames that compete with a motion.
std::vector<MeasuredMotion> FindRivals(const MotionEvidence& evidence,
                                       int earlier_frame_idx,
                                       int later_frame_idx,
                                       const Rigid3& motion,
                                       const MotionNoise& noise) {
  std::vector<MeasuredMotion> rivals;
  for (const Candidate& candidate : GroupHypotheses(
           evidence.find(earlier_frame_idx, later_frame_idx), noise)) {
    const MeasuredMotion other = candidate.ClosestTo(motion.Center());
    if (IsOtherMotion(candidate, {motion}, noise) &&
        evidence.compare(earlier_frame_idx, later_frame_idx, motion,
                         other.later_from_earlier)
                .share >= kContestingShare) {
      rivals.push_back(other);
    }
  }
  return rivals;
}

// A motion between two frames, and those that compete with it.
struct Contest {
  std::optional<MeasuredMotion> motion;
  std::vector<MeasuredMotion> rivals;

  // Whether the motion and a rival are those of the next frames, too. An error
  // does not recur.
  bool Recurs(const Contest& next, const MotionNoise& noise) const {
    return motion && next.motion &&
           AreEqualMotions(*motion, *next.motion, noise) &&
           AnyOf(rivals, [&](const MeasuredMotion& a) {
             return AnyOf(next.rivals, [&](const MeasuredMotion& b) {
               return AreEqualMotions(a, b, noise);
             });
           });
  }
};

}  // namespace

Mask FindLongRivals(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence, const Steps& steps,
                    const ChosenMotions& chosen, int num_threads) {
  Mask is_within(steps.size(), false);
  if (!evidence.compare) return is_within;
  for (size_t num_steps = 2; num_steps <= std::min(kMaxNumSteps, steps.size());
       ++num_steps) {
    std::vector<Contest> contests(steps.size() + 1 - num_steps);
    ParallelFor(contests.size(), num_threads, [&](size_t k) {
      const auto begin = chosen.begin() + static_cast<std::ptrdiff_t>(k);
      if (!std::all_of(begin, begin + static_cast<std::ptrdiff_t>(num_steps),
                       [](const auto& motion) {
                         return motion && motion->HasDistance();
                       })) {
        return;
      }
      contests[k].motion = {MotionOfSteps(chosen, steps, k, k + num_steps)};
      contests[k].rivals =
          FindRivals(evidence, frame_idxs[k], frame_idxs[k + num_steps],
                     contests[k].motion->later_from_earlier, steps.noise);
    });
    for (size_t k = 0; k + num_steps < contests.size(); ++k) {
      if (contests[k].Recurs(contests[k + num_steps], steps.noise)) {
        is_within.Fill(k, k + 2 * num_steps, true);
      }
    }
  }
  return is_within;
}

bool AddLongMotions(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence, const ChosenMotions& chosen,
                    const Mask& is_doubtful, Steps* steps) {
  bool are_added = false;
  for (size_t begin = 0; begin < chosen.size(); ++begin) {
    std::optional<size_t> first_unknown, last_unknown;
    const size_t end = std::min(chosen.size(), begin + kMaxNumSkipped + 1);
    for (size_t k = begin; k < end && (chosen[k] || is_doubtful[k]); ++k) {
      if (!chosen[k]) {
        first_unknown = first_unknown.value_or(k);
        last_unknown = k;
      }
      if (!first_unknown || k == begin) continue;
      StepHypotheses hypotheses =
          evidence.find(frame_idxs[begin], frame_idxs[k + 1]);
      const Rigid3 before =
          MotionOfSteps(chosen, *steps, begin, *first_unknown);
      const Rigid3 after =
          MotionOfSteps(chosen, *steps, *last_unknown + 1, k + 1);
      for (MotionHypothesis& hypothesis : hypotheses) {
        hypothesis =
            WithoutEnds(hypothesis, before, after, steps->noise.median_step);
      }
      AddLongStep(hypotheses, *last_unknown, *last_unknown + 1 - *first_unknown,
                  steps);
      are_added |= !hypotheses.empty();
    }
  }
  return are_added;
}

}  // namespace mgsfm
