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

// Multi-camera bundle adjustment (section 3.5 of MGSfM, eq. 20), over frame
// poses, internal poses, points and, if asked, intrinsics:
//
//   min 1/2 sum_o rho(|Project(K, S R (p - c) + t) - x_o|^2)
//     + 1/2 sum_f ((f - f_given) / (sigma_f f_given))^2                    (1)
//     + 1/2 sum_k (|Log(S S_given^T)|^2 / sigma_R^2
//                  + |t - t_given|^2 / sigma_t^2)
//     + 1/2 sum_i rho_g((c_i - g_i)^T C_i^-1 (c_i - g_i))
//     + 1/2 sum_j rho_g(|S R down - u_j|^2 / sigma_u^2)
//
// R, c: rotation and centre of the frame; S, t: sensor_from_rig, the constant
// identity for the reference sensor; rho: Huber, in pixels. The second sum is
// over refined focal lengths: a straight drive does not determine them, and
// must not spoil them; sigma_f is larger where the given value is not trusted.
// The third is over refined
// sensors whose pose was given; sigma_t is a part of the largest given |t| of
// the rig. The fourth is over images with a measured position g_i, of
// covariance C_i, of their centre c_i, in the world of the model; rho_g:
// Cauchy. The last is over images with measured gravity u_j, if it was.
//
// Gauge. The frame with the most observations is held; with measured gravity
// its centre, and by a weak term its heading. Scale is held by the
// largest coordinate of the offset of a frame at a typical distance, or of an
// internal translation, unless two sensors of one frame are held, or by their
// priors, at different places: then scale is observable, and known extrinsics
// keep the model metric.
// Nothing is held if frames (all, or some that FixedPoses names) or points are,
// or if positions are measured.
//
// Method: Levenberg-Marquardt with analytic derivatives; points are eliminated
// first; the rest is a sparse Cholesky factorisation of the frames, with the
// internal poses and intrinsics as border. Ends when the relative change of
// the cost is at most function_tolerance. The same to the last bit for every
// number of threads. Cost of an iteration: linear in the observations, for each
// point the square of the number of frames that see it, and the factorisation.

enum class RefineMode {
  kAuto,  // what is not known beforehand
  kYes,
  kNo,
};

template <>
struct EnumTable<RefineMode> {
  static constexpr std::pair<std::string_view, RefineMode> kNames[] = {
      {"auto", RefineMode::kAuto},
      {"yes", RefineMode::kYes},
      {"no", RefineMode::kNo},
      {"1", RefineMode::kYes},  // as COLMAP's flags have it
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
          "Solver: that of this program, or Ceres with the same derivatives, "
          "for comparison.");
    visit("max_num_iterations", self.max_num_iterations, AtLeast(1),
          "iterations", "Most iterations of one solve.");
    visit("function_tolerance", self.function_tolerance, Between(0.0, 1.0), "",
          "A solve ends when the cost changes by less than this part.");
    visit("loss_scale", self.loss_scale_px, GreaterThan(0.0), "px",
          "Reprojection errors above count linearly, not squared.");
    visit("loss_sigma_factor", self.loss_sigma_factor, GreaterThan(0.0), "",
          "Lowers loss_scale to so many standard deviations of the noise of "
          "keypoints, once points were triangulated anew.");
    visit("refine_rig_from_world", self.refine_rig_from_world, AnyValue(), "",
          "Refine the poses of frames.");
    visit("refine_sensor_from_rig", self.refine_sensor_from_rig, AnyValue(), "",
          "Refine the poses of cameras in the rig; auto: those that were not "
          "given; yes: given ones, too, near what was given.");
    visit("refine_points", self.refine_points, AnyValue(), "",
          "Refine 3D points.");
    visit("refine_focal_length", self.refine_focal_length, AnyValue(), "",
          "Refine focal lengths; auto: those without a prior.");
    visit("refine_principal_point", self.refine_principal_point, AnyValue(), "",
          "Refine principal points.");
    visit("refine_extra_params", self.refine_extra_params, AnyValue(), "",
          "Refine distortion parameters; auto: of cameras without a prior "
          "focal length.");
    DescribePriors(self, visit);
    visit("num_rounds", self.num_rounds, AtLeast(0), "rounds",
          "Rounds of triangulating all points anew and solving.");
    visit(
        "error_sigma_factor", self.error_sigma_factor, GreaterThan(0.0), "",
        "Observations with more than so many standard deviations of the noise "
        "of keypoints are outliers.");
    visit("min_max_error", self.min_max_error_px, GreaterThan(0.0), "px",
          "Reprojection errors up to this are never outliers.");
    visit("max_max_error", self.max_max_error_px, GreaterThan(0.0), "px",
          "Larger reprojection errors are outliers in the last round; in each "
          "round before, twice as much is allowed.");
    DescribePoints(self, visit);
  }

 private:
  template <class Self, class Visitor>
  static void DescribePoints(Self& self, Visitor& visit) {
    visit("min_triangulation_angle_deg", self.min_triangulation_angle_deg,
          Between(0.0, 90.0), "deg",
          "Points whose rays all span less are dropped.");
    visit("min_two_view_angle_deg", self.min_two_view_angle_deg,
          Between(0.0, 90.0), "deg",
          "The same for points with two observations.");
    visit("min_num_observations", self.min_num_observations, AtLeast(2),
          "observations", "Points with fewer are dropped.");
    visit("min_track_share", self.min_track_share, Between(0.0, 1.0), "",
          "Points that fewer of the images of their track agree with are "
          "dropped: most are on things that move.");
    visit("max_relative_distance", self.max_relative_distance, AtLeast(0.0), "",
          "Points more than so many median distances away from all of their "
          "cameras are dropped: a vehicle alongside looks as if it were "
          "infinitely far, and turns the rig; 0 keeps them.");
    visit("min_two_view_relative_distance", self.min_two_view_relative_distance,
          Between(0.0, 1.0), "",
          "Points with two observations less than so many median distances "
          "away from one of their cameras are dropped: nearly all are wrong "
          "matches, and so near they hold the frame where it is.");
    visit("min_num_observations_per_frame", self.min_num_observations_per_frame,
          AtLeast(0), "observations",
          "Frames with fewer are reported as weak.");
  }

  template <class Self, class Visitor>
  static void DescribePriors(Self& self, Visitor& visit) {
    visit("focal_length_prior_sigma", self.focal_length_prior_sigma,
          GreaterThan(0.0), "",
          "Relative standard deviation of prior focal lengths, where these are "
          "refined.");
    visit("focal_length_start_sigma", self.focal_length_start_sigma,
          GreaterThan(0.0), "",
          "The same of those without a prior, of the value that refinement "
          "starts from: keeps what the motion does not tell from wandering.");
    visit("max_focal_length_sigma", self.max_focal_length_sigma,
          GreaterThan(0.0), "",
          "Refined focal lengths that the images tell with a larger relative "
          "standard deviation are reported as not observable.");
    visit("min_focal_length_ratio", self.min_focal_length_ratio,
          GreaterThan(0.0), "",
          "Refined focal lengths below this part of the larger side of the "
          "image are reported as not plausible.");
    visit("max_focal_length_ratio", self.max_focal_length_ratio,
          GreaterThan(0.0), "", "The same of those above.");
    visit("max_extra_param", self.max_extra_param, GreaterThan(0.0), "",
          "The same of refined distortion parameters whose magnitude is "
          "above.");
    visit("sensor_from_rig_prior_sigma_deg",
          self.sensor_from_rig_prior_sigma_deg, GreaterThan(0.0), "deg",
          "Standard deviation of given rotations of cameras in the rig, where "
          "these are refined.");
    visit("sensor_from_rig_prior_sigma", self.sensor_from_rig_prior_sigma,
          GreaterThan(0.0), "",
          "The same of given translations, as a part of the largest given in "
          "the rig.");
    visit("prior_position_loss_scale", self.prior_position_loss_scale,
          GreaterThan(0.0), "standard deviations",
          "Measured positions that are farther off count less and less.");
  }
};

