// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/long_motions.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ChosenMotions = std::vector<std::optional<ChosenMotion>>;

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

}  // namespace

bool AddLongMotions(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence, const ChosenMotions& chosen,
                    const Mask& is_doubtful, Steps* steps) {
  bool are_added = false;
  for (size_t begin = 0; begin < chosen.size(); ++begin) {
    const size_t last = std::min(chosen.size(), begin + kMaxNumSkipped + 1) - 1;
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

}  // namespace mgsfm
