// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Bundle adjustment of rigs (MGSfM, section 3.5, eq. 20).
//
// Unknowns: frame poses, rig extrinsics, points and, if enabled, intrinsics.
// R, c are rotation and center of a frame; S, t are sensor_from_rig, constant
// identity for the reference sensor; f are focal lengths.
//
// Objective:
//
//   min 1/2 sum_o rho_n(|Project(K, S R (p - c) + t) - x_o|^2)
//     + 1/2 sum_f ((f - f_0) / (sigma_f f_0))^2                            (1)
//     + 1/2 sum_k (|Log(S S_0^T)|^2 / sigma_R^2 + |t - t_0|^2 / sigma_t^2)
//     + 1/2 sum_i rho_g((c_i - g_i)^T C_i^-1 (c_i - g_i))
//     + 1/2 sum_j rho_g(|S R down - u_j|^2 / sigma_u^2)
//
// - Observations o of points with n observations. rho_n is Cauchy, with the
//   scale a sqrt((2n - 3) / (2n)) in pixels: a point absorbs 3 of the degrees
//   of freedom of its residuals.
// - Refined focal lengths f, with the value f_0 of the scene. A straight drive
//   does not determine them. sigma_f is larger if f_0 is not a prior.
// - Refined sensors k with prior extrinsics S_0, t_0. sigma_t is a fraction of
//   the largest prior |t_0| of the rig.
// - Images i with a measured position g_i (covariance C_i) of their center c_i.
//   rho_g is Cauchy.
// - Images j with a measured direction of gravity u_j.
//
// Gauge. The frame with the most observations is fixed. With gravity terms, its
// center is fixed, and a weak term fixes its heading. Scale is fixed through
// one coordinate: the largest among the offset of a distant frame (75 %
// quantile) and the sensor translations. Exceptions:
// - Scale is free if two sensors of a frame are fixed, or have priors, at
//   different centers: known extrinsics determine it.
// - Nothing is fixed in addition if any frame is fixed by FixedPoses, if all
//   frames or all points are constant, or if there are position priors.
//
// Method: Levenberg-Marquardt with analytic derivatives. Points are eliminated
// first (Schur complement), frames by sparse Cholesky factorization, extrinsics
// and intrinsics last.
//
// Stopping criterion of a solve: |cost - new cost| <= function_tolerance cost,
// also without damping; src/estimation/rig_solver/rig_solver.h has the others.
//
// Cost of an iteration: linear in the observations, for each point quadratic in
// the number of frames that observe it, and the factorization. Results are the
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
  // kCeres runs Ceres with the same derivatives, for comparison.
  SolverBackend backend = SolverBackend::kNative;
  Option<int> max_num_iterations{"max_num_iterations", 100, AtLeast(1),
                                 "iterations",
                                 "Limit the iterations of one solve."};
  Option<double> function_tolerance{
      "function_tolerance", 1e-6, Between(0.0, 1.0),
      "End a solve when a step, and the next one without damping, change the "
      "cost by at most this fraction."};
  // Scale of the Cauchy loss of reprojection errors.
  double loss_scale_px = 1.8;
  // Upper bound of loss_scale in standard deviations of the keypoint noise,
  // after the first triangulation. 2.385 is 95 % efficient for normal noise.
  double loss_sigma_factor = 2.385;
  Option<bool> refine_rig_from_world{"refine_rig_from_world", true,
                                     "Refine frame poses."};
  Option<RefineMode> refine_sensor_from_rig{
      "refine_sensor_from_rig", RefineMode::kAuto,
      "Refine sensor_from_rig. auto: sensors without a prior. yes: all; "
      "sensors with a prior stay near it."};
  bool refine_points = true;
  Option<RefineMode> refine_focal_length{
      "refine_focal_length", RefineMode::kAuto,
      "Refine focal lengths. auto: those without a prior."};
  Option<RefineMode> refine_principal_point{
      "refine_principal_point", RefineMode::kAuto,
      "Refine principal points. auto: of cameras without a prior focal length, "
      "near the image center."};
  Option<RefineMode> refine_extra_params{
      "refine_extra_params", RefineMode::kAuto,
      "Refine distortion parameters. auto: of cameras without a prior focal "
      "length."};
  Option<double> focal_length_prior_sigma{
      "focal_length_prior_sigma", 1e-3, GreaterThan(0.0),
      "Set the relative standard deviation of prior focal lengths that are "
      "refined."};
  // Relative standard deviation of initial focal lengths that are not priors.
  // It keeps a focal length near its initial value if the motion does not
  // determine it.
  double focal_length_start_sigma = 0.2;
  // Refined focal lengths with a larger relative standard deviation are
  // reported as unobservable.
  double max_focal_length_sigma = 0.01;
  // Refined focal lengths below this multiple of the larger image side are
  // reported as implausible.
  double min_focal_length_ratio = 0.1;
  // Refined focal lengths above this multiple of the larger image side are
  // reported as implausible.
  double max_focal_length_ratio = 10.0;
  // Refined distortion parameters of larger magnitude are reported as
  // implausible.
  double max_extra_param = 1.0;
  // Standard deviation of prior sensor_from_rig rotations that are refined.
  double sensor_from_rig_prior_sigma_deg = 0.1;
  // Standard deviation of prior sensor_from_rig translations that are refined,
  // as a fraction of the largest one in the rig.
  double sensor_from_rig_prior_sigma = 0.01;
  // Scale of the Cauchy loss of measured positions and of gravity. 2.8 is the
  // 95 % quantile of normal noise in 3D, and the 98 % quantile in 2D.
  double prior_loss_scale = 2.8;

  // Number of rounds of a solve and a triangulation of all points.
  int num_rounds = 3;
  // Observations with a reprojection error above this many standard deviations
  // of the keypoint noise are outliers.
  double error_sigma_factor = 4.0;
  // Lower bound of the outlier threshold of error_sigma_factor. Pair
  // verification accepts keypoint errors of up to twice this bound, and
  // keypoint errors in recordings have heavy tails.
  double min_max_error_px = 2.0;
  Option<double> max_max_error_px{
      "max_max_error", 4.0, GreaterThan(0.0), "px",
      "Reject observations with a larger reprojection error in the last round. "
      "The bound doubles for each earlier round."};
  Option<double> min_triangulation_angle_deg{
      "min_triangulation_angle_deg", 1.0, Between(0.0, 90.0), "deg",
      "Remove points with a smaller triangulation angle."};
  // Points with two observations and a smaller triangulation angle are removed.
  double min_two_view_angle_deg = 2.0;
  // Points with fewer observations are removed.
  int min_num_observations = 2;
  Option<double> min_track_share{
      "min_track_share", 0.75, Between(0.0, 1.0),
      "Remove points of which less than this fraction of the track are "
      "inliers; most lie on moving objects."};
  // The last round removes points if a smaller fraction of the database matches
  // of their keypoints agrees. A vehicle agrees with a few images and
  // contradicts the others that show it. 0 disables the test.
  double min_match_share = 0.7;
  // Points farther from all of their cameras, in median distances, are removed.
  // A vehicle alongside appears infinitely far and biases the rotation of the
  // rig. 0 disables the test.
  double max_relative_distance = 40.0;
  // The same limit for points that only one image per frame observes, in
  // cameras that share most distant points with another camera: two images of a
  // frame would measure the distance of a vehicle. 0 disables the test.
  double max_relative_distance_of_one_image = 5.0;
  // Points with only two observations are removed if they are nearer to a
  // camera than this, in median distances. Most are wrong matches, and near
  // points constrain the frame strongly.
  double min_two_view_relative_distance = 0.1;
  // Frames with fewer observations are reported as weak.
  int min_num_observations_per_frame = 6;
  // Solve iteratively even where a direct solution is faster: the iterative
  // solver needs less memory.
  bool saves_memory = false;

  void HoldIntrinsics() {
    refine_focal_length = RefineMode::kNo;
    refine_principal_point = RefineMode::kNo;
    refine_extra_params = RefineMode::kNo;
  }

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(max_num_iterations, function_tolerance, refine_rig_from_world,
          refine_sensor_from_rig, refine_focal_length, refine_principal_point,
          refine_extra_params, focal_length_prior_sigma, max_max_error_px,
          min_triangulation_angle_deg, min_track_share);
  }
};

