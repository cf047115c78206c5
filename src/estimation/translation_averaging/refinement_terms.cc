// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/refinement_terms.h"

#include <cmath>

namespace mgsfm {
namespace {

// Errors of scales beyond their own estimates. Half or twice the value does not
// change errors, as for kZeroBaselineWeight (docs/results/constants.md).
constexpr double kScaleSigma = 0.1;
// Relative to the weight of a direction, per unit of length: a pair without
// parallax bounds its baseline only loosely.
constexpr double kZeroBaselineWeight = 0.01;

}  // namespace

bool RefinementInput::IsUsable(size_t pair_idx, BaselineKind kind,
                               const Positions& positions) const {
  if (!pair_is_used[pair_idx] || baselines[pair_idx].kind != kind) return false;
  const int image1 = baselines[pair_idx].image_idx1;
  const int image2 = baselines[pair_idx].image_idx2;
  const bool is_constant =
      problem.frame_idx[image1] == problem.frame_idx[image2] &&
      !IsFree(image1) && !IsFree(image2);
  return !is_constant && positions.IsPlaced(problem, image1) &&
         positions.IsPlaced(problem, image2);
}

double RefinementInput::DirectionSigma(size_t pair_idx) const {
  return std::hypot(baselines[pair_idx].sigma_rad, kDirectionSigma);
}

double RefinementInput::LengthSigma(size_t pair_idx) const {
  return std::hypot(scales.pairs[pair_idx]->sigma_log, kScaleSigma);
}

double RefinementInput::DirectionWeight(size_t pair_idx, double weight) const {
  return weight * kDirectionSigma / DirectionSigma(pair_idx);
}

double RefinementInput::LengthWeight(size_t pair_idx) const {
  return kDirectionSigma / LengthSigma(pair_idx);
}

double RefinementInput::ZeroBaselineWeight() const {
  return kZeroBaselineWeight * kDirectionSigma / initial.group_factor[0];
}

bool IsDetermined(const RefinementInput& input,
                  const std::vector<size_t>& track_idxs) {
  // Fewer points do not support a refinement.
  return (input.HasDirections() || input.baselines.empty()) &&
         track_idxs.size() >= 10;
}

SolveSummary NothingToDo(const char* message) {
  SolveSummary summary;
  summary.termination = Termination::kConverged;
  summary.message = message;
  return summary;
}

}  // namespace mgsfm
