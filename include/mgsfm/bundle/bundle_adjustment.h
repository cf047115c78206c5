// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/bundle/bundle_priors.h"
#include "mgsfm/least_squares/backend.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"

namespace mgsfm {

// Bundle adjustment of rigs (MGSfM, section 3.5, eq. 20).
//
// Unknowns: frame poses, rig extrinsics, points and, if enabled, intrinsics.
// R, c are rotation and centre of a frame; S, t are sensor_from_rig, constant
// identity for the reference sensor; f are focal lengths.
//
// Objective:
//
//   min 1/2 sum_o rho(|Project(K, S R (p - c) + t) - x_o|^2)
//     + 1/2 sum_f ((f - f_0) / (sigma_f f_0))^2                            (1)
//     + 1/2 sum_k (|Log(S S_0^T)|^2 / sigma_R^2 + |t - t_0|^2 / sigma_t^2)
//     + 1/2 sum_i rho_g((c_i - g_i)^T C_i^-1 (c_i - g_i))
//     + 1/2 sum_j rho_g(|S R down - u_j|^2 / sigma_u^2)
//
// - Observations o. rho is Huber, in pixels.
// - Refined focal lengths f, with the value f_0 of the scene. A straight drive
//   does not determine them. sigma_f is larger if f_0 is not a prior.
// - Refined sensors k with prior extrinsics S_0, t_0. sigma_t is a fraction of
//   the largest prior |t_0| of the rig.
// - Images i with a measured position g_i (covariance C_i) of their centre c_i.
//   rho_g is Cauchy.
// - Images j with a measured direction of gravity u_j.
//
// Gauge. The frame with the most observations is fixed. With gravity terms, its
// centre is fixed, and a weak term fixes its heading. Scale is fixed through
// one coordinate: the largest among the offset of a distant frame (75 %
// quantile) and the sensor translations. Exceptions:
// - Scale is free if two sensors of a frame are fixed, or have priors, at
//   different centres: known extrinsics determine it.
// - Nothing is fixed in addition if any frame is fixed by FixedPoses, if all
//   frames or all points are constant, or if there are position priors.
//
// Method: Levenberg-Marquardt with analytic derivatives. Points are eliminated
// first (Schur complement), frames by sparse Cholesky factorisation, extrinsics
// and intrinsics last.
//
// Stopping criterion of a solve: |cost - new cost| <= function_tolerance cost;
// src/least_squares/rig_solver.h has the others.
//
// Cost of an iteration: linear in the observations, for each point quadratic in
// the number of frames that observe it, and the factorisation. Results are the
// same to the last bit for every number of threads.

enum class RefineMode {
  kAuto,  // refine parameters without a prior value
  kYes,
  kNo,
};

template <>
struct EnumTable<RefineMode> {
  static constexpr std::pair<std::string_view, RefineMode> kNames[] = {
      {"auto", RefineMode::kAuto},
      {"yes", RefineMode::kYes},
      {"no", RefineMode::kNo},
      {"1", RefineMode::kYes},  // COLMAP uses 0 and 1
      {"0", RefineMode::kNo}};
};

struct BundleAdjustmentOptions {
  SolverBackend backend = SolverBackend::kNative;
  int max_num_iterations = 100;
  double function_tolerance = 1e-6;
  double loss_scale_px = 1.0;
  double loss_sigma_factor = 1.345;
  bool refine_rig_from_world = true;
  RefineMode refine_sensor_from_rig = RefineMode::kAuto;
  bool refine_points = true;
  RefineMode refine_focal_length = RefineMode::kAuto;
  bool refine_principal_point = false;
  RefineMode refine_extra_params = RefineMode::kAuto;
  double focal_length_prior_sigma = 1e-3;
  double focal_length_start_sigma = 0.2;
  double max_focal_length_sigma = 0.01;
  double min_focal_length_ratio = 0.1;
  double max_focal_length_ratio = 10.0;
  double max_extra_param = 1.0;
  double sensor_from_rig_prior_sigma_deg = 0.1;
  double sensor_from_rig_prior_sigma = 0.01;
  double prior_position_loss_scale = 2.8;

