// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_solver.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

RigSolverOptions SolverOptions(const RefinementOptions& options) {
  RigSolverOptions solver_options;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.backend = options.backend;
  return solver_options;
}

// Positions as unknowns of a rig problem (rig_solver/rig_problem.h) with
// constant rotations. Frames, sensors and images have the indices of the scene.
// Terms and points are added first, then the gauge is fixed.
class PositionRigProblem {
 public:
  // The arguments must outlive this object.
  PositionRigProblem(const RefinementInput& input,
                     const RefinementOptions& options,
                     const Positions& positions);

  // Adds a term for each usable pair of a kind; `set` sets its values.
  using SetTerm = std::function<void(size_t pair_idx, BaselineTerm* term)>;
  void AddTerms(BaselineKind baseline_kind, BaselineTerm::Kind kind,
                const SetTerm& set);
  void AddZeroBaselines();
  // Adds the used observations of the tracks.
  void AddPoints(const TrackRays& rays, const std::vector<size_t>& track_idxs,
                 const TrackPoints& points);
  // Fixes the first frame and the unobservable directions of sensors.
  void HoldGauge();
  // Fixes the component of the longest unknown along its initial value. A
  // change of scale can satisfy this exactly, so it does not affect the shape.
  void HoldScale();

  SolveSummary Solve(const Context& context);
  // Solves once for each scale of the annealed loss.
  SolveSummary SolveAnnealed(const Context& context);

  void WriteBack(Positions* positions) const;
  void WriteBack(const std::vector<size_t>& track_idxs,
                 TrackPoints* points) const;

 private:
  void MarkAsSeen(int image_idx) {
    frame_is_seen_[input_.problem.frame_idx[image_idx]] = true;
    sensor_is_seen_[input_.problem.sensor_idx[image_idx]] = true;
  }

  const RefinementInput& input_;
  const RefinementOptions& options_;
  const Positions& initial_;
  Mask frame_is_seen_;
  Mask sensor_is_seen_;
  RigProblem<RayObservation> problem_;
  RigState state_;
};

PositionRigProblem::PositionRigProblem(const RefinementInput& input,
                                       const RefinementOptions& options,
                                       const Positions& positions)
    : input_(input),
      options_(options),
      initial_(positions),
      frame_is_seen_(positions.frame_center.size(), false),
      sensor_is_seen_(positions.sensor_translation.size(), false) {
  problem_.loss = {options.loss, options.loss_scale_rad};
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
    problem_.held_cam_from_world.emplace_back(Eigen::Matrix3d::Identity());
    if (world_from_cam) {
      problem_.held_cam_from_world.back() = world_from_cam->transpose();
    }
  }
}

void PositionRigProblem::AddTerms(BaselineKind baseline_kind,
                                  BaselineTerm::Kind kind, const SetTerm& set) {
  for (size_t i = 0; i < input_.baselines.size(); ++i) {
    if (!input_.IsUsable(i, baseline_kind, initial_)) continue;
    const BaselineDirection& baseline = input_.baselines[i];
    MarkAsSeen(baseline.image_idx1);
    MarkAsSeen(baseline.image_idx2);
    BaselineTerm term;
    term.kind = kind;
    term.image1 = baseline.image_idx1;
    term.image2 = baseline.image_idx2;
    set(i, &term);
    problem_.baselines.push_back(term);
  }
}

void PositionRigProblem::AddZeroBaselines() {
  AddTerms(BaselineKind::kNoParallax, BaselineTerm::Kind::kZero,
           [this](size_t, BaselineTerm* term) {
             term->weight = input_.ZeroBaselineWeight();
           });
}

void PositionRigProblem::AddPoints(const TrackRays& rays,
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

void PositionRigProblem::HoldGauge() {
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

void PositionRigProblem::HoldScale() {
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

SolveSummary PositionRigProblem::Solve(const Context& context) {
  return SolveRigProblem(problem_, SolverOptions(options_), context, &state_);
}

SolveSummary PositionRigProblem::SolveAnnealed(const Context& context) {
  RigSolver<RayObservation> solver(problem_, SolverOptions(options_), context);
  SolveSummary summary;
  for (const double factor : kLossAnnealing) {
    problem_.loss.scale = factor * options_.loss_scale_rad;
    summary = solver.Solve(
        factor > 1.0 ? kNumCoarseIterations : options_.max_num_iterations,
        &state_);
    if (!summary.IsUsable()) break;
  }
  return summary;
}

void PositionRigProblem::WriteBack(Positions* positions) const {
  for (size_t f = 0; f < state_.frames.size(); ++f) {
    positions->frame_center[f] = state_.frames[f].center;
  }
  for (size_t s = 0; s < state_.sensors.size(); ++s) {
    positions->sensor_translation[s] = state_.sensors[s].translation;
  }
}

void PositionRigProblem::WriteBack(const std::vector<size_t>& track_idxs,
                                   TrackPoints* points) const {
  for (size_t k = 0; k < track_idxs.size(); ++k) {
    points->point_in_world[track_idxs[k]] = state_.points[k];
  }
}

void AddDirections(const RefinementInput& input, double weight,
                   PositionRigProblem* angles) {
  angles->AddTerms(BaselineKind::kDirection, BaselineTerm::Kind::kDirection,
                   [&](size_t pair_idx, BaselineTerm* term) {
                     term->direction = input.baselines[pair_idx].direction;
                     term->min_length =
                         kMinRelativeLength * input.Length(pair_idx);
                     term->weight = input.DirectionWeight(pair_idx, weight);
                   });
}

void AddLengths(const RefinementInput& input, PositionRigProblem* angles) {
  angles->AddTerms(BaselineKind::kDirection, BaselineTerm::Kind::kLength,
                   [&](size_t pair_idx, BaselineTerm* term) {
                     term->length = input.Length(pair_idx);
                     term->min_length = kMinRelativeLength * term->length;
                     term->weight = input.LengthWeight(pair_idx);
                   });
}

}  // namespace

SolveSummary RefineCameras(const RefinementInput& input,
                           const RefinementOptions& options,
                           const Context& context, Positions* positions) {
  if (!input.HasDirections()) return NothingToDo("No pair has parallax.");
  PositionRigProblem angles(input, options, *positions);
  AddDirections(input, 1.0, &angles);
  AddLengths(input, &angles);
  angles.AddZeroBaselines();
  angles.HoldGauge();
  SolveSummary summary = angles.SolveAnnealed(context);
  angles.WriteBack(positions);
  return summary;
}

SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const RefinementOptions& options,
                                    const Context& context,
                                    PositionsAndPoints* placed) {
  if (!IsDetermined(input, track_idxs)) return NothingToDo("Too few points.");
  PositionRigProblem angles(input, options, placed->positions);
  angles.AddPoints(rays, track_idxs, placed->points);
  AddDirections(input, kPairWeightWithPoints, &angles);
  angles.HoldGauge();
  if (!options.starts_at_random) angles.HoldScale();
  SolveSummary summary = angles.Solve(context);
  angles.WriteBack(&placed->positions);
  angles.WriteBack(track_idxs, &placed->points);
  return summary;
}

}  // namespace mgsfm