// What happened between two solves.
struct BundleRound {
  double sigma_px = 0.0;      // noise of a coordinate of the keypoints
  double max_error_px = 0.0;  // threshold that follows
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
  // Points are triangulated anew in all but the first and the last, which only
  // filter.
  std::vector<BundleRound> rounds;
  std::vector<DroppedFrame> dropped_frames;  // had a pose at the start
  std::vector<int> weak_frame_idxs;          // kept, but hardly constrained
  // Kept their initial pose, as nothing was left to refine it.
  std::vector<int> sensor_idxs_without_observations;
  // Left out of the solves, as their camera could not see the point.
  size_t num_invisible_observations = 0;
};

struct BundleResult {
  Reconstruction estimate;
  BundleSummary summary;
};

// Poses that stay as they are, whatever the options say. Empty: none.
struct FixedPoses {
  Mask frames;   // per frame of the scene
  Mask sensors;  // per sensor of the scene
};

// One solve of (1), all blocks together. Keypoints in images without pose and
// points with fewer than two usable observations have no part in it. If the
// solve fails the estimate is the initial one.
[[nodiscard]] BundleResult AdjustBundle(const Scene& scene,
                                        const Reconstruction& initial,
                                        const BundleAdjustmentOptions& options,
                                        const Context& context,
                                        const BundlePriors& priors = {},
                                        const FixedPoses& held = {});

// Groups of keypoints that may be images of one point, at most one keypoint of
// an image in each, as far as a model can tell whose observations have errors
// up to max_error_px.
using CandidateSource = std::function<ObservationGroups(
    const Reconstruction& model, double max_error_px)>;

// The same groups for every model.
inline CandidateSource FixedCandidates(ObservationGroups groups) {
  return [groups = std::move(groups)](const Reconstruction&, double) {
    return groups;
  };
}

// The whole stage:
//   1. drop gross outliers; solve with rotations and intrinsics held;
//   2. num_rounds times: solve; triangulate all groups that `candidates`
//      gives anew
//      with the present poses, which drops outliers, completes, merges and
//      splits points. What less than min_track_share of a group agrees with is
//      no point: the two cameras of a stereo pair agree on where a vehicle is,
//      but no two frames do;
//   3. solve to function_tolerance (the solves before end at 100 times of it);
//   4. drop outliers, points with too little parallax, farther away than
//      max_relative_distance median distances, or of two observations and
//      nearer than min_two_view_relative_distance, and frames that no
//      observation is left of, unless their poses are held.
// Error thresholds are error_sigma_factor standard deviations of the noise of
// keypoints, from the median of the errors and what points took of them, within
// bounds that tighten from round to round. So is the threshold of the loss from
// the first triangulation on, as keypoints of sharp images are far better than
// a pixel, and wrong matches within it would bias weakly observed quantities,
// such as the internal translations of a standing rig. Points that are in no
// group only lose outliers. If a solve fails, the estimate is that before it.
[[nodiscard]] BundleResult RefineReconstruction(
    const Scene& scene, const CandidateSource& candidates,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context, const BundlePriors& priors = {},
    const FixedPoses& held = {});

// The triangulation of 2. by itself, with max_max_error_px as threshold: for
// models without points, or with new frames.
[[nodiscard]] Reconstruction TriangulateCandidates(
    const Scene& scene, const CandidateSource& candidates,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context);

}  // namespace mgsfm
