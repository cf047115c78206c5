// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "moving_objects/motion_candidates.h"
#include "moving_objects/motion_search.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A step is ambiguous if the odds of another motion exceed 1 to 20.
constexpr double kMinMargin = 3.0;
// Pairs of neighbors bridge fewer steps. 28 of 450 groups of ambiguous steps
// on 200 drives were larger (docs/results/constants.md).
constexpr size_t kMinNumAmbiguous = 3;
// At most this many steps between those of a group.
constexpr size_t kMaxNumBetween = 2;

MotionNoise Larger(const MotionNoise& a, const MotionNoise& b) {
  return {std::max(a.median_step, b.median_step),
          std::max(a.rotation_rad, b.rotation_rad),
          std::max(a.relative_center, b.relative_center),
          std::max(a.turn_change_rad, b.turn_change_rad),
          std::max(a.linear_change, b.linear_change)};
}

// The steps near those whose hypotheses disagree.
Mask FindDoubtful(const Mask& has_rivals) {
  Mask is_doubtful(has_rivals.size(), false);
  for (size_t k = 0; k < has_rivals.size(); ++k) {
    if (!has_rivals[k]) continue;
    const size_t begin = k > kMaxNumSkipped ? k - kMaxNumSkipped : 0;
    const size_t end = std::min(has_rivals.size(), k + kMaxNumSkipped + 1);
    is_doubtful.Fill(begin, end, true);
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

// A motion with depth that took the rotation and direction of image pairs for
// the search gets back its own: pairs next to vehicles are biased.
void RestoreMotionsByDepth(const std::vector<double>& durations,
                           std::vector<std::optional<ChosenMotion>>* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    auto& motion = (*chosen)[k];
    if (!motion || !motion->candidate.by_depth) continue;
    motion->velocity = VelocityOf(*motion->candidate.by_depth, durations[k]);
  }
}

// The covariances of motions do not contain what all steps share, such as a
// wrong calibration: how much their measurements disagree shows it.
void AddDisagreement(const MotionNoise& noise,
                     const std::vector<double>& durations,
                     std::vector<std::optional<ChosenMotion>>* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    if (!(*chosen)[k]) continue;
    Velocity& velocity = (*chosen)[k]->velocity;
    const double turn = noise.rotation_rad / durations[k];
    const double change = noise.relative_center * velocity.linear.norm();
    velocity.angular_covariance += turn * turn * Matrix3d::Identity();
    velocity.linear_covariance += change * change * Matrix3d::Identity();
  }
}

// Interpolates the distances that the chosen hypotheses do not have. Their
// errors grow with the number of steps to a known one.
void InterpolateDistances(const Steps& steps,
                          std::vector<std::optional<ChosenMotion>>* chosen) {
  const auto has_distance = [](const std::optional<ChosenMotion>& motion) {
    return motion && motion->HasDistance();
  };
  auto before = chosen->end();
  for (auto it = chosen->begin(); it != chosen->end(); ++it) {
    if (has_distance(*it)) before = it;
    if (!*it || (*it)->HasDistance()) continue;
    const auto after = std::find_if(it, chosen->end(), has_distance);
    if (before == chosen->end() && after == chosen->end()) continue;
    const Velocity& first =
        (*(before == chosen->end() ? after : before))->velocity;
    const Velocity& last =
        (*(after == chosen->end() ? before : after))->velocity;
    const bool is_between = before != chosen->end() && after != chosen->end();
    const auto weight = is_between ? static_cast<double>(it - before) /
                                         static_cast<double>(after - before)
                                   : 0.0;
    const Vector3d linear =
        (1.0 - weight) * first.linear + weight * last.linear;
    const double duration = steps.durations[it - chosen->begin()];
    Velocity& velocity = (*it)->velocity;
    velocity =
        VelocityOf((*it)->candidate.ClosestTo(duration * linear), duration);
    const auto distance = static_cast<double>(
        std::min(std::abs(it - (before == chosen->end() ? after : before)),
                 std::abs((after == chosen->end() ? before : after) - it)));
    const double change = TypicalChange(first, last, steps.noise).linear;
    velocity.linear_covariance +=
        distance * change * change * Matrix3d::Identity();
  }
}

// The velocity between two steps, as far from both as it may change.
Velocity Mean(const Velocity& a, const Velocity& b, const MotionNoise& noise) {
  Velocity mean{0.5 * (a.linear + b.linear),
                0.5 * (a.angular_rad + b.angular_rad)};
  const VelocityChange change = TypicalChange(a, b, noise);
  mean.linear_covariance =
      change.linear * change.linear * Matrix3d::Identity() +
      0.25 * (a.linear_covariance + b.linear_covariance);
  mean.angular_covariance =
      change.angular_rad * change.angular_rad * Matrix3d::Identity() +
      0.25 * (a.angular_covariance + b.angular_covariance);
  return mean;
}

// Places of all frames of one sequence. A step is unknown if it is ambiguous,
// or if it has no hypothesis and nothing suggests that one was outvoted.
std::vector<RigPath::Place> FollowMotion(
    const std::vector<std::optional<ChosenMotion>>& chosen, const Steps& steps,
    const Mask& is_doubtful, const Mask& is_ambiguous, int first_stretch) {
  const std::vector<double>& durations = steps.durations;
  std::vector<RigPath::Place> places{{first_stretch}};
  std::optional<size_t> previous;
  const auto are_few = [&](size_t begin, size_t end) {
    const double duration = std::accumulate(durations.begin() + begin,
                                            durations.begin() + end, 0.0);
    return end - begin <= kMaxNumSkipped &&
           std::round(duration) <= static_cast<double>(kMaxNumSkipped);
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
      if (is_doubtful[k]) ++next.num_ambiguous;
    }
    places.push_back(next);
  }
  return places;
}

