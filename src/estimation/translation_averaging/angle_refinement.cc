// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/angle_refinement.h"

#include "translation_averaging/position_rig_problem.h"

namespace mgsfm {
namespace {

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