  int num_rounds = 3;
  double error_sigma_factor = 4.0;
  double min_max_error_px = 0.5;
  double max_max_error_px = 4.0;
  double min_triangulation_angle_deg = 1.0;
  double min_two_view_angle_deg = 2.0;
  int min_num_observations = 2;
  double min_track_share = 0.75;
  double max_relative_distance = 40.0;
  double min_two_view_relative_distance = 0.1;
  int min_num_observations_per_frame = 6;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("backend", self.backend, AnyValue(), "",
          "native is this library's solver, ceres uses Ceres with the same "
          "derivatives. For comparison.");
    visit("max_num_iterations", self.max_num_iterations, AtLeast(1),
          "iterations", "Maximum number of iterations of one solve.");
    visit("function_tolerance", self.function_tolerance, Between(0.0, 1.0), "",
          "A solve has converged when the relative change of the cost is at "
          "most this.");
    visit("loss_scale", self.loss_scale_px, GreaterThan(0.0), "px",
          "Threshold of the Huber loss of reprojection errors.");
    visit("loss_sigma_factor", self.loss_sigma_factor, GreaterThan(0.0), "",
          "Upper bound of loss_scale in standard deviations of the keypoint "
          "noise, after the first triangulation. 1.345 is 95 % efficient for "
          "normal noise.");
    visit("refine_rig_from_world", self.refine_rig_from_world, AnyValue(), "",
          "Refine frame poses.");
    visit("refine_sensor_from_rig", self.refine_sensor_from_rig, AnyValue(), "",
          "Refine sensor_from_rig. auto: sensors without a prior. yes: all; "
          "sensors with a prior stay near it.");
    visit("refine_points", self.refine_points, AnyValue(), "",
          "Refine 3D points.");
    visit("refine_focal_length", self.refine_focal_length, AnyValue(), "",
          "Refine focal lengths. auto: those without a prior.");
    visit("refine_principal_point", self.refine_principal_point, AnyValue(), "",
          "Refine principal points.");
    visit("refine_extra_params", self.refine_extra_params, AnyValue(), "",
          "Refine distortion parameters. auto: of cameras without a prior "
          "focal length.");
    DescribePriors(self, visit);
    visit("num_rounds", self.num_rounds, AtLeast(0), "rounds",
          "Number of rounds of a solve and a triangulation of all points.");
    visit("error_sigma_factor", self.error_sigma_factor, GreaterThan(0.0), "",
          "Observations with a reprojection error above this many standard "
          "deviations of the keypoint noise are outliers.");
    visit("min_max_error", self.min_max_error_px, GreaterThan(0.0), "px",
          "Observations with a reprojection error below this are inliers.");
    visit("max_max_error", self.max_max_error_px, GreaterThan(0.0), "px",
          "Observations with a reprojection error above this are outliers in "
          "the last round. The bound doubles for each earlier round.");
    DescribePoints(self, visit);
  }

 private:
  template <class Self, class Visitor>
  static void DescribePoints(Self& self, Visitor& visit) {
    visit("min_triangulation_angle_deg", self.min_triangulation_angle_deg,
          Between(0.0, 90.0), "deg",
          "Points with a smaller triangulation angle are removed.");
    visit("min_two_view_angle_deg", self.min_two_view_angle_deg,
          Between(0.0, 90.0), "deg",
          "The same bound for points with two observations.");
    visit("min_num_observations", self.min_num_observations, AtLeast(2),
          "observations", "Points with fewer observations are removed.");
    visit("min_track_share", self.min_track_share, Between(0.0, 1.0), "",
          "Points are removed if a smaller share of the images of their track "
          "are inliers. Most of these are on moving objects.");
    visit("max_relative_distance", self.max_relative_distance, AtLeast(0.0), "",
          "Points farther from all of their cameras, in median distances, are "
          "removed. A vehicle alongside appears infinitely far and biases the "
          "rotation of the rig. 0 disables the test.");
    visit("min_two_view_relative_distance", self.min_two_view_relative_distance,
          Between(0.0, 1.0), "",
          "Points with two observations nearer to one of their cameras, in "
          "median distances, are removed. Most are wrong matches, and near "
          "points constrain the frame strongly.");
    visit("min_num_observations_per_frame", self.min_num_observations_per_frame,
          AtLeast(0), "observations",
          "Frames with fewer observations are reported as weak.");
  }

