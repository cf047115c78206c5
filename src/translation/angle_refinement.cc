// SPDX-License-Identifier: BSD-3-Clause
#include "translation/angle_refinement.h"

#include <algorithm>
#include <cmath>

#include "mgsfm/geometry/so3.h"
#include "mgsfm/least_squares/rig_solver.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Frames, sensors and images of the problem are those of the scene.
class AngleProblem {
 public:
  AngleProblem(const RefinementInput& input, const RobustLoss& loss,
               const Positions& positions);

  void AddDirections(double weight);
  void AddLengths();
  void AddZeroBaselines(double weight);
  void AddPoints(const TrackRays& rays, const std::vector<size_t>& track_idxs,
                 const TrackPoints& points);
  // Holds the first frame, and what was found to be undetermined.
  void HoldGauge();
  // Keeps the length of the longest unknown along itself. A change of scale can
  // meet this exactly, so it does not affect the shape.
  void HoldScale();
  void SetLoss(const RobustLoss& loss) { problem_.loss = loss; }

  const RigProblem<RayObservation>& problem() const { return problem_; }
  RigState* mutable_state() { return &state_; }
  void WriteBack(Positions* positions) const;

 private:
  BaselineTerm& AddTerm(const PairMotion& motion, BaselineTerm::Kind kind);
  void MarkAsSeen(int image_idx) {
    frame_is_seen_[input_.problem.frame_idx[image_idx]] = true;
    sensor_is_seen_[input_.problem.sensor_idx[image_idx]] = true;
  }

  const RefinementInput& input_;
  const Positions& initial_;
  std::vector<char> frame_is_seen_;
  std::vector<char> sensor_is_seen_;
  RigProblem<RayObservation> problem_;
  RigState state_;
};

AngleProblem::AngleProblem(const RefinementInput& input, const RobustLoss& loss,
                           const Positions& positions)
    : input_(input),
      initial_(positions),
      frame_is_seen_(positions.frame_center.size(), false),
      sensor_is_seen_(positions.sensor_translation.size(), false) {
  SetLoss(loss);
  const PositionProblem& known = input.problem;
  PoseMask moves = PoseMask::Zero();
  moves.tail<3>().setOnes();
  problem_.frame_masks.assign(positions.frame_center.size(), moves);
  for (const Vector3d& center : positions.frame_center) {
    state_.frames.push_back({Eigen::Quaterniond::Identity(), center});
  }
  for (size_t s = 0; s < positions.sensor_translation.size(); ++s) {
    const bool is_free = known.sensor_kind[s] == SensorKind::kFree;
    problem_.sensor_masks.push_back(is_free ? moves : PoseMask::Zero());
    state_.sensors.push_back(
        {Eigen::Quaterniond::Identity(), positions.sensor_translation[s]});
  }
  for (size_t i = 0; i < known.frame_idx.size(); ++i) {
    problem_.images.push_back({known.frame_idx[i], known.sensor_idx[i], -1});
    const auto& world_from_cam = known.world_from_cam[i];
    problem_.held_cam_from_world.push_back(Eigen::Matrix3d::Identity());
    if (world_from_cam) {
      problem_.held_cam_from_world.back() = world_from_cam->transpose();
    }
  }
}

BaselineTerm& AngleProblem::AddTerm(const PairMotion& motion,
                                    BaselineTerm::Kind kind) {
  MarkAsSeen(motion.image_idx1);
  MarkAsSeen(motion.image_idx2);
  BaselineTerm term;
  term.kind = kind;
  term.image1 = motion.image_idx1;
  term.image2 = motion.image_idx2;
  problem_.baselines.push_back(term);
  return problem_.baselines.back();
}

void AngleProblem::AddDirections(double weight) {
  for (size_t i = 0; i < input_.motions.size(); ++i) {
    const PairMotion& motion = input_.motions[i];
    if (!input_.IsUsable(motion, MotionKind::kDirection, initial_)) continue;
    BaselineTerm& term = AddTerm(motion, BaselineTerm::Kind::kDirection);
    term.direction = motion.direction;
    term.min_length = kMinRelativeLength * input_.Length(i);
    term.weight = input_.DirectionWeight(i, weight);
  }
}

void AngleProblem::AddLengths() {
  for (size_t i = 0; i < input_.motions.size(); ++i) {
    const PairMotion& motion = input_.motions[i];
    if (!input_.IsUsable(motion, MotionKind::kDirection, initial_)) continue;
    BaselineTerm& term = AddTerm(motion, BaselineTerm::Kind::kLength);
    term.length = input_.Length(i);
    term.min_length = kMinRelativeLength * input_.Length(i);
    term.weight = input_.LengthWeight(i);
  }
}

void AngleProblem::AddZeroBaselines(double weight) {
  for (const PairMotion& motion : input_.motions) {
    if (!input_.IsUsable(motion, MotionKind::kNoParallax, initial_)) continue;
    AddTerm(motion, BaselineTerm::Kind::kZero).weight = weight;
  }
}

