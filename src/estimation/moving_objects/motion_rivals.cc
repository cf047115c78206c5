// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_rivals.h"

#include <algorithm>
#include <vector>

#include "base/ranges.h"

namespace mgsfm {
namespace {

// A competing motion continues in an adjacent step within 95 % of the changes
// (docs/results/constants.md).
constexpr double kMaxSquaredChange = 6.0;

// The motion with the largest share, of at least one.
const Candidate& Strongest(const std::vector<Candidate>& candidates) {
  return *std::max_element(
      candidates.begin(), candidates.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
}

// A free distance may be that of any motion of the step with a distance, unless
// the matches contradict it: matches with parallax exclude that an image pair
// shows an object at a constant distance. The motion from correspondences with
// depth may be better than that from image pairs.
std::vector<Rigid3> PossibleMotions(const Steps& steps, size_t k,
                                    const Candidate& candidate) {
  std::vector<Rigid3> motions{steps.MotionOf(k, candidate).later_from_earlier};
  if (candidate.by_depth) {
    motions.push_back(candidate.by_depth->later_from_earlier);
  }
  if (!candidate.free_direction) return motions;
  for (const Candidate& other : steps.candidates[k]) {
    if (other.free_direction) continue;
    const Rigid3 motion = candidate.ClosestTo(other.later_from_earlier.Center())
                              .later_from_earlier;
    if (steps.compare(k, motions[0], motion).unexplained < kContestingShare) {
      motions.push_back(motion);
    }
  }
  return motions;
}

// Whether the matches of a step exclude that two candidates are the same
// motion.
bool ExcludeEachOther(const Steps& steps, size_t k, const Candidate& a,
                      const Candidate& b) {
  if (!steps.compare) return true;
  for (const Rigid3& motion_a : PossibleMotions(steps, k, a)) {
    for (const Rigid3& motion_b : PossibleMotions(steps, k, b)) {
      if (steps.compare(k, motion_a, motion_b).share < kContestingShare) {
        return false;
      }
    }
  }
  return true;
}

// Whether a candidate has support and is another motion than the strongest one.
bool IsRival(const Steps& steps, size_t k, const Candidate& candidate,
             const Candidate& strongest) {
  const MeasuredMotion motion = steps.MotionOf(k, strongest);
  return candidate.own_share >= kContestingShare &&
         !AreEqualMotions(
             candidate.ClosestTo(motion.later_from_earlier.Center()), motion,
             steps.noise) &&
         ExcludeEachOther(steps, k, candidate, strongest);
}

// Whether a competing motion continues in an adjacent step, since objects
// persist and errors do not. It must compete there, too, or explain the motion
// there significantly better than the strongest motion.
bool Continues(const Steps& steps, const Velocity& rival,
               const Velocity& strongest, size_t neighbor) {
  if (!steps.HasCandidates(neighbor)) return false;
  const std::vector<Candidate>& candidates = steps.candidates[neighbor];
  const auto change = [&](const Velocity& from, const Candidate& to) {
    return SquaredChange(from, steps.VelocityAfter(from.linear, neighbor, to),
                         steps.noise);
  };
  return AnyOf(candidates, [&](const Candidate& candidate) {
    const double of_rival = change(rival, candidate);
    return of_rival <= kMaxSquaredChange &&
           (change(strongest, candidate) > of_rival + kMaxSquaredChange ||
            IsRival(steps, neighbor, candidate, Strongest(candidates)));
  });
}

// Whether matches of an adjacent step show a competing motion that continues.
// They refine it: the few points of an object leave a turn and a shift open.
bool IsShown(const Steps& steps, const Velocity& rival, size_t neighbor) {
  if (!steps.refine || !steps.HasCandidates(neighbor)) return false;
  const double duration = steps.durations[neighbor];
  const auto motion =
      steps.refine(neighbor, MotionOf(rival, duration).later_from_earlier);
  if (!motion || SquaredChange(rival, VelocityOf(*motion, duration),
                               steps.noise) > kMaxSquaredChange) {
    return false;
  }
  const Candidate& strongest = Strongest(steps.candidates[neighbor]);
  return !AreEqualMotions(
             strongest.ClosestTo(motion->later_from_earlier.Center()), *motion,
             steps.noise) &&
         IsRival(steps, neighbor, {MotionHypothesis{*motion}}, strongest);
}

}  // namespace

bool HasRivals(const Steps& steps, size_t k) {
  const std::vector<Candidate>& step = steps.candidates[k];
  if (step.empty()) return false;
  const Candidate& strongest = Strongest(step);
  const MeasuredMotion motion = steps.MotionOf(k, strongest);
  const Velocity velocity = VelocityOf(motion, steps.durations[k]);
  return AnyOf(step, [&](const Candidate& candidate) {
    const Velocity rival =
        VelocityOf(candidate.ClosestTo(motion.later_from_earlier.Center()),
                   steps.durations[k]);
    return IsRival(steps, k, candidate, strongest) &&
           (Continues(steps, rival, velocity, k - 1) ||
            Continues(steps, rival, velocity, k + 1) ||
            IsShown(steps, rival, k - 1) || IsShown(steps, rival, k + 1));
  });
}

}  // namespace mgsfm
