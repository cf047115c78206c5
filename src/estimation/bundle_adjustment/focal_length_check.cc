// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "bundle_adjustment/problem_builder.h"
#include "bundle_adjustment/residual_field.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// A larger factor means that the initial value or the estimate is wrong, unless
// the initial value is a guess: bundle adjustment recovers from initial values
// that are wrong by up to this factor (docs/results/constants.md).
constexpr double kMaxChange = 2.0;
// The assumed focal length, in larger image sides: the default of
// ImageReader.default_focal_length_factor, as in COLMAP.
constexpr double kAssumedRatio = 1.2;

std::string Number(double value) { return Formatted("%.3g", value); }

std::string Pixels(double value) { return Formatted("%.1f px", value); }

// The largest rotation of a frame relative to the first.
double LargestRotationDeg(const Reconstruction& model) {
  const std::optional<Rigid3>* first = nullptr;
  double largest = 0.0;
  for (const auto& pose : model.rig_from_world) {
    if (!pose) continue;
    if (first == nullptr) first = &pose;
    largest =
        std::max(largest, AngleBetween((*first)->rotation, pose->rotation));
  }
  return RadToDeg(largest);
}

Mask FindSeenCameras(const Scene& scene, const Reconstruction& model) {
  Mask is_seen(scene.cameras.size(), false);
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      is_seen[scene.images[o.image_idx].camera_idx] = true;
    }
  }
  return is_seen;
}

// Why the parameters are implausible; empty if they are plausible.
std::string DescribeImplausible(const Camera& initial, const Camera& camera,
                                const BundleAdjustmentOptions& options) {
  const CameraModelInfo& info = InfoOf(camera.model);
  const double side = std::max(camera.width_px, camera.height_px);
  for (const int i : info.focal_length_idxs) {
    const double ratio = camera.params[i] / side;
    const double change = camera.params[i] / initial.params[i];
    if (!(ratio >= options.min_focal_length_ratio &&
          ratio <= options.max_focal_length_ratio)) {
      return "it is " + Number(ratio) +
             " times the larger image side, which is implausible";
    }
    const bool is_guess = !initial.has_prior_focal_length &&
                          IsAssumedFocalLength(initial, initial.params[i]);
    if (!is_guess && !(change <= kMaxChange && change >= 1.0 / kMaxChange)) {
      return "it changed by a factor of " + Number(change);
    }
  }
  for (const int i : info.extra_params_idxs) {
    if (camera.params[i] != initial.params[i] &&
        !(std::abs(camera.params[i]) <= options.max_extra_param)) {
      return "its distortion parameter " + Number(camera.params[i]) +
             " is implausible";
    }
  }
  return "";
}

// The larger relative standard deviation of both focal lengths.
double RelativeSigma(const Camera& camera, const std::vector<double>& sigmas) {
  double sigma = 0.0;
  for (const int i : InfoOf(camera.model).focal_length_idxs) {
    sigma = std::max(sigma, sigmas[i] / camera.params[i]);
  }
  return sigma;
}

std::string DescribeUncertain(double sigma, double rotation_deg,
                              const BundleAdjustmentOptions& options) {
  if (!(sigma > options.max_focal_length_sigma)) return "";
  return "its relative standard deviation is " + Number(sigma) +
         ", more than " + Number(options.max_focal_length_sigma) +
         ": the motion, with rotations of at most " + Number(rotation_deg) +
         " deg, does not determine it";
}

}  // namespace

bool IsAssumedFocalLength(const Camera& camera, double focal_length_px) {
  const double side = std::max(camera.width_px, camera.height_px);
  return std::abs(focal_length_px / side - kAssumedRatio) < 1e-3;
}

std::vector<FocalLengthCheck> CheckFocalLengths(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors) {
  const Mask is_seen = FindSeenCameras(scene, model);
  std::vector<FocalLengthCheck> checks;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const std::vector<int>& idxs =
        InfoOf(scene.cameras[i].model).focal_length_idxs;
    if (!is_seen[i] || idxs.empty() ||
        !RefinesFocalLength(scene.cameras[i], options)) {
      continue;
    }
    checks.push_back({static_cast<int>(i), scene.cameras[i].params[idxs[0]],
                      model.cameras[i].params[idxs[0]], std::nullopt, ""});
  }
  if (checks.empty()) return checks;
  const auto sigmas =
      ComputeIntrinsicSigmas(scene, model, options, context, priors);
  const double rotation_deg = LargestRotationDeg(model);
  for (FocalLengthCheck& check : checks) {
    const Camera& initial = scene.cameras[check.camera_idx];
    const Camera& camera = model.cameras[check.camera_idx];
    std::string problem = DescribeImplausible(initial, camera, options);
    if (sigmas && !(*sigmas)[check.camera_idx].empty()) {
      const double sigma = RelativeSigma(camera, (*sigmas)[check.camera_idx]);
      check.relative_sigma = sigma;
      if (problem.empty()) {
        problem = DescribeUncertain(sigma, rotation_deg, options);
      }
    } else if (problem.empty()) {
      problem = "its standard deviation cannot be computed";
    }
    if (problem.empty()) continue;
    check.message = "focal length of " + CameraLabel(scene, check.camera_idx) +
                    ", refined from " + Pixels(check.prior_px) + " to " +
                    Pixels(check.estimated_px) + ": " + problem;
  }
  return checks;
}

void AddLensErrors(const Scene& scene, const Reconstruction& model,
                   const BundleAdjustmentOptions& options,
                   const Context& context, const BundlePriors& priors,
                   std::vector<FocalLengthCheck>* checks) {
  if (checks->empty()) return;
  const auto sigmas =
      ComputeAllIntrinsicSigmas(scene, model, options, context, priors);
  if (!sigmas) return;
  for (FocalLengthCheck& check : *checks) {
    const std::vector<double>& total = sigmas->total[check.camera_idx];
    if (total.empty()) continue;
    check.relative_sigma =
        RelativeSigma(model.cameras[check.camera_idx], total);
  }
}

}  // namespace mgsfm