  template <class Self, class Visitor>
  static void DescribePriors(Self& self, Visitor& visit) {
    visit("focal_length_prior_sigma", self.focal_length_prior_sigma,
          GreaterThan(0.0), "",
          "Relative standard deviation of prior focal lengths that are "
          "refined.");
    visit("focal_length_start_sigma", self.focal_length_start_sigma,
          GreaterThan(0.0), "",
          "The same for initial focal lengths that are not priors. It keeps "
          "a focal length near its initial value if the motion does not "
          "determine it.");
    visit("max_focal_length_sigma", self.max_focal_length_sigma,
          GreaterThan(0.0), "",
          "Refined focal lengths with a larger relative standard deviation are "
          "reported as unobservable.");
    visit("min_focal_length_ratio", self.min_focal_length_ratio,
          GreaterThan(0.0), "",
          "Refined focal lengths below this multiple of the larger image side "
          "are reported as implausible.");
    visit("max_focal_length_ratio", self.max_focal_length_ratio,
          GreaterThan(0.0), "", "The same for focal lengths above.");
    visit("max_extra_param", self.max_extra_param, GreaterThan(0.0), "",
          "The same for refined distortion parameters of larger magnitude.");
    visit("sensor_from_rig_prior_sigma_deg",
          self.sensor_from_rig_prior_sigma_deg, GreaterThan(0.0), "deg",
          "Standard deviation of prior rotations of sensor_from_rig that are "
          "refined.");
    visit("sensor_from_rig_prior_sigma", self.sensor_from_rig_prior_sigma,
          GreaterThan(0.0), "",
          "The same for prior translations, as a fraction of the largest one "
          "in the rig.");
    visit("prior_position_loss_scale", self.prior_position_loss_scale,
          GreaterThan(0.0), "standard deviations",
          "Threshold of the Cauchy loss of measured positions. 2.8 is the 95 % "
          "quantile of normal noise.");
  }
};

// The points and observations before and after a step between two solves.
struct BundleRound {
  double sigma_px = 0.0;      // noise of each coordinate of the keypoints
  double max_error_px = 0.0;  // the resulting bound for outliers
  size_t num_points_before = 0;
  size_t num_points_after = 0;
  size_t num_observations_before = 0;
  size_t num_observations_after = 0;
};

struct DroppedFrame {
  int frame_idx = 0;
  std::string reason;
};

struct BundleSummary {
  std::vector<SolveSummary> solves;
  // The first and the last only filter points, the others retriangulate them.
  std::vector<BundleRound> rounds;
  std::vector<DroppedFrame> dropped_frames;  // had an initial pose
  std::vector<int> weak_frame_idxs;          // kept with few observations
  std::vector<int> sensor_idxs_without_observations;  // kept their initial pose
  // Observations ignored by the last solve: the camera cannot see the point.
  size_t num_invisible_observations = 0;
};

struct BundleResult {
  Reconstruction estimate;
  BundleSummary summary;
};

// Poses that are constant regardless of the options. Empty: none.
struct FixedPoses {
  Mask frames;   // per frame of the scene
  Mask sensors;  // per sensor of the scene
};

// One solve of (1) over all parameters. Ignores observations in images without
// a pose, and points with fewer than two usable observations. If the solve
// fails, the estimate is the initial one.
[[nodiscard]] BundleResult AdjustBundle(const Scene& scene,
                                        const Reconstruction& initial,
                                        const BundleAdjustmentOptions& options,
                                        const Context& context,
                                        const BundlePriors& priors = {},
                                        const FixedPoses& fixed = {});

// Returns groups of keypoints that can be observations of one point. The model,
// with reprojection errors up to max_error_px, helps to separate points. A
// group has at most one keypoint per image.
using CandidateSource = std::function<ObservationGroups(
    const Reconstruction& model, double max_error_px)>;

// Returns the same groups for every model.
inline CandidateSource FixedCandidates(ObservationGroups groups) {
  return [groups = std::move(groups)](const Reconstruction&, double) {
    return groups;
  };
}

// The complete stage:
//   1. Remove gross outliers. Solve with constant rotations and intrinsics.
//   2. num_rounds times: solve, then triangulate all groups of `candidates`
//      again with the present poses. This rejects outliers and completes,
//      merges and splits points. A point needs min_track_share of its group:
//      the two cameras of a stereo pair agree on the position of a moving
//      vehicle, but no two frames do.
//   3. Solve to function_tolerance. Earlier solves use 100 times that.
//   4. Remove outliers, points with too small a triangulation angle or too
//      large a distance, and points of two observations near a camera. Drop
//      frames without observations, unless they are fixed.
//
// The bound for outliers is error_sigma_factor standard deviations of the
// keypoint noise, clamped to limits that tighten from round to round. The noise
// is a robust estimate from reprojection errors, corrected for the degrees of
// freedom of the points. It also bounds the scale of the loss after the first
// triangulation: sharp images have far less than a pixel of noise, and wrong
// matches within a pixel would bias weakly observed parameters, such as the
// sensor translations of a standing rig.
//
// Points in no group only lose outliers. If a solve fails, the estimate is the
// one before it.
[[nodiscard]] BundleResult RefineReconstruction(
    const Scene& scene, const CandidateSource& candidates,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context, const BundlePriors& priors = {},
    const FixedPoses& fixed = {});

// Step 2's triangulation alone, with max_max_error_px as bound. For models
// without points or with new frames.
[[nodiscard]] Reconstruction TriangulateCandidates(
    const Scene& scene, const CandidateSource& candidates,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context);

}  // namespace mgsfm
