// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/rotation/rotation_averaging.h"
#include "rotation/rotation_initialization.h"
#include "rotation/rotation_problem.h"

namespace mgsfm {

// The scale of a Geman-McClure loss, lowered step by step (graduated
// non-convexity): it begins at 5 deg or above and falls by 0.7 in each step
// down to max(6 sigma, 0.05 deg), sigma the robust standard deviation of the
// residuals at that step; from then on it is held.
class RobustScaleSchedule {
 public:
  // The loss for the next iteration, given all norms of the residuals, radians.
  RobustLoss Next(const std::vector<double>& norms);
  bool IsFinal() const { return is_final_; }
  double scale_rad() const { return scale_rad_; }

 private:
  AnnealedScale scale_ = AnnealedScale(DegToRad(5.0), 0.7);
  double scale_rad_ = 0.0;
  bool is_final_ = false;
};

// Minimises sum w |e| over the nodes, by linearisation: each step minimises
// sum w |e + d_1 - d_2| by ADMM. Stops when the root mean square of a step is
// at most 0.05 deg. Sensors are held. The cost is the objective.
SolveSummary AverageL1(const RotationProblem& problem,
                       const RotationAveragingOptions& options,
                       const Context& context, RotationState* state);

// Minimises sum w rho(|e|^2) / 2 over nodes and free sensors by re-weighted
// Gauss-Newton steps, with the terms of gravity as gravity.h weighs them; both
// costs leave these out. Stops when all rotations change by at most
// step_tolerance_deg at the final scale. Both costs of the summary are for the
// final scale. After a failure the state is the last good one.
SolveSummary AverageRobust(const RotationProblem& problem,
                           const RotationAveragingOptions& options,
                           const Context& context, RotationState* state);

// The start by a spanning forest (rotation_initialization.h), AverageL1() and
// AverageRobust(), whose summary is returned. Should the L1 step fail, the last
// goes on from what it left. With a start the L1 step is left out: it counts
// votes, whatever it starts from, while the last keeps to what is close.
SolveSummary AverageNodes(const RotationProblem& problem,
                          const NodeStart& start,
                          const RotationAveragingOptions& options,
                          const Context& context, RotationState* state);

}  // namespace mgsfm