// Counts before and after points are filtered or retriangulated.
struct BundleRound {
  double sigma_px = 0.0;      // noise of each coordinate of the keypoints
  double max_error_px = 0.0;  // outlier bound for sigma_px
  size_t num_points_before = 0;
  size_t num_points_after = 0;
  size_t num_observations_before = 0;
  size_t num_observations_after = 0;

  auto Fields() const {
    return Named("sigma_px", sigma_px, "max_error_px", max_error_px,
                 "num_points_before", num_points_before, "num_points_after",
                 num_points_after, "num_observations_before",
                 num_observations_before, "num_observations_after",
                 num_observations_after);
  }
};

struct DroppedFrame {
  int frame_idx = 0;
  std::string reason;

  auto Fields() const {
    return Named("frame_id", As<Item::kFrameId>(frame_idx), "reason", reason);
  }
};

struct BundleSummary {
  std::vector<SolveSummary> solves;
  // The first and last rounds only filter points; the others retriangulate
  // them.
  std::vector<BundleRound> rounds;
  std::vector<DroppedFrame> dropped_frames;  // had an initial pose
  std::vector<int> weak_frame_idxs;          // kept with few observations
  std::vector<int> sensor_idxs_without_observations;  // kept their initial pose
  // Observations ignored by the last solve: the camera cannot see the point.
  size_t num_invisible_observations = 0;

