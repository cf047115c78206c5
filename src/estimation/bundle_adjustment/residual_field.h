// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Errors of the lens model, delays and rolling shutters move all observations
// in a part of an image alike. Such residuals bias intrinsics, which
// independent noise would average out. Points, poses and the other intrinsics
// absorb such errors, so that only part of them remains in the residuals.
struct Overdispersion {
  double of_residuals = 1.0;  // at least 1
  double of_lens = 0.0;
};

// Per camera: the factors by which the variance of smooth functions of the
// image exceeds that of independent residuals, due to the residuals,
//
//   sum over cells |sum over o in cell w_o r_o|^2 / sum over o |w_o r_o|^2,
//
// and due to independent lens errors of the usual size a in each cell,
//
//   a^2 sum over cells (sum over o in cell w_o)^2 / sum over o |w_o r_o|^2,
//
// with cells of a quarter of the larger image side, because intrinsics change
// the image no faster, and w_o the weight of the Cauchy loss of this scale.
std::vector<Overdispersion> OverdispersionOfCameras(const Scene& scene,
                                                    const Reconstruction& model,
                                                    double loss_scale_px);

// Standard deviations of intrinsics, per camera of the scene and parameter.
struct IntrinsicSigmas {
  std::vector<std::vector<double>> of_residuals;
  std::vector<std::vector<double>> total;  // with the errors of lenses
};

// Computes the ComputeIntrinsicSigmas() of uncertainty.h with both factors.
std::optional<IntrinsicSigmas> ComputeAllIntrinsicSigmas(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

// Adds lens errors to the standard deviations of focal lengths. `model` is
// adjusted with these options and priors.
void AddLensErrors(const Scene& scene, const Reconstruction& model,
                   const BundleAdjustmentOptions& options,
                   const Context& context, const BundlePriors& priors,
                   std::vector<FocalLengthCheck>* checks);

}  // namespace mgsfm
