// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Soft rig: each image gets its own pose near the one that its rig predicts. It
// serves cameras that do not trigger simultaneously or are not rigidly mounted.
//
// Model. Image i of sensor s in frame f has the pose cam_from_world = S_i G_f.
// Its rig predicts S_i = S_s D_i: S_s is sensor_from_rig, and D_i the motion of
// the rig between the frame and the image, the identity without image times.
//
// Objective, over points p, frame poses G_f and image poses S_i:
//
//   min 1/2 sum_o rho(|Project(S_i G_f p) - x_o|^2) / sigma^2
//     + 1/2 sum_i (|w_i|^2 / a_s^2 + |d_i|^2 / b_s^2)                      (1)
//
// The deviation of S_i = (R_i, t_i) from S_s D_i = (R, t) is w_i =
// Log(R_i R^T), d_i = t_i - t. Its coordinates have standard deviations a_s and
// b_s. sigma is the noise of the keypoints, rho is the loss of bundle
// adjustment.
//
// Hyperparameters. The quantities that all images of a sensor share maximize
// the likelihood of the keypoints with the deviations integrated out (Laplace's
// approximation), so standard deviations neither collapse nor diverge. Let P_ij
// be the posterior covariance of the deviations x_i, x_j of a frame under (1),
// A_s = diag(a_s^2, b_s^2) their prior covariance, and
// W_ij = [i = j] A_s^-1 - A_s^-1 P_ij A_s'^-1. Each round takes one step of:
//   sigmas:     a^2 <- a^2 + sum_i (|w_i|^2 - a^2 tr C_i) / sum_i n tr C_i^2
//               with C_i = I - P_ii / a^2 (rotation block) and n = m / (m - 1)
//               for m images in the frame. This is Fisher scoring, limited to a
//               factor of 25. b^2 likewise.
//   extrinsics: generalized least squares: all S_s move by
//               (sum J_i^T W_ij J_j)^-1 sum J_i^T A_s^-1 x_i, where J_i is the
//               derivative of S_s D_i. Fixed extrinsics do not move.
// The sums run over at most 200 frames per rig that have several images.
//
// Gauge: that of bundle adjustment. Without position priors, scale is fixed to
// that of the initial model: (1) does not determine it, because a smaller world
// has smaller deviations.
//
// Stopping criteria. The iteration ends after a round in which no standard
// deviation changes by more than sigma_tolerance (relative), or after
// max_num_rounds. A standard
// deviation counts as zero (rigid) if the images determine less than 1/50 of
// the deviations: mean tr C_i / 3 < 0.02.
//
// Cost of a round: one solve of (1), one factorization, and six triangular
// solves with it per image in the sums. The first rounds also triangulate all
// points again.

enum class SoftRig {
  kAuto,        // image times, if frames have several that explain more
  kNone,        // images at the times of their frames
  kSoft,        // one deviation per image
  kTimeOffset,  // one delay per sensor
  kReadout,     // one readout time per sensor
  kBoth,        // delays and readout times
};

template <>
struct EnumTable<SoftRig> {
  static constexpr std::pair<std::string_view, SoftRig> kNames[] = {
      {"auto", SoftRig::kAuto},       {"none", SoftRig::kNone},
      {"soft", SoftRig::kSoft},       {"time_offset", SoftRig::kTimeOffset},
      {"readout", SoftRig::kReadout}, {"both", SoftRig::kBoth}};
};

struct SoftRigOptions {
  Option<SoftRig> method{
      "method", SoftRig::kAuto,
      "Estimate a trigger delay per camera (time_offset), the time in which it "
      "reads an image (readout), both, or a pose per image near the rig "
      "(soft). auto uses image times that differ within frames if they explain "
      "more matches; none never does."};
  int max_num_rounds = 15;
  // Convergence requires that no standard deviation changes by more than this
  // fraction.
  double sigma_tolerance = 0.05;
  // A delay or readout time is unobservable if its standard deviation exceeds
  // this fraction of the median time between two frames.
  double max_time_offset_sigma = 0.1;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(method);
  }
};

// Rigidity of one sensor. Lengths are in the unit of the model.
struct SoftRigSensor {
  int sensor_idx = 0;
  int num_images = 0;
  // Estimated standard deviation of each coordinate of the deviations.
  double sigma_rotation_rad = 0.0;
  double sigma_position = 0.0;
  bool is_rigid = false;  // the images show no deviation
  // Final deviations of the images of the sensor.
  double rms_rotation_rad = 0.0;
  double max_rotation_rad = 0.0;
  double rms_position = 0.0;
  double max_position = 0.0;
  // Reprojection errors. The number of observations may increase.
  double mean_error_before_px = 0.0;
  double mean_error_after_px = 0.0;
  size_t num_observations_before = 0;
  size_t num_observations_after = 0;
  // Only if estimated and observable. Positive: the sensor triggers later than
  // its timestamps say.
  std::optional<double> time_offset_s;
  std::optional<double> time_offset_sigma_s;
  // The time from the first to the last row.
  std::optional<double> readout_s;
  std::optional<double> readout_sigma_s;
  std::string message;  // why a time is missing

  auto Fields() const {
    return Named(
        "name", As<Item::kSensorName>(sensor_idx), "num_images", num_images,
        "is_rigid", is_rigid, "sigma_rotation_deg",
        InDegrees{sigma_rotation_rad}, "sigma_position", sigma_position,
        "rms_rotation_deg", InDegrees{rms_rotation_rad}, "max_rotation_deg",
        InDegrees{max_rotation_rad}, "rms_position", rms_position,
        "max_position", max_position, "mean_error_before_px",
        mean_error_before_px, "mean_error_after_px", mean_error_after_px,
        "num_observations_before", num_observations_before,
        "num_observations_after", num_observations_after, "time_offset_s",
        time_offset_s, "time_offset_sigma_s", time_offset_sigma_s, "message",
        message);
  }
};

struct SoftRigSummary {
  bool is_usable = false;  // otherwise the model is the initial one
  bool has_converged = false;
  std::string message;
  double sigma_px = 0.0;  // final noise of the keypoints
  std::vector<SolveSummary> solves;
  std::vector<SoftRigSensor> sensors;  // of rigs with several sensors

  auto Fields() const {
    return Named("is_usable", is_usable, "has_converged", has_converged,
                 "message", message, "noise_px", sigma_px, "solves", solves,
                 "sensors", sensors);
  }
};

struct SoftRigImages {
  std::vector<std::optional<Rigid3>> cam_from_world;  // per image
  SoftRigSummary summary;
};

struct SoftRigResult {
  // The extrinsics S_s, the frames, and points that fit the image poses.
  Reconstruction estimate;
  SoftRigImages images;
};

struct SoftRigInput {
  const Scene& scene;
  const Scene& separate;  // SeparateImages(scene)
  // Groups of keypoints for models of `separate`. If empty, the points are
  // kept.
  const CandidateSource& candidates;
  const Reconstruction& initial;  // after bundle adjustment
  BundlePriors priors = {};       // of bundle adjustment
};

// Refines a model after bundle adjustment with `bundle_options` (kSoft). The
// result is not usable if no frame has two registered images or if a solve
// fails.
[[nodiscard]] SoftRigResult EstimateSoftRig(
    const SoftRigInput& input, const SoftRigOptions& options,
    const BundleAdjustmentOptions& bundle_options, const Context& context);

}  // namespace mgsfm
