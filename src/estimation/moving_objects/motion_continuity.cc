// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "moving_objects/motion_candidates.h"
#include "moving_objects/motion_rivals.h"
#include "moving_objects/motion_search.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A range of steps, and the chosen motions before and after the steps in it
// that have none.
struct Gap {
  size_t first = 0, last = 0;  // unknown steps
  MeasuredMotion before, after;
  // The durations of the whole range and of the steps from first to last.
  double duration = 0.0, inner_duration = 0.0;

  MeasuredMotion Inner(const MeasuredMotion& whole) const {
    return Compose(after.Inverse(), Compose(whole, before.Inverse()));
  }

  // A free distance is at least that of the point closest to the origin. The
  // variance of the direction is that of the whole, longer motion.
  MotionHypothesis Inner(const MotionHypothesis& whole) const {
    MotionHypothesis inner = whole;
    static_cast<MeasuredMotion&>(inner) =
        Inner(static_cast<const MeasuredMotion&>(whole));
    if (!whole.free_direction) return inner;
    const Eigen::Quaterniond& from_earlier = before.later_from_earlier.rotation;
    const Vector3d direction = from_earlier * *whole.free_direction;
    const Vector3d center = inner.later_from_earlier.Center();
    inner.free_direction = direction;
    inner.later_from_earlier = Rigid3::FromRotationAndCenter(
        inner.later_from_earlier.rotation,
        center + std::max(0.0, -direction.dot(center)) * direction);
    const double factor = duration / inner_duration;
    const Matrix3d turn = from_earlier.toRotationMatrix();
    inner.center_covariance =
        factor * factor * turn * whole.center_covariance * turn.transpose();
    return inner;
  }
};

// The composition of chosen motions. nullopt if a distance is unknown.
std::optional<MeasuredMotion> MotionOfSteps(const ChosenMotions& chosen,
                                            const Steps& steps, size_t begin,
                                            size_t end) {
  MeasuredMotion motion;
  for (size_t k = begin; k < end; ++k) {
    if (!chosen[k] || !chosen[k]->HasDistance()) return std::nullopt;
    motion = Compose(MotionOf(chosen[k]->velocity, steps.durations[k]), motion);
  }
  return motion;
}

// The unknown steps among those in [begin, end). nullopt if there are none, or
// if a distance of the others is unknown.
std::optional<Gap> FindGap(const ChosenMotions& chosen, const Steps& steps,
                           size_t begin, size_t end) {
  Gap gap;
  gap.first = begin;
  gap.last = end;
  while (gap.first < end && chosen[gap.first]) ++gap.first;
  if (gap.first == end) return std::nullopt;
  while (chosen[--gap.last]) {
  }
  const auto before = MotionOfSteps(chosen, steps, begin, gap.first);
  const auto after = MotionOfSteps(chosen, steps, gap.last + 1, end);
  if (!before || !after) return std::nullopt;
  gap.before = *before;
  gap.after = *after;
  gap.duration = steps.Duration(end - 1, end - begin);
  gap.inner_duration = steps.Duration(gap.last, gap.last + 1 - gap.first);
  return gap;
}

// For how many steps vehicles may hide the scene. Of two drives, the reach of
// the sequence instead fails on one, and 30 instead of 7 mends the other.
constexpr size_t kMaxNumHidden = 7;

