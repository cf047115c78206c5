// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Calibrates the lenses of cameras without a prior jointly, from the epipolar
// geometry of all image pairs.
//
// Unknowns: per camera c, the logarithm of the factor on its focal lengths, the
// distortion of the division model if its model is SIMPLE_RADIAL with zero
// distortion, and its principal point (together s_c); and the essential matrix
// E_k of each pair k. Objective:
//
//   min over s, E:  sum_k sum_i rho(e_ki^2 / v_ki) + sum_c |s_c|^2_P,
//                   e = f2^T E_k f1
//
// with f1, f2 the rays of a match, which depend on s; v the variance of e for
// independent pixel errors of unit variance, so that residuals are Sampson
// distances in pixels for every camera model; rho the Cauchy loss with a scale
// of one pixel; P a prior of distortion and principal point, so that their
// uncertainty propagates to focal lengths. The result keeps the initial
// principal points. Cameras with a prior are fixed.
//
// Derivatives of v with respect to distortion and principal point are
// neglected, because they bias the estimate.
//
// Initialization: the best of 15 factors from 0.4 to 2.5 and four distortions
// per camera, over pairs within the camera or with known cameras, with E
// refined for each candidate. Then Gauss-Newton over all unknowns with the E_k
// eliminated. It stops if max |ds| < 1e-3, if five halvings of a step do not
// decrease the cost, or after 20 steps. Pairs with a median residual above
// three times the median of pairs are dropped; the minimization is repeated.
//
// Some motions do not constrain focal lengths: translation along the optical
// axis or sideways without rotation, and a camera whose optical axis stays in a
// plane, as on a flat road. The standard deviation of the log factor is the
// larger of two estimates: from the noise of the residuals, with pairs of one
// image taken as fully dependent, and from the disagreement between pairs
// (sandwich). If it exceeds max_sigma or the log factor leaves the range, the
// estimate is not accepted, and `message` gives the reason. The camera still
// starts at this estimate if it is more certain than a guess (a lens of 30 to
// 120 degrees). The stated standard deviation adds the errors that all pairs
// share, as measured on recorded rigs.
//
// Source: Sweeney, Sattler, Hollerer, Turk, Pollefeys: Optimizing the viewing
// graph for structure-from-motion, ICCV 2015; Kanatani, Matsunaga: Closed-form
// expression for focal lengths from the fundamental matrix, ACCV 2000
// (degenerate motions); Fitzgibbon: Simultaneous linear estimation of multiple
// view geometry and lens distortion, CVPR 2001 (division model).
//
// Cost: linear in at most max_num_pairs pairs per camera and 200 matches per
// pair.
struct FocalLengthOptions {
  Option<bool> calibrate{
      "calibrate", true,
      "Estimate focal lengths without a prior from image pairs before relative "
      "poses, and then lenses from reconstructions of some frames."};
  // Maximum relative standard deviation of an accepted estimate of a focal
  // length. Less certain ones are only a start.
  double max_sigma = 0.01;
  // Maximum number of image pairs per camera, selected at equal spacing.
  // Decrease it to save time.
  int max_num_pairs = 100;
  Option<bool> select_camera_model{
      "select_camera_model", true,
      "Replace SIMPLE_RADIAL, the default of feature extraction, by RADIAL for "
      "cameras without calibration whose images need a second radial "
      "parameter. 0 keeps the models of the database."};
  // Maximum number of preliminary reconstructions from some of the frames. Each
  // verifies image pairs with the lenses of the previous one.
  int max_num_rounds = 4;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(calibrate, select_camera_model);
  }
};

// The standard deviation of the logarithm of a guess: fields of view of 30 to
// 120 degrees are equally likely. A more certain estimate is a better start
// even if it is not accepted.
constexpr double kSigmaOfFocalLengthGuess = 0.4;
// The standard deviation of principal points, in larger image sides: those of
// recorded cameras are off by 1 to 3 %.
constexpr double kSigmaOfPrincipalPoint = 0.02;
// The logarithm of the largest factor on focal lengths that is searched.
// Farther from the known value, the linearization of a measurement is invalid,
// and the motion does not determine a focal length.
inline const double kMaxLogFocalFactor = std::log(2.5);

struct FocalLengthEstimate {
  int camera_idx = 0;
  double prior_px = 0.0;               // initial value
  std::optional<double> estimated_px;  // nullopt: not accepted
  // Relative standard deviation with errors that all pairs share; nullopt
  // without pairs, or if the estimate left the range.
  std::optional<double> sigma;
  int num_pairs = 0;
  std::string message;  // reason of a rejection

  auto Fields() const {
    return Named("camera_id", As<Item::kCameraId>(camera_idx), "prior_px",
                 prior_px, "estimated_px", estimated_px, "relative_sigma",
                 sigma, "num_pairs", num_pairs, "message", message);
  }
};

struct FocalLengthResult {
  std::vector<Camera> cameras;  // the scene's cameras with the estimates
  std::vector<FocalLengthEstimate> estimates;  // per camera without a prior
};

[[nodiscard]] FocalLengthResult CalibrateFocalLengths(
    const Scene& scene, const ViewGraph& view_graph,
    const FocalLengthOptions& options, const Context& context);

// A focal length measured from image pairs, relative to the value in the scene.
struct FocalLengthMeasurement {
  int camera_idx = 0;
  double log_factor = 0.0;
  double sigma = 0.0;  // of log_factor
  int num_pairs = 0;
};

// Measures the focal lengths of all cameras, with or without a prior, as a
// check: Gauss-Newton as above, starting at the values of the scene. Cameras
// with fewer than three consistent pairs are excluded.
[[nodiscard]] std::vector<FocalLengthMeasurement> MeasureFocalLengths(
    const Scene& scene, const ViewGraph& view_graph, int max_num_pairs,
    const Context& context);

// Removes geometry that depends on estimated lenses: E and the relative poses
// of pairs with a camera without prior focal length. F and H are kept.
[[nodiscard]] ViewGraph DropUncalibratedGeometry(const Scene& scene,
                                                 const ViewGraph& view_graph);

}  // namespace mgsfm
