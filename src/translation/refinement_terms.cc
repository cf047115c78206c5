// SPDX-License-Identifier: BSD-3-Clause
#include "translation/refinement_terms.h"

#include <cmath>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Errors of pairs that remain whatever their own estimates say.
constexpr double kDirectionSigma = DegToRad(0.5);
constexpr double kScaleSigma = 0.1;
constexpr size_t kMinNumPoints = 10;

}  // namespace

bool RefinementInput::IsUsable(const BaselineDirection& motion,
                               BaselineKind kind,
                               const Positions& positions) const {
  const int image1 = motion.image_idx1, image2 = motion.image_idx2;
  const bool is_constant =
      problem.frame_idx[image1] == problem.frame_idx[image2] &&
      !IsFree(image1) && !IsFree(image2);
  return motion.kind == kind && !is_constant &&
         positions.IsPlaced(problem, image1) &&
         positions.IsPlaced(problem, image2);
}

double RefinementInput::DirectionWeight(size_t motion_idx,
                                        double weight) const {
  return weight * kDirectionSigma /
         std::hypot(motions[motion_idx].sigma_rad, kDirectionSigma);
}

double RefinementInput::LengthWeight(size_t motion_idx) const {
  return kDirectionSigma /
         std::hypot(scales.sigma_log[motion_idx], kScaleSigma);
}

double RefinementInput::ZeroBaselineWeight() const {
  return 0.01 * kDirectionSigma / initial.group_factor[0];
}

bool IsDetermined(const RefinementInput& input,
                  const std::vector<size_t>& track_idxs) {
  return (input.HasDirections() || input.motions.empty()) &&
         track_idxs.size() >= kMinNumPoints;
}

SolveSummary NothingToDo(const char* message) {
  SolveSummary summary;
  summary.termination = Termination::kConverged;
  summary.message = message;
  return summary;
}

}  // namespace mgsfm
