// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/eval/evaluation.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

// How far the mapper is from the best that its input allows. With noise no
// mapper finds the truth, so its errors are compared with those of two bundle
// adjustments that start at the truth:
//
// - the oracle adjusts the mapper's own tracks, that is, the observations of
//   its final points: the optimum that it should have found. An error above it
//   is one of convergence or of a wrong basin.
// - the full oracle adjusts all true tracks that the verified matches hold: the
//   connected components of the matches whose two keypoints show the same
//   static point. A mapper that throws observations away, or takes wrong ones,
//   has an easy oracle, but not an easy full one.
//
// The ratios are the mean position error of the mapper over that of an oracle.
// What makes them fair:
//
// - Errors are those of model_evaluator: positions and rotations of images
//   against the truth of each image (which has its own instant if there is
//   trigger jitter), after the robust similarity alignment of AlignPoses, for
//   each model on its own. So the gauge that a solve holds has no part in them.
// - The mapper and its oracle are compared over the images that the mapper
//   registered, the full oracle over all images. Registered shares have to be
//   looked at as well.
// - Intrinsics and poses in the rig are held or refined as in the mapper: the
//   options and the scene, which says what is known, are the same. Simulated
//   intrinsics are exact and have a prior, so by default they are held; poses
//   in the rig are free.
// - The loss is Huber's at the threshold of the mapper's last solve, which
//   follows its estimate of the noise.
// - A solve that starts at the truth is biased towards it until it has
//   converged, most in the weak modes of a long drive: a bend that is a
//   standard deviation off costs no more than a half. The oracles therefore end
//   at a relative change of the cost of 1e-8, not at the mapper's 1e-6. What
//   still changes then is points near infinity; poses do not.
// - Points of the oracle start where the rays of the true poses meet, not at
//   the true points: a track may hold wrong observations. Those of the full
//   oracle start at the truth. Both may be any distance away: there is no least
//   angle.

// Errors of the poses in the rig, relative to the reference, after alignment.
struct RigErrors {
  std::string sensor;
  double rotation_deg = 0.0;
  double position_m = 0.0;       // of the camera in the frame of the reference
  double true_distance_m = 0.0;  // from the reference
};

struct ModelErrors {
  int num_images = 0;
  int num_registered = 0;
  // Absent if no image is registered.
  std::optional<ErrorStatistics> position_m, rotation_deg;
  std::vector<RigErrors> rig;
};

ModelErrors EvaluateModel(const Simulation& simulation,
                          const Reconstruction& model);

struct OracleResult {
  ModelErrors errors;
  Reconstruction model;
  SolveSummary solve;
  size_t num_points = 0;
  size_t num_observations = 0;
  double seconds = 0.0;
};

// The loss of the last solve of a mapper with these options.
double LastLossScalePx(const BundleAdjustmentOptions& options,
                       const BundleSummary& summary);

// `options` are the mapper's.
OracleResult SolveOracle(const Simulation& simulation, const MapperModel& model,
                         const BundleAdjustmentOptions& options,
                         const Context& context);
OracleResult SolveFullOracle(const Simulation& simulation, double loss_scale_px,
                             const BundleAdjustmentOptions& options,
                             const Context& context);

// The true tracks that the verified matches hold, see above.
ObservationGroups TrueTracks(const Simulation& simulation);

struct OracleComparison {
  ModelErrors mapper;  // of its largest model
  double loss_scale_px = 0.0;
  OracleResult oracle, full_oracle;

  double OracleRatio() const;
  double FullOracleRatio() const;
};

// nullopt if the mapper has no model.
std::optional<OracleComparison> CompareWithOracles(
    const Simulation& simulation, const MapperResult& result,
    const BundleAdjustmentOptions& options, const Context& context);

}  // namespace mgsfm
