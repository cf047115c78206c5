// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "rig_solver/rig_problem.h"
#include "translation_averaging/refinement_terms.h"

namespace mgsfm {

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

// Refines frame centers and sensor translations by eq. (16) of MGSfM,
//
//   min sum_p rho(w_p |b_p - C_p / |C_p||),
//
// with the directions b_p and baselines C_p of pairs, a Cauchy loss rho whose
// scale is annealed to loss_scale_rad, and terms w log(|C_p| / s_p) that keep
// the measured lengths s_p, which directions do not determine on straight
// motion. Gauge: the first frame is constant; the s_p determine the unit of
// length. Levenberg-Marquardt (rig_solver/rig_solver.h); stops when the
// relative decrease of the cost is below function_tolerance.
SolveSummary RefineCameras(const RefinementInput& input,
                           const RefinementOptions& options,
                           const Context& context, Positions* positions);

// Refines centers, translations and points p_k by eq. (18) of MGSfM,
//
//   min sum_ik rho(|g_ik - (p_k - c_i) / |p_k - c_i||) + pairs,
//
// over the used observations of the tracks track_idxs, with rays g in world
// axes. The pair terms above have a tenth of their weight and no lengths; they
// constrain frames with too few points. Gauge: the first frame is constant, and
// the farthest unknown keeps its length unless known sensor offsets determine
// the unit. Points are eliminated (Schur complement).
SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const RefinementOptions& options,
                                    const Context& context,
                                    PositionsAndPoints* placed);

constexpr PositionObjective kNonBilinearObjective = {RefineCameras,
                                                     RefineCamerasAndPoints};

}  // namespace mgsfm
