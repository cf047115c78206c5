// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

struct SeamUncertainty {
  double sigma_position = 0.0;
  double sigma_rotation_deg = 0.0;
};

// The uncertainty of one side of a seam against the other, both rigid.
//
// An observation with unit ray u and distance d measures its point X with the
// information W = (I - u u^T) / (d sigma)^2, where sigma is the noise of rays.
// With A and B the sums of W over the observations of one point on either side,
// eliminating X leaves the information of the relative position of its two
// copies, the parallel sum
//
//   P = B - B (A + B)^-1 B.
//
// A motion (w, t) of the side B about the centre c of `frame_idx` moves its
// copy by w x (X - c) + t, so that all points together give the information
//
//   sum J^T P J,   J = [-[X - c]_x, I].
//
// Its inverse is the covariance of (w, t). nullopt if it is singular. The noise
// is estimated from the residuals of the points. Cost: linear in the
// observations of the model.
std::optional<SeamUncertainty> EstimateSeamUncertainty(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<int>& frame_idxs_of_side, int frame_idx);

}  // namespace mgsfm