// If a vehicle fills the views of consecutive frames, their matches measure
// only the motion relative to the vehicle. Frames further apart may show the
// scene, as one of them sees past the vehicle.
//
// Adds candidates for steps without a choice: the hypotheses between frames at
// most kMaxNumHidden + 1 steps apart, without the chosen motions of the steps
// before the first unknown step and after the last one, whose distances must be
// known. Returns whether there are any.
//
// Cost: that of the hypotheses, for each pair of frames around an unknown step.
bool AddLongMotions(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence, const ChosenMotions& chosen,
                    const Mask& is_doubtful, Steps* steps) {
  bool are_added = false;
  for (size_t begin = 0; begin < chosen.size(); ++begin) {
    const size_t last = std::min(chosen.size(), begin + kMaxNumHidden + 1) - 1;
    for (size_t k = begin; k <= last && (chosen[k] || is_doubtful[k]); ++k) {
      const auto gap = FindGap(chosen, *steps, begin, k + 1);
      if (!gap || k == begin) continue;
      for (Candidate& candidate :
           GroupHypotheses(evidence.find(frame_idxs[begin], frame_idxs[k + 1]),
                           steps->noise)) {
        static_cast<MotionHypothesis&>(candidate) =
            gap->Inner(static_cast<const MotionHypothesis&>(candidate));
        for (MeasuredMotion& motion : candidate.measured) {
          motion = gap->Inner(motion);
        }
        if (candidate.by_depth) {
          candidate.by_depth = gap->Inner(*candidate.by_depth);
        }
        candidate.num_steps = gap->last + 1 - gap->first;
        steps->candidates[gap->last].push_back(std::move(candidate));
        are_added = true;
      }
    }
  }
  return are_added;
}

// A rig with the velocity v and the angular velocity w moves by
// sum_i d_i Exp(-w t_i) v in steps of durations d_i that begin at times t_i.
// Gives each step within a chosen motion over several steps the velocity of a
// uniform motion that leads to the end, and its part of the variance.
void DivideLongMotions(const std::vector<double>& durations,
                       ChosenMotions* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    if (!(*chosen)[k] || (*chosen)[k]->is_inside) continue;
    const size_t num_steps = (*chosen)[k]->candidate.num_steps;
    if (num_steps == 1) continue;
    Velocity velocity = (*chosen)[k]->velocity;
    Matrix3d center_by_velocity = Matrix3d::Zero();
    double duration = 0.0;
    for (size_t i = k + 1 - num_steps; i <= k; ++i) {
      center_by_velocity +=
          durations[i] *
          ExpSO3(-duration * velocity.angular_rad).toRotationMatrix();
      duration += durations[i];
    }
    velocity.linear =
        center_by_velocity.inverse() * (duration * velocity.linear);
    for (size_t i = k + 1 - num_steps; i <= k; ++i) {
      Velocity& of_step = (*chosen)[i]->velocity;
      of_step = velocity;
      of_step.linear_covariance *= duration / durations[i];
      of_step.angular_covariance *= duration / durations[i];
    }
  }
}

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// A step is ambiguous if the odds of another motion exceed 1 in 20.
constexpr double kMinMargin = 3.0;
// Pairs of neighbors bridge fewer steps. 28 of 450 groups of ambiguous steps
// on 200 drives were larger.
constexpr size_t kMinNumAmbiguous = 3;
// Maximum number of steps between ambiguous steps of a group.
constexpr size_t kMaxNumBetween = 2;

MotionNoise Larger(const MotionNoise& a, const MotionNoise& b) {
  return {std::max(a.median_step, b.median_step),
          std::max(a.rotation_rad, b.rotation_rad),
          std::max(a.relative_center, b.relative_center),
          a.depths_contradict_pairs || b.depths_contradict_pairs,
          std::max(a.turn_change_rad, b.turn_change_rad),
          std::max(a.linear_change, b.linear_change)};
}

// The steps near those whose hypotheses disagree.
Mask FindDoubtful(const Mask& has_rivals) {
  Mask is_doubtful(has_rivals.size(), false);
  for (size_t k = 0; k < has_rivals.size(); ++k) {
    if (!has_rivals[k]) continue;
    is_doubtful.Fill(k - std::min(k, kMaxNumHidden),
                     std::min(has_rivals.size(), k + kMaxNumHidden + 1), true);
  }
  return is_doubtful;
}

