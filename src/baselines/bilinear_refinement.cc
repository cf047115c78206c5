// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/bilinear_refinement.h"

#include <Eigen/Core>
#include <algorithm>

#include "translation/position_rig_problem.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using BilinearProblem = PositionRigProblem<ScaledRayObservation>;

// Differences shorter than this start as if so long.
constexpr double kMinLength = 1e-9;

void AddDirections(const RefinementInput& input, double weight,
                   bool with_lengths, BilinearProblem* bilinear) {
  bilinear->AddTerms(BaselineKind::kDirection, BaselineTerm::Kind::kBilinear,
                     [&](size_t pair_idx, BaselineTerm* term) {
                       term->direction = input.baselines[pair_idx].direction;
                       term->length = input.Length(pair_idx);
                       term->min_length = kMinRelativeLength * term->length;
                       term->weight = input.DirectionWeight(pair_idx, weight);
                       if (with_lengths)
                         term->length_weight = input.LengthWeight(pair_idx);
                     });
}

void StartScales(bool at_random, BilinearProblem* bilinear) {
  const RigProblem<ScaledRayObservation>& problem = bilinear->problem();
  RigState& state = *bilinear->mutable_state();
  state.observation_scales.assign(problem.observations.size(), 1.0);
  state.baseline_scales.assign(problem.baselines.size(), 1.0);
  if (at_random) return;
  const auto scale_of = [](double length, double min_length) {
    return std::max(1.0 / std::max(length, min_length), kMinScale);
  };
  const auto center_of = [&](int image_idx) -> Vector3d {
    const RigProblemBase::Image& image = problem.images[image_idx];
    return state.frames[image.frame].center -
           problem.held_cam_from_world[image_idx].transpose() *
               state.sensors[image.sensor].translation;
  };
  for (size_t p = 0; p < problem.num_points(); ++p) {
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      const Vector3d center = center_of(problem.observations[o].image);
      state.observation_scales[o] =
          scale_of((state.points[p] - center).norm(), kMinLength);
    }
  }
  for (size_t t = 0; t < problem.baselines.size(); ++t) {
    const BaselineTerm& term = problem.baselines[t];
    state.baseline_scales[t] =
        scale_of((center_of(term.image2) - center_of(term.image1)).norm(),
                 std::max(term.min_length, kMinLength));
  }
}

}  // namespace

SolveSummary RefineCamerasBilinearly(const RefinementInput& input,
                                     const RefinementOptions& options,
                                     const Context& context,
                                     Positions* positions) {
  if (!input.HasDirections()) return NothingToDo("No pair has parallax.");
  BilinearProblem bilinear(input, options, *positions);
  AddDirections(input, 1.0, true, &bilinear);
  bilinear.AddZeroBaselines();
  bilinear.HoldGauge();
  StartScales(options.starts_at_random, &bilinear);
  SolveSummary summary = bilinear.SolveAnnealed(context);
  bilinear.WriteBack(positions);
  return summary;
}

SolveSummary RefineCamerasAndPointsBilinearly(
    const RefinementInput& input, const TrackRays& rays,
    const std::vector<size_t>& track_idxs, const RefinementOptions& options,
    const Context& context, Positions* positions, TrackPoints* points) {
  if (!IsDetermined(input, track_idxs)) return NothingToDo("Too few points.");
  BilinearProblem bilinear(input, options, *positions);
  bilinear.AddPoints(rays, track_idxs, *points);
  AddDirections(input, kPairWeightWithPoints, false, &bilinear);
  bilinear.HoldGauge();
  StartScales(options.starts_at_random, &bilinear);
  SolveSummary summary = bilinear.Solve(context);
  bilinear.WriteBack(positions);
  bilinear.WriteBack(track_idxs, points);
  return summary;
}

}  // namespace mgsfm