void AngleProblem::AddPoints(const TrackRays& rays,
                             const std::vector<size_t>& track_idxs,
                             const TrackPoints& points) {
  for (const size_t t : track_idxs) {
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      if (!points.observation_is_used[k]) continue;
      const int image_idx = rays.tracks.observations[k].image_idx;
      MarkAsSeen(image_idx);
      problem_.observations.push_back(
          {image_idx,
           problem_.held_cam_from_world[image_idx] * rays.rays_in_world[k]});
    }
    problem_.point_begin.push_back(problem_.observations.size());
    state_.points.push_back(*points.point_in_world[t]);
  }
}

void AngleProblem::HoldGauge() {
  for (size_t f = 0; f < frame_is_seen_.size(); ++f) {
    if (!initial_.frame_is_placed[f] || !frame_is_seen_[f]) continue;
    problem_.frame_masks[f].setZero();
    break;
  }
  const Eigen::MatrixXd& rows = input_.initial.unobservable;
  for (Eigen::Index k = 0; k < rows.rows(); ++k) {
    LinearTerm term;
    term.weight = 1.0 / input_.initial.group_factor[0];
    for (size_t s = 0; s < input_.initial.free_sensors.size(); ++s) {
      const Vector3d part =
          rows.row(k).segment<3>(3 * static_cast<Eigen::Index>(s));
      term.parts.push_back({false, input_.initial.free_sensors[s], part});
    }
    problem_.linear_terms.push_back(term);
  }
}

void AngleProblem::HoldScale() {
  if (input_.initial.is_metric) return;
  LinearTerm::Part longest;
  double max_squared = 0.0;
  const auto compare = [&](bool is_frame, size_t idx, const Vector3d& x,
                           const PoseMask& mask) {
    if (mask.isZero(0.0) || !(x.squaredNorm() > max_squared)) return;
    max_squared = x.squaredNorm();
    longest = {is_frame, static_cast<int>(idx), x / max_squared};
  };
  for (size_t f = 0; f < frame_is_seen_.size(); ++f) {
    if (!frame_is_seen_[f]) continue;
    compare(true, f, state_.frames[f].center, problem_.frame_masks[f]);
  }
  for (size_t s = 0; s < sensor_is_seen_.size(); ++s) {
    if (!sensor_is_seen_[s]) continue;
    compare(false, s, state_.sensors[s].translation, problem_.sensor_masks[s]);
  }
  if (max_squared > 0.0) problem_.linear_terms.push_back({{longest}, 1.0, 1.0});
}

void AngleProblem::WriteBack(Positions* positions) const {
  for (size_t f = 0; f < state_.frames.size(); ++f) {
    positions->frame_center[f] = state_.frames[f].center;
  }
  for (size_t s = 0; s < state_.sensors.size(); ++s) {
    positions->sensor_translation[s] = state_.sensors[s].translation;
  }
}

RigSolverOptions SolverOptions(const RefinementOptions& options) {
  RigSolverOptions solver_options;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.backend = options.backend;
  return solver_options;
}

}  // namespace

SolveSummary RefineCameras(const RefinementInput& input,
                           const RefinementOptions& options,
                           const Context& context, Positions* positions) {
  if (!input.HasDirections()) return NothingToDo("No pair has parallax.");
  AngleProblem angles(input, {options.loss, options.loss_scale_rad},
                      *positions);
  angles.AddDirections(1.0);
  angles.AddLengths();
  angles.AddZeroBaselines(input.ZeroBaselineWeight());
  angles.HoldGauge();
  RigSolver<RayObservation> solver(angles.problem(), SolverOptions(options),
                                   context);
  SolveSummary summary;
  for (const double factor : kLossAnnealing) {
    angles.SetLoss({options.loss, factor * options.loss_scale_rad});
    summary = solver.Solve(
        factor > 1.0 ? kNumCoarseRefinements : options.max_num_iterations,
        angles.mutable_state());
    if (!summary.IsUsable()) break;
  }
  angles.WriteBack(positions);
  return summary;
}

SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const RefinementOptions& options,
                                    const Context& context,
                                    Positions* positions, TrackPoints* points) {
  if (!IsDetermined(input, track_idxs)) return NothingToDo("Too few points.");
  AngleProblem angles(input, {options.loss, options.loss_scale_rad},
                      *positions);
  angles.AddPoints(rays, track_idxs, *points);
  angles.AddDirections(kPairWeightWithPoints);
  angles.HoldGauge();
  if (!options.starts_at_random) angles.HoldScale();
  const SolveSummary summary =
      SolveRigProblem(angles.problem(), SolverOptions(options), context,
                      angles.mutable_state());
  angles.WriteBack(positions);
  for (size_t k = 0; k < track_idxs.size(); ++k) {
    points->point_in_world[track_idxs[k]] = angles.mutable_state()->points[k];
  }
  return summary;
}

}  // namespace mgsfm
