// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Errors of the lens model, delays and rolling shutters move all observations
// in a part of an image alike. Such residuals bias intrinsics, which
// independent noise would average out.
//
// Per camera: the factor by which the variance of smooth functions of the image
// exceeds that of independent residuals, at least 1:
//
//   sum over cells |sum over o in cell w_o r_o|^2 / sum over o |w_o r_o|^2
//
// with cells of a quarter of the larger image side, as intrinsics change the
// image no faster, and w_o the weight of the Cauchy loss of this scale.
std::vector<double> OverdispersionOfCameras(const Scene& scene,
                                            const Reconstruction& model,
                                            double loss_scale_px);

}  // namespace mgsfm
