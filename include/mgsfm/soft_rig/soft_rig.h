// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/bundle/bundle_priors.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Cameras of a rig that do not release at the same instant, or are not quite
// rigidly mounted. Every image i of sensor s in frame f gets a pose of its own,
// S_i G_f, near where the rig has it: S_i near S_s D_i. Over points, poses G_f
// of frames and S_i of images
//
//   min 1/2 sum_o rho(|Project(S_i G_f p) - x_o|^2) / sigma^2
//     + 1/2 sum_i (|w_i|^2 / a_s^2 + |d_i|^2 / b_s^2)                      (1)
//
// w_i = Log(R_i R^T), d_i = t_i - t: the deviation of S_i = (R_i, t_i) from
// S_s D_i = (R, t); sigma: the noise of keypoints; rho: Huber.
//
// What is common to the images of a sensor maximises the likelihood of the
// keypoints with deviations integrated out (Laplace's approximation), so that
// spreads neither collapse nor blow up. With the posterior covariances P_ij of
// the deviations x_i, x_j of a frame under (1), their prior variances A_s =
// diag(a_s^2, b_s^2), and W_ij = [i = j] A_s^-1 - A_s^-1 P_ij A_s'^-1,
//   spread:     a^2 <- a^2 + sum_i (|w_i|^2 - a^2 tr C_i) / sum_i n tr C_i^2,
//               C_i = I - P_ii / a^2 of turns, n = m / (m - 1) for m images in
//               the frame (a step of Fisher scoring, by a factor of 25 at
//               most); b^2 likewise;
//   mean rig:   the generalised least squares step: all S_s move by
//               (sum J_i^T W_ij J_j)^-1 sum J_i^T A_s^-1 x_i, J_i the
//               derivative of S_s D_i. Poses that were given and are held do
//               not move;
//   time:       if asked for, D_i = T(t_i + offset_s) T(t_f)^-1 with the times
//               t_i of the images and t_f of the frame, T the path of the rig
//               (src/bundle/rig_path.h); the offset is a seventh coordinate of
//               the step. D_i is the identity otherwise.
// The sums are over at most 200 frames of a rig with several images.
//
// Gauge: that of bundle adjustment, and scale is held at that of the model
// unless positions are measured: it is not determined by (1), as a smaller
// world has smaller deviations.
//
// Ends when in a round no spread changes by more than sigma_tolerance of
// itself and no time offset by more than time_offset_tolerance. A spread that
// the images determine less than a fiftieth of (tr C_i / 3) is that of a rigid
// rig. Each round has one solve of (1), one factorisation and six solves with
// it for each of these images; the first rounds triangulate points anew.

enum class SoftRig {
  kNone,
  kSoft,        // every image by itself
  kTimeOffset,  // cameras are late or early, the rest image by image
};

template <>
struct EnumTable<SoftRig> {
  static constexpr std::pair<std::string_view, SoftRig> kNames[] = {
      {"none", SoftRig::kNone},
      {"soft", SoftRig::kSoft},
      {"time_offset", SoftRig::kTimeOffset}};
};

struct SoftRigOptions {
  SoftRig method = SoftRig::kNone;
  int max_num_rounds = 15;
  double sigma_tolerance = 0.05;
  double time_offset_tolerance_s = 1e-5;
  double max_time_offset_sigma = 0.1;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("method", self.method, AnyValue(), "",
          "After bundle adjustment, soft gives each image a pose of its own "
          "near that of the rig; time_offset first estimates how late each "
          "camera is, which needs --image_timestamps_path.");
    visit("max_num_rounds", self.max_num_rounds, AtLeast(1), "rounds",
          "Most rounds of adjusting all images and estimating how far they "
          "are from the rig.");
    visit("sigma_tolerance", self.sigma_tolerance, GreaterThan(0.0), "",
          "Ends when no spread changes by more than this part.");
    visit("time_offset_tolerance", self.time_offset_tolerance_s,
          GreaterThan(0.0), "s",
          "Ends when no time offset changes by more than this.");
    visit("max_time_offset_sigma", self.max_time_offset_sigma, GreaterThan(0.0),
          "",
          "A time offset is not observable if its standard deviation is more "
          "than this part of the time between two frames.");
  }
};

// How rigid one camera of a rig was. Lengths in the unit of the model.
struct SoftRigSensor {
  int sensor_idx = 0;
  int num_images = 0;
  // Estimated standard deviations of each coordinate of deviations.
  double sigma_rotation_rad = 0.0;
  double sigma_position = 0.0;
  bool is_rigid = false;  // the images show no deviation
  // Of the deviations of its images, in the end.
  double rms_rotation_rad = 0.0;
  double max_rotation_rad = 0.0;
  double rms_position = 0.0;
  double max_position = 0.0;
  // Of its observations, of which there may be more after.
  double mean_error_before_px = 0.0;
  double mean_error_after_px = 0.0;
  size_t num_observations_before = 0;
  size_t num_observations_after = 0;
  // If asked for and observable; positive: its images are late.
  std::optional<double> time_offset_s;
  std::optional<double> time_offset_sigma_s;
  std::string message;  // why there is no time offset
};

struct SoftRigSummary {
  bool is_usable = false;  // else the model is as it was
  bool has_converged = false;
  std::string message;
  double sigma_px = 0.0;  // noise of keypoints in the end
  std::vector<SolveSummary> solves;
  std::vector<SoftRigSensor> sensors;  // of rigs with several
};

// The poses of images that their rig does not tell.
struct SoftRigImages {
  std::vector<std::optional<Rigid3>> cam_from_world;  // per image
  SoftRigSummary summary;
};

struct SoftRigResult {
  // The mean rig, frames, and points that fit the poses of the images.
  Reconstruction estimate;
  SoftRigImages images;
};

// `initial` is a model that bundle adjustment with `bundle_options` and
// `priors` made of `scene`; `separate` is SeparateImages(scene), for whose
// models `candidates` gives groups of keypoints (none: points are kept). The
// times of images are those of the scene; all must be there for kTimeOffset.
// Not usable if no frame has two images, or a solve fails.
[[nodiscard]] SoftRigResult EstimateSoftRig(
    const Scene& scene, const Scene& separate,
    const CandidateSource& candidates, const Reconstruction& initial,
    const SoftRigOptions& options,
    const BundleAdjustmentOptions& bundle_options, const Context& context,
    const BundlePriors& priors = {});

}  // namespace mgsfm
