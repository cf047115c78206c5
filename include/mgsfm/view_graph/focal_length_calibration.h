// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Focal lengths of cameras without a prior, from the epipolar geometry of all
// pairs at once. Let s_c be the logarithm of the factor by which the focal
// lengths of camera c are to be multiplied, E_k the essential matrix of pair k.
//
//   min over s, E:  sum_k sum_i rho(e_ki^2 / v_ki),   e = f2^T E_k f1
//
// f1, f2: rays of a match by the cameras with s; v: the variance of e for
// independent pixel errors of variance one, so that a residual is the distance
// in pixels to a match that agrees (Sampson), for every camera model; rho:
// Cauchy, one pixel. Cameras with a prior are held, and so are principal points
// and distortions.
//
// Start: for each camera the best of 15 factors from 0.4 to 2.5, by pairs
// within it or with known cameras, each with its E refined. Then Gauss-Newton
// in all unknowns, the E_k eliminated; ends when no s changes by 1e-5, or after
// 20 steps. Pairs that then fit three times worse than the median pair are left
// out, and it is done again.
//
// Some motions do not tell focal lengths: views that move along their axis, or
// side by side, without turning; or one camera whose axis stays in a plane, as
// on a flat road. The standard deviation of s is the larger of
// that by the noise of residuals, with pairs of one image taken for dependent,
// and that by how much pairs disagree (sandwich). Where it is above max_sigma,
// or s runs out of the range, the camera keeps what it had, and says so.
// Cf. Sweeney, Sattler, Hollerer, Turk, Pollefeys 2015 (view graphs); Kanatani,
// Matsunaga 2000 (degenerate motions).
//
// Cost: linear in at most max_num_pairs pairs of a camera and 200 matches of
// each.
struct FocalLengthOptions {
  bool calibrate = true;
  double max_sigma = 0.01;
  int max_num_pairs = 300;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("calibrate", self.calibrate, AnyValue(), "",
          "Estimate focal lengths of cameras without a prior from all image "
          "pairs, before anything else.");
    visit("max_sigma", self.max_sigma, GreaterThan(0.0), "",
          "Cameras whose focal length comes out with a larger relative "
          "standard deviation keep the given one.");
    visit("max_num_pairs", self.max_num_pairs, AtLeast(1), "pairs",
          "Of each camera at most so many pairs are used, evenly spread.");
  }
};

struct FocalLengthEstimate {
  int camera_idx = 0;
  double prior_px = 0.0;
  std::optional<double> estimated_px;  // nullopt: keeps the given one
  double sigma = 0.0;                  // relative; 0 if it is not known
  int num_pairs = 0;
  std::string message;  // why there is no estimate
};

struct FocalLengthResult {
  std::vector<Camera> cameras;  // of the scene, with the estimates
  std::vector<FocalLengthEstimate> estimates;  // of those without a prior
};

[[nodiscard]] FocalLengthResult CalibrateFocalLengths(
    const Scene& scene, const ViewGraph& view_graph,
    const FocalLengthOptions& options, const Context& context);

// Without what was computed with focal lengths that changed: E and relative
// poses of pairs of these cameras. F and H stay.
[[nodiscard]] ViewGraph DropCalibratedGeometry(
    const Scene& scene, const FocalLengthResult& focal_lengths,
    const ViewGraph& view_graph);

}  // namespace mgsfm