// The groups of steps whose motion is ambiguous.
Mask FindAmbiguous(const std::vector<double>& margins,
                   const Mask& is_doubtful) {
  Mask is_ambiguous(margins.size(), false);
  std::vector<size_t> group;
  const auto finish = [&] {
    if (group.size() >= kMinNumAmbiguous) {
      is_ambiguous.Fill(group.front(), group.back() + 1, true);
    }
    group.clear();
  };
  for (size_t k = 0; k < margins.size(); ++k) {
    if (!is_doubtful[k] || margins[k] >= kMinMargin) continue;
    if (!group.empty() && k - group.back() > kMaxNumBetween + 1) finish();
    group.push_back(k);
  }
  finish();
  return is_ambiguous;
}

// Restores motions by depth whose rotation and direction were replaced by those
// of image pairs for the search, because pairs next to vehicles are biased.
// Depths that determine the motion less than the tolerance of agreement do not
// show a bias.
void RestoreMotionsByDepth(const Steps& steps, ChosenMotions* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    auto& motion = (*chosen)[k];
    if (!motion || motion->is_inside || !motion->candidate.by_depth ||
        !IsCertain(*motion->candidate.by_depth, steps.noise)) {
      continue;
    }
    motion->velocity =
        VelocityOf(*motion->candidate.by_depth,
                   steps.Duration(k, motion->candidate.num_steps));
    for (size_t i = 1; i < motion->candidate.num_steps; ++i) {
      (*chosen)[k - i]->velocity = motion->velocity;
    }
  }
}

// Interpolates the distances that the chosen hypotheses lack. Errors grow with
// the number of steps to a known distance.
void InterpolateDistances(const Steps& steps, ChosenMotions* chosen) {
  std::vector<size_t> known;  // steps with a distance
  for (size_t k = 0; k < chosen->size(); ++k) {
    if ((*chosen)[k] && (*chosen)[k]->HasDistance()) known.push_back(k);
  }
  if (known.empty()) return;
  for (size_t k = 0; k < chosen->size(); ++k) {
    auto& motion = (*chosen)[k];
    if (!motion || motion->is_inside || motion->HasDistance()) continue;
    const auto next = std::lower_bound(known.begin(), known.end(), k);
    const size_t after = next == known.end() ? known.back() : *next;
    const size_t before = next == known.begin() ? after : *(next - 1);
    const Velocity& first = (*chosen)[before]->velocity;
    const Velocity& last = (*chosen)[after]->velocity;
    const auto steps_from = [k](size_t other) {
      return std::abs(static_cast<double>(k) - static_cast<double>(other));
    };
    const double weight =
        before < after
            ? steps_from(before) / static_cast<double>(after - before)
            : 0.0;
    const Vector3d linear =
        (1.0 - weight) * first.linear + weight * last.linear;
    const double duration = steps.Duration(k, motion->candidate.num_steps);
    const double change = TypicalChange(first, last, steps.noise).linear;
    motion->velocity =
        VelocityOf(motion->candidate.ClosestTo(duration * linear), duration);
    motion->velocity.linear_covariance +=
        std::min(steps_from(before), steps_from(after)) * change * change *
        Matrix3d::Identity();
  }
}

// The covariances of motions do not include errors that all steps share, such
// as a wrong calibration. The disagreement of their measurements reveals these.
void AddDisagreement(const Steps& steps, ChosenMotions* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    if (!(*chosen)[k]) continue;
    Velocity& velocity = (*chosen)[k]->velocity;
    const double turn = steps.noise.rotation_rad / steps.durations[k];
    const double change = steps.noise.relative_center * velocity.linear.norm();
    velocity.angular_covariance += turn * turn * Matrix3d::Identity();
    velocity.linear_covariance += change * change * Matrix3d::Identity();
  }
}

// The velocity between two steps, as far from both as it may change.
Velocity Mean(const Velocity& a, const Velocity& b, const MotionNoise& noise) {
  const VelocityChange change = TypicalChange(a, b, noise);
  return {0.5 * (a.linear + b.linear), 0.5 * (a.angular_rad + b.angular_rad),
          change.linear * change.linear * Matrix3d::Identity() +
              0.25 * (a.linear_covariance + b.linear_covariance),
          change.angular_rad * change.angular_rad * Matrix3d::Identity() +
              0.25 * (a.angular_covariance + b.angular_covariance)};
}