  auto Fields() const {
    return Named("solves", solves, "rounds", rounds, "dropped_frames",
                 dropped_frames, "weak_frames",
                 As<Item::kFrameId>(weak_frame_idxs),
                 "sensors_without_observations",
                 As<Item::kSensorName>(sensor_idxs_without_observations),
                 "num_invisible_observations", num_invisible_observations);
  }
};

struct BundleResult {
  Reconstruction estimate;
  BundleSummary summary;
};

// The gravity terms of bundle adjustment: measured directions in images, and
// the direction of gravity in the world of the model.
struct GravityTerms {
  GravityPriors priors;
  Eigen::Vector3d down_in_world = Eigen::Vector3d::UnitY();  // unit vector
  double sigma_rad = 1.0;  // of each of the two angles of a direction
};

// The term |sqrt_information (Log(S S_0^T), t - t_0)|^2 of a sensor.
struct SensorPosePrior {
  Rigid3 sensor_from_rig;
  PoseMatrix sqrt_information = PoseMatrix::Zero();
};

// The calibration from another model; it replaces the terms with sigma_R,
// sigma_t and sigma_f in (1). Empty: nothing.
struct CalibrationPrior {
  std::vector<std::optional<SensorPosePrior>> sensors;  // per sensor
  // Per camera: the values of its parameters and their standard deviations, 0
  // for constant ones; empty for cameras that the model lacks.
  std::vector<std::vector<double>> intrinsics;
  std::vector<std::vector<double>> intrinsic_sigmas;
};

// The measurements beyond keypoints that bundle adjustment uses. Positions must
// be in the world of the model. Empty: none.
struct BundlePriors {
  PositionPriors positions;
  std::optional<GravityTerms> gravity;
  CalibrationPrior calibration = {};
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

struct RefinementConditions {
  BundlePriors priors = {};
  FixedPoses fixed = {};
};

// The evidence for and against points.
struct CandidateSource {
  // Returns groups of keypoints that can be observations of one point. The
  // model, with reprojection errors up to max_error_px, helps to separate
  // points. A group has at most one keypoint per image.
  std::function<std::shared_ptr<const ObservationGroups>(
      const Reconstruction& model, double max_error_px)>
      groups = {};
  // All matches; the groups may contain only the matches that agree with the
  // model. They must outlive the source. Null: nothing contradicts a point.
  const ViewGraph* matches = nullptr;
};

// Returns the same groups for every model.
inline CandidateSource FixedCandidates(ObservationGroups groups) {
  return {[shared = std::make_shared<const ObservationGroups>(std::move(
               groups))](const Reconstruction&, double) { return shared; }};
}

// The complete stage:
//   1. Remove gross outliers. Solve with constant rotations and intrinsics. If
//      num_rounds > 2, this solve and the next one have only points that many
//      frames observe (bundle_adjustment/long_tracks.h): points on moving
//      objects bend the poses of the few frames that observe them.
//   2. num_rounds times: solve, then triangulate all groups of `candidates`
//      again with the current poses. This rejects outliers and completes,
//      merges and splits points. A point needs min_track_share of its group:
//      the two cameras of a stereo pair agree on the position of a moving
//      vehicle, but no two frames do. The last round also removes points if
//      fewer than min_match_share of the matches of their keypoints agree with
//      them (bundle_adjustment/point_filters.h): a slightly wrong frame pose
//      makes a few points of a vehicle agree.
//   3. Solve to function_tolerance. Earlier solves use 100 times that.
//   4. Remove outliers; points with large errors overall, too small a
//      triangulation angle or too large a distance; and points of two
//      observations near a camera. Drop frames without observations and, if any
//      frames share points, frames that share none, unless they are fixed.
//
// The bound for outliers is error_sigma_factor standard deviations of the
// keypoint noise, clamped to limits that tighten from round to round. The noise
// is a robust estimate from reprojection errors, corrected for the degrees of
// freedom of the points. It also bounds the scale of the loss after the first
// triangulation: sharp images have far less than a pixel of noise, and wrong
// matches within a pixel would bias weakly observed parameters, such as the
// sensor translations of a standing rig.
//
// Points outside all groups lose outliers and must pass the same tests. If a
// solve fails, the estimate before it is returned.
[[nodiscard]] BundleResult RefineReconstruction(
    const Scene& scene, const CandidateSource& candidates,
    Reconstruction initial, const BundleAdjustmentOptions& options,
    const Context& context, const RefinementConditions& conditions = {});

// The triangulation of step 2 alone, with max_max_error_px as bound. For models
// without points or with new frames.
[[nodiscard]] Reconstruction TriangulateCandidates(
    const Scene& scene, const CandidateSource& candidates,
    Reconstruction initial, const BundleAdjustmentOptions& options,
    const Context& context);

}  // namespace mgsfm