// Adds the places of one sequence. Returns the number of the next stretch.
int FollowSequence(const TemporalOrder& order, const std::vector<int>& sequence,
                   const std::vector<StepHypotheses>& measured,
                   const MotionComparison& compare, int first_stretch,
                   RigPath* path) {
  if (sequence.size() < 2) return first_stretch;
  MGSFM_CHECK_EQ(measured.size() + 1, sequence.size());
  std::vector<double> durations;
  for (size_t k = 0; k < measured.size(); ++k) {
    durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
  }
  Steps steps = MakeSteps(measured, std::move(durations));
  if (compare) {
    steps.compare = [&](size_t k, const Rigid3& a, const Rigid3& b) {
      return compare(sequence[k], sequence[k + 1], a, b);
    };
  }
  path->noise = Larger(path->noise, steps.noise);
  Mask has_rivals(steps.size(), false);
  for (size_t k = 0; k < steps.size(); ++k) {
    has_rivals[k] = HasRivals(steps, k);
    if (!has_rivals[k]) continue;
    path->is_contested[sequence[k]] = true;
    path->is_contested[sequence[k + 1]] = true;
  }
  const Mask is_doubtful = FindDoubtful(has_rivals);
  for (size_t k = 0; k < steps.size(); ++k) {
    if (!is_doubtful[k]) continue;
    steps.candidates[k] = TryDistances(steps, k);
  }
  MotionChoice choice = ChooseMotions(steps, is_doubtful);
  auto& chosen = choice.motions;
  RestoreMotionsByDepth(steps.durations, &chosen);
  InterpolateDistances(steps, &chosen);
  AddDisagreement(steps.noise, steps.durations, &chosen);
  const auto places =
      FollowMotion(chosen, steps, is_doubtful,
                   FindAmbiguous(choice.margins, is_doubtful), first_stretch);
  for (size_t k = 0; k < sequence.size(); ++k) {
    path->of_frame[sequence[k]] = places[k];
    if (k == 0) continue;
    path->is_interpolated[sequence[k]] =
        !chosen[k - 1] || !chosen[k - 1]->HasDistance();
    path->num_unknown[sequence[k]] =
        path->num_unknown[sequence[k - 1]] + (chosen[k - 1] ? 0 : 1);
  }
  return places.back().stretch + 1;
}

}  // namespace

MeasuredMotion MotionHypothesis::ClosestTo(const Vector3d& center) const {
  MeasuredMotion motion{later_from_earlier, rotation_covariance,
                        center_covariance};
  if (!free_direction || free_direction->isZero(0.0)) return motion;
  const Vector3d nearest = later_from_earlier.Center();
  const double distance = std::max(0.0, free_direction->dot(center - nearest));
  motion.later_from_earlier = Rigid3::FromRotationAndCenter(
      later_from_earlier.rotation, nearest + distance * *free_direction);
  motion.center_covariance *= distance * distance;
  return motion;
}

MeasuredMotion MeasuredMotionOf(const Rigid3& pose,
                                const Eigen::Matrix<double, 6, 6>& covariance,
                                bool is_reversed) {
  const Matrix3d inverse = pose.rotation.conjugate().toRotationMatrix();
  const Matrix3d of_rotation = covariance.topLeftCorner<3, 3>();
  if (is_reversed) {
    return {pose.Inverse(), inverse * of_rotation * inverse.transpose(),
            covariance.bottomRightCorner<3, 3>()};
  }
  // The center -R^T t changes by R^T (w x t - dt).
  Eigen::Matrix<double, 3, 6> by_pose;
  by_pose << CrossMatrix(pose.translation), Matrix3d::Identity();
  by_pose = -inverse * by_pose;
  return {pose, of_rotation, by_pose * covariance * by_pose.transpose()};
}

MeasuredMotion MeasuredMotion::Inverse() const {
  const Matrix3d rotation = later_from_earlier.rotation.toRotationMatrix();
  return {later_from_earlier.Inverse(),
          rotation.transpose() * rotation_covariance * rotation,
          rotation * center_covariance * rotation.transpose()};
}

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

bool RigPath::AreSimilar(const Rigid3& a, const Rigid3& b) const {
  return AreEqualMotions({a}, {b}, noise);
}

RigPath FindRigPath(const TemporalOrder& order, int num_frames,
                    const std::vector<std::vector<StepHypotheses>>& hypotheses,
                    const MotionComparison& compare) {
  MGSFM_CHECK_EQ(hypotheses.size(), order.sequences().size());
  RigPath path;
  path.of_frame.resize(num_frames);
  path.is_contested = Mask(num_frames, false);
  path.is_interpolated = Mask(num_frames, false);
  path.num_unknown.resize(num_frames, 0);
  int num_stretches = 0;
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    num_stretches = FollowSequence(order, order.sequences()[s], hypotheses[s],
                                   compare, num_stretches, &path);
  }
  return path;
}

}  // namespace mgsfm