// Places all frames of one sequence. A step is unknown if it is ambiguous, or
// if it has no hypothesis and there is no sign that the true one was outvoted.
// Steps before the first hypothesis and after the last one are not ambiguous:
// no motions on both sides of them contradict the pairs.
std::vector<RigPath::Place> FollowMotion(const ChosenMotions& chosen,
                                         const Steps& steps,
                                         const Mask& is_doubtful,
                                         const Mask& is_ambiguous,
                                         int first_stretch) {
  const std::vector<double>& durations = steps.durations;
  std::vector<RigPath::Place> places{{first_stretch}};
  std::optional<size_t> previous;
  const auto are_few = [&](size_t begin, size_t end) {
    const double duration = std::accumulate(durations.begin() + begin,
                                            durations.begin() + end, 0.0);
    return end - begin <= kMaxNumHidden &&
           std::round(duration) <= static_cast<double>(kMaxNumHidden);
  };
  for (size_t k = 0; k < chosen.size(); ++k) {
    RigPath::Place next = places.back();
    size_t following = k;
    while (following < chosen.size() && !chosen[following]) ++following;
    std::optional<Velocity> velocity;
    if (chosen[k]) {
      velocity = chosen[k]->velocity;
      previous = k;
    } else if (is_doubtful[k] && following < chosen.size() && previous &&
               are_few(*previous + 1, following)) {
      velocity = Mean(chosen[*previous]->velocity, chosen[following]->velocity,
                      steps.noise);
    }
    if (velocity && !is_ambiguous[k]) {
      next.Move(MotionOf(*velocity, durations[k]));
    } else {
      ++next.stretch;
      const bool is_enclosed = previous && following < chosen.size();
      if (is_ambiguous[k] || (is_doubtful[k] && is_enclosed)) {
        ++next.num_ambiguous;
      }
    }
    places.push_back(next);
  }
  return places;
}

// The steps of a sequence with their hypotheses.
Steps MeasureSteps(const TemporalOrder& order, const std::vector<int>& sequence,
                   const MotionEvidence& evidence, int num_threads) {
  std::vector<StepHypotheses> hypotheses(sequence.size() - 1);
  ParallelFor(hypotheses.size(), num_threads, [&](size_t k) {
    hypotheses[k] = evidence.find(sequence[k], sequence[k + 1]);
  });
  std::vector<double> durations;
  for (size_t k = 0; k < hypotheses.size(); ++k) {
    durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
  }
  Steps steps = MakeSteps(hypotheses, std::move(durations));
  if (evidence.compare) {
    steps.compare = [&](size_t k, const Rigid3& a, const Rigid3& b) {
      return evidence.compare(sequence[k], sequence[k + 1], a, b);
    };
  }
  if (evidence.refine) {
    steps.refine = [&](size_t k, const Rigid3& motion) {
      return evidence.refine(sequence[k], sequence[k + 1], motion);
    };
  }
  return steps;
}

// The choice of motions, and where it is in doubt.
struct Decision {
  MotionChoice choice;
  Mask is_doubtful;  // per step
};

// Chooses among the hypotheses of single steps, then fills gaps by motions over
// several steps.
Decision Decide(const std::vector<int>& sequence,
                const MotionEvidence& evidence, Steps* steps) {
  Mask has_rivals(steps->size(), false);
  for (size_t k = 0; k < steps->size(); ++k) {
    has_rivals[k] = HasRivals(*steps, k);
  }
  Decision decision;
  decision.is_doubtful = FindDoubtful(has_rivals);
  const auto choose = [&] {
    for (size_t k = 0; k < steps->size(); ++k) {
      if (decision.is_doubtful[k]) {
        steps->candidates[k] = TryDistances(*steps, k);
      }
    }
    decision.choice = ChooseMotions(*steps, decision.is_doubtful);
  };
  choose();
  if (AddLongMotions(sequence, evidence, decision.choice.motions,
                     decision.is_doubtful, steps)) {
    choose();
  }
  return decision;
}

