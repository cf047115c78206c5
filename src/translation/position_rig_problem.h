// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "least_squares/rig_problem.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/summary.h"
#include "translation/refinement_terms.h"

namespace mgsfm {

// Positions as unknowns of a rig problem (mgsfm/least_squares/rig_problem.h)
// with held rotations: what the objectives have in common. Frames, sensors and
// images of the problem are those of the scene. For RayObservation and
// ScaledRayObservation.
template <class Observation>
class PositionRigProblem {
 public:
  // The arguments must outlive this.
  PositionRigProblem(const RefinementInput& input,
                     const RefinementOptions& options,
                     const Positions& positions);

  // A term for each usable motion of a kind; `set` gives it its values.
  using SetTerm = std::function<void(size_t motion_idx, BaselineTerm* term)>;
  void AddTerms(BaselineKind motion_kind, BaselineTerm::Kind kind,
                const SetTerm& set);
  void AddZeroBaselines();
  // Observations that are used.
  void AddPoints(const TrackRays& rays, const std::vector<size_t>& track_idxs,
                 const TrackPoints& points);
  // Holds the first frame, and what was found to be undetermined.
  void HoldGauge();
  // Keeps the length of the longest unknown along itself. A change of scale can
  // meet this exactly, so it does not affect the shape.
  void HoldScale();

  const RigProblem<Observation>& problem() const { return problem_; }
  RigState* mutable_state() { return &state_; }

  SolveSummary Solve(const Context& context);
  // By one solve for each scale of the loss.
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
  RigProblem<Observation> problem_;
  RigState state_;
};

}  // namespace mgsfm
