// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

// Compares the mapper with the best result that its input permits. With noise
// no mapper recovers the truth, so its errors are compared with those of two
// bundle adjustments that start at the truth:
//
// - The oracle adjusts the tracks of the mapper, i.e. the observations of its
//   final points. Its result is the optimum that the mapper should reach. A
//   larger error means incomplete convergence or a wrong local minimum.
// - The full oracle adjusts all true tracks in the verified matches: the
//   connected components of the matches between keypoints of the same static
//   point. A mapper that discards observations or accepts wrong ones weakens
//   the oracle, but not the full oracle.
//
// The ratios divide the mean position error of the mapper by that of an oracle.
// The following conventions make them fair:
//
// - Errors are those of model_evaluator: positions and rotations of images
//   against the truth of each image at its own capture time, after the robust
//   similarity alignment of AlignPoses for each model separately. The gauge of
//   a solve does not affect them.
// - The mapper and its oracle are compared over the images registered by the
//   mapper, the full oracle over all images. The fractions of registered images
//   must be compared, too.
// - Intrinsics and rig extrinsics are fixed or refined as in the mapper, with
//   the same options and the same scene. Simulated intrinsics are exact and
//   have a prior, so they are fixed by default; rig extrinsics are free.
// - The loss is Huber with the threshold of the last solve of the mapper, which
//   follows its estimate of the noise.
// - A solve that starts at the truth is biased towards it until convergence,
//   most in the weak modes of a long drive: a bend by one standard deviation
//   increases the cost by only one half. The oracles therefore stop at a
//   relative change of the cost of 1e-8 instead of 1e-6. At this point only
//   points near infinity still change.
// - Points of the oracle start at the intersection of the rays of the true
//   poses, because a track may contain wrong observations. Those of the full
//   oracle start at the truth. There is no minimum triangulation angle.

// Errors of the rig extrinsics after alignment.
struct RigErrors {
  std::string sensor;
  double rotation_deg = 0.0;
  double position_m = 0.0;       // of the camera in the frame of the reference
  double true_distance_m = 0.0;  // from the reference
};

struct ModelErrors {
  int num_images = 0;
  int num_registered = 0;
  // nullopt if no image is registered.
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

// `options` are those of the mapper.
OracleResult SolveOracle(const Simulation& simulation, const MapperModel& model,
                         const BundleAdjustmentOptions& options,
                         const Context& context);
OracleResult SolveFullOracle(const Simulation& simulation, double loss_scale_px,
                             const BundleAdjustmentOptions& options,
                             const Context& context);

// The true tracks in the verified matches, see above.
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