// The groups of frames of a sequence between which motions are chosen, from
// `first_group` on.
std::vector<int> GroupFrames(const ChosenMotions& chosen, int first_group) {
  std::vector<int> groups{first_group};
  for (const auto& motion : chosen) {
    if (motion && !motion->is_inside) {
      groups.push_back(groups[groups.size() - motion->candidate.num_steps]);
    } else {
      groups.push_back(++first_group);
    }
  }
  return groups;
}

// Adds the places of one sequence. Returns the number of the next segment.
int FollowSequence(const TemporalOrder& order, const std::vector<int>& sequence,
                   const MotionEvidence& evidence, int num_threads,
                   int first_stretch, RigPath* path) {
  Steps steps = MeasureSteps(order, sequence, evidence, num_threads);
  path->noise = Larger(path->noise, steps.noise);
  Decision decision = Decide(sequence, evidence, &steps);
  ChosenMotions& chosen = decision.choice.motions;
  RestoreMotionsByDepth(steps, &chosen);
  InterpolateDistances(steps, &chosen);
  DivideLongMotions(steps.durations, &chosen);
  AddDisagreement(steps, &chosen);
  const auto places =
      FollowMotion(chosen, steps, decision.is_doubtful,
                   FindAmbiguous(decision.choice.margins, decision.is_doubtful),
                   first_stretch);
  const std::vector<int> groups = GroupFrames(
      chosen, *std::max_element(path->group.begin(), path->group.end()) + 1);
  for (size_t k = 0; k < sequence.size(); ++k) {
    path->of_frame[sequence[k]] = places[k];
    path->group[sequence[k]] = groups[k];
    if (k == 0) continue;
    const auto& step = chosen[k - 1];
    path->is_interpolated[sequence[k]] = !step || !step->HasDistance();
    path->is_in_long_motion[sequence[k]] =
        step && step->candidate.num_steps > 1;
    if (!decision.is_doubtful[k - 1]) continue;
    path->is_doubtful[sequence[k - 1]] = true;
    path->is_doubtful[sequence[k]] = true;
  }
  return places.back().stretch + 1;
}

}  // namespace

void RigPath::Place::Move(const MeasuredMotion& step) {
  const Matrix3d earlier = rig_from_start.rotation.toRotationMatrix();
  rig_from_start = step.later_from_earlier * rig_from_start;
  const Matrix3d later = rig_from_start.rotation.toRotationMatrix();
  rotation_covariance += later.transpose() * step.rotation_covariance * later;
  center_covariance += earlier.transpose() * step.center_covariance * earlier;
}

MeasuredMotion RigPath::MeasuredBetween(int earlier, int later) const {
  const Place& from = *of_frame[earlier];
  const Place& to = *of_frame[later];
  const Matrix3d from_start = from.rig_from_start.rotation.toRotationMatrix();
  const Matrix3d to_start = to.rig_from_start.rotation.toRotationMatrix();
  return {Between(earlier, later),
          to_start * (to.rotation_covariance - from.rotation_covariance) *
              to_start.transpose(),
          from_start * (to.center_covariance - from.center_covariance) *
              from_start.transpose()};
}

RigPath FindRigPath(const TemporalOrder& order, int num_frames,
                    const MotionEvidence& evidence, int num_threads) {
  RigPath path;
  path.of_frame.resize(num_frames);
  path.group.resize(num_frames, -1);
  for (Mask* mask :
       {&path.is_doubtful, &path.is_interpolated, &path.is_in_long_motion}) {
    *mask = Mask(num_frames, false);
  }
  int num_stretches = 0;
  for (const std::vector<int>& sequence : order.sequences()) {
    if (sequence.size() < 2) continue;
    num_stretches = FollowSequence(order, sequence, evidence, num_threads,
                                   num_stretches, &path);
  }
  return path;
}

}  // namespace mgsfm
