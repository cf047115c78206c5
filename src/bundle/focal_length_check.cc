// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/bundle/focal_length_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bundle/problem_builder.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle/covariance.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

constexpr double kMaxChange = 2.0;

const CameraModelInfo& InfoOf(const Camera& camera) {
  return *FindCameraModel(static_cast<int32_t>(camera.model));
}

std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.3g", value);
  return text;
}

// The largest turn of any frame against the first.
double LargestTurnDeg(const Reconstruction& model) {
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

// What is not plausible of the parameters themselves; "" if all is.
std::string DescribeImplausible(const Camera& given, const Camera& camera,
                                const BundleAdjustmentOptions& options) {
  const CameraModelInfo& info = InfoOf(camera);
  const double side = std::max(camera.width_px, camera.height_px);
  for (const int i : info.focal_length_idxs) {
    const double ratio = camera.params[i] / side;
    const double change = camera.params[i] / given.params[i];
    if (!(ratio >= options.min_focal_length_ratio &&
          ratio <= options.max_focal_length_ratio)) {
      return "it is " + Number(ratio) +
             " of the larger side of the image, which no lens is";
    }
    if (!(change <= kMaxChange && change >= 1.0 / kMaxChange)) {
      return "it changed by a factor of " + Number(change);
    }
  }
  for (const int i : info.extra_params_idxs) {
    if (camera.params[i] != given.params[i] &&
        !(std::abs(camera.params[i]) <= options.max_extra_param)) {
      return "its distortion parameter " + Number(camera.params[i]) +
             " is beyond what lenses have";
    }
  }
  return "";
}

std::string DescribeUncertain(double sigma, double turn_deg,
                              const BundleAdjustmentOptions& options) {
  if (!(sigma > options.max_focal_length_sigma)) return "";
  return "its relative standard deviation is " + Number(sigma) +
         ", more than " + Number(options.max_focal_length_sigma) +
         ": the motion, with turns of at most " + Number(turn_deg) +
         " deg, does not tell it; give it (with a prior), or images that turn";
}

}  // namespace

std::vector<FocalLengthCheck> CheckFocalLengths(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors) {
  const Mask is_seen = FindSeenCameras(scene, model);
  std::vector<FocalLengthCheck> checks;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const std::vector<int>& idxs = InfoOf(scene.cameras[i]).focal_length_idxs;
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
  const double turn_deg = LargestTurnDeg(model);
  for (FocalLengthCheck& check : checks) {
    const Camera& given = scene.cameras[check.camera_idx];
    const Camera& camera = model.cameras[check.camera_idx];
    std::string problem = DescribeImplausible(given, camera, options);
    if (sigmas && !(*sigmas)[check.camera_idx].empty()) {
      double sigma = 0.0;
      for (const int i : InfoOf(camera).focal_length_idxs) {
        sigma =
            std::max(sigma, (*sigmas)[check.camera_idx][i] / camera.params[i]);
      }
      check.relative_sigma = sigma;
      if (problem.empty()) {
        problem = DescribeUncertain(sigma, turn_deg, options);
      }
    } else if (problem.empty()) {
      problem = "its standard deviation cannot be computed";
    }
    if (problem.empty()) continue;
    check.message = "focal length of camera " +
                    std::to_string(given.id.value()) + ", refined from " +
                    Number(check.prior_px) + " to " +
                    Number(check.estimated_px) + " px: " + problem;
  }
  return checks;
}

}  // namespace mgsfm
